//! Which levels a view uses where, and the ranks of their bricks.

use glam::DVec3;

use crate::render::paging::brick_numbers::BrickNumbers;
use crate::scene::{Projection, View};
use crate::source::Description;
use crate::twins::limits::RANK_NONE;
use crate::twins::ranks::LevelView;
use crate::volume::WorldFromVoxel;

/// How a view uses the levels of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewLevels {
    /// Every level of the volume, as the shaders take it.
    pub levels: Vec<LevelView>,
    /// Finest and coarsest that rays of the view meet.
    pub in_use: [u32; 2],
    /// How many ranks there are.
    pub ranks: u32,
    /// Samples of a ray, at most.
    pub samples_of_ray_max: f64,
}

/// Which levels a view may use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelChoice {
    /// Greatest distance of two samples in smallest voxel edges of the level.
    pub step: f64,
    /// Finest allowed.
    pub level_min: u8,
    /// Coarsest allowed; nothing: the volume's coarsest.
    pub level_max: Option<u8>,
    /// By so many levels coarser than this and the pixel's footprint say, or finer; level 0 stays itself.
    pub shift: i8,
}

/// Beyond every volume, as a ray parameter.
const FAR: f64 = 1e300;

impl ViewLevels {
    /// The levels of `description`, placed in the world by `world_from_voxel`, in a picture of `size`
    /// pixels. A level is in use from where its voxels are no larger than a pixel to where the next
    /// coarser one's are, as far as `choice` allows.
    pub fn new(
        view: &View,
        size: [u32; 2],
        description: &Description,
        world_from_voxel: &WorldFromVoxel,
        numbers: &BrickNumbers,
        choice: LevelChoice,
    ) -> ViewLevels {
        let frame = view.ray_frame_world(size);
        let spacing = world_from_voxel.spacing().to_array();
        let all: Vec<_> = description.levels.iter().collect();
        let edge = |level: usize| {
            let scale = all[level].scale;
            (0..3).map(|axis| spacing[axis] * f64::from(scale[axis])).fold(FAR, f64::min)
        };
        let last = all.len() - 1;
        let coarsest = choice.level_max.map_or(last, |most| usize::from(most).min(last));
        let finest = usize::from(choice.level_min).min(coarsest);
        let parallel = matches!(view.projection, Projection::Orthographic { .. });
        // Of a pixel, world: where rays are parallel everywhere, else at ray parameter 1.
        let footprint = match parallel {
            true => frame.origin_column.length().min(frame.origin_row.length()),
            false => frame.direction_column.length().min(frame.direction_row.length()),
        };
        let begins_at = |level: usize| match (level, parallel) {
            (level, _) if level <= finest => 0.0,
            (_, true) if edge(level) <= footprint => 0.0,
            (_, true) => FAR,
            (_, false) => edge(level) / footprint,
        };
        let extent = description.size().to_array().map(f64::from);
        let corners = (0..8).map(|corner| {
            let at = |axis: usize| if corner >> axis & 1 == 1 { extent[axis] } else { 0.0 };
            world_from_voxel.point(DVec3::new(at(0), at(1), at(2)))
        });
        let depths: Vec<f64> =
            corners.map(|corner| (corner - view.eye).dot(view.forward).max(0.0)).collect();
        let nearest = depths.iter().copied().fold(FAR, f64::min);
        let farthest = depths.iter().copied().fold(0.0, f64::max);
        let ends_at = |level: usize| if level == coarsest { FAR } else { begins_at(level + 1) };
        let drawn_as = |level: usize| match level {
            0 => 0,
            _ => level.saturating_add_signed(choice.shift.into()).min(last),
        };
        // Where a level is drawn, in its own place or in that of finer ones.
        let depth = |drawn: usize| {
            let levels = (finest..=coarsest).filter(|level| drawn_as(*level) == drawn);
            let depths = levels.map(|level| [begins_at(level), ends_at(level)]);
            let met = depths.filter(|[begins, ends]| begins < ends);
            met.fold([FAR, 0.0], |depth, [begins, ends]| [depth[0].min(begins), depth[1].max(ends)])
        };
        let met = |level: &usize| {
            let [begins, ends] = depth(*level);
            begins < ends && begins <= farthest && ends >= nearest
        };
        let used: Vec<usize> = (0..=last).filter(met).collect();
        let rays = frame.in_voxels(world_from_voxel);
        let mut ranks = 0;
        let levels = (0..all.len()).map(|level| {
            let scale = all[level].scale.map(f64::from);
            let bricks = numbers.bricks(level);
            let payload = description.payload.to_array().map(f64::from);
            let eye_brick: [i32; 3] = std::array::from_fn(|axis| {
                let last = f64::from(bricks[axis] - 1);
                let nearest = if parallel {
                    if rays.direction[axis] < 0.0 { last } else { 0.0 }
                } else {
                    (rays.origin[axis] / scale[axis] / payload[axis]).floor().clamp(0.0, last)
                };
                nearest as i32
            });
            let in_use = used.contains(&level);
            let rank_first = if in_use { ranks } else { RANK_NONE };
            if in_use {
                let span = |axis: usize| {
                    let eye = eye_brick[axis] as u32;
                    eye.max(bricks[axis] - 1 - eye)
                };
                ranks += span(0) + span(1) + span(2) + 1;
            }
            LevelView {
                per_scale_step: [
                    1.0 / scale[0],
                    1.0 / scale[1],
                    1.0 / scale[2],
                    choice.step * edge(level),
                ],
                depth: if in_use { depth(level) } else { [1.0, 0.0] },
                halvings: all[level].scale.map(u32::ilog2),
                held: 0,
                bricks,
                first_place: numbers.first_place(level),
                eye_brick,
                rank_first,
            }
        });
        let levels: Vec<LevelView> = levels.collect();
        let in_use = [used.first(), used.last()].map(|level| level.map_or(0, |at| *at as u32));
        let longest = longest_diagonal_world(extent, world_from_voxel);
        let per_level = used.len().max(1) as f64;
        // A thousandth and one more a level for rounding in the ray's own arithmetic.
        let finest_step = choice.step * edge(in_use[0] as usize);
        let samples_of_ray_max = (longest / finest_step * 1.001).ceil() + 1.0 + per_level;
        ViewLevels { levels, in_use, ranks: ranks.max(1), samples_of_ray_max }
    }

    /// Whether rays go through several levels.
    pub fn several(&self) -> bool {
        self.in_use[0] != self.in_use[1]
    }
}

/// The longest way through the volume's box, world.
pub fn longest_diagonal_world(extent_voxel: [f64; 3], world_from_voxel: &WorldFromVoxel) -> f64 {
    let size = DVec3::from_array(extent_voxel);
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .iter()
        .map(|&(y, z)| world_from_voxel.vector(size * DVec3::new(1.0, y, z)).length())
        .fold(0.0, f64::max)
}
