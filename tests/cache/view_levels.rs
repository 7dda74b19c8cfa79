//! The levels of a volume as a view uses them: where the eye is, which level is used from which depth.

use ashfall::scene::{Projection, View};
use ashfall::twins::limits::RANK_NONE;
use ashfall::twins::ranks::LevelView;
use ashfall::twins::ray_setup::ViewRays;
use ashfall::volume::Levels;
use glam::DVec3;

use crate::random::Random;
use crate::views::{Placed, unit_vector};

/// Levels from `finest` on, each up to the next of `depths` (ray parameters, ascending, starting at
/// 0); the last of them to the end of the ray. Steps are at most `step_world` of level 0.
pub fn level_views(
    levels: &Levels,
    payload: [u32; 3],
    rays: &ViewRays,
    finest: usize,
    depths: &[f64],
    step_world: f64,
) -> (Vec<LevelView>, u32) {
    let parallel = [rays.direction_column_voxel, rays.direction_row_voxel] == [[0.0; 4]; 2];
    let (mut first_place, mut ranks) = (0, 0);
    let views = levels.iter().enumerate().map(|(number, level)| {
        let size = level.size.to_array();
        let bricks: [u32; 3] = std::array::from_fn(|axis| size[axis].div_ceil(payload[axis]));
        let per_scale = level.scale.map(|scale| 1.0 / f64::from(scale));
        let eye_brick: [i32; 3] = std::array::from_fn(|axis| {
            let last = bricks[axis] as i32 - 1;
            if parallel {
                return if rays.direction_voxel[axis] < 0.0 { last } else { 0 };
            }
            // Integers are voxel centres: the cell of the eye.
            let cell = (rays.origin_voxel[axis] * per_scale[axis] - 0.5).floor();
            ((cell / f64::from(payload[axis])).floor().clamp(0.0, f64::from(last))) as i32
        });
        let mut level_view = LevelView {
            per_scale_step: [per_scale[0], per_scale[1], per_scale[2], step_world],
            depth: [0.0, 0.0],
            halvings: level.scale.map(u32::trailing_zeros),
            held: 0,
            bricks,
            first_place,
            eye_brick,
            rank_first: RANK_NONE,
        };
        if let Some(depth) = number.checked_sub(finest).and_then(|used| depths.get(used)) {
            let end = depths.get(number - finest + 1).copied().unwrap_or(1e300);
            level_view.depth = [*depth, end];
            level_view.rank_first = ranks;
            let away = |axis: usize| {
                let eye = eye_brick[axis] as u32;
                eye.max(bricks[axis] - 1 - eye)
            };
            ranks += away(0) + away(1) + away(2) + 1;
            let scale = level.scale.map(f64::from);
            level_view.per_scale_step[3] *= scale[0].min(scale[1]).min(scale[2]);
        }
        first_place += bricks.iter().product::<u32>();
        level_view
    });
    (views.collect(), ranks)
}

/// From somewhere inside the volume.
pub fn inner_view(volume: &Placed, random: &mut Random) -> View {
    let mut point = || volume.point(DVec3::from_array([0; 3].map(|_| random.unit())));
    let (eye, target) = (point(), point());
    let projection = Projection::Perspective { fov_degrees: 100.0 };
    View::looking_at("inside".to_owned(), eye, target, unit_vector(random), projection)
        .expect("a good view")
}

/// Origin and direction in voxels of the ray through a place of the picture.
pub fn ray_of_pixel(rays: &ViewRays, at: [f64; 2]) -> ([f64; 3], [f64; 3]) {
    let voxel = |[base, column, row]: [[f64; 4]; 3]| -> [f64; 3] {
        std::array::from_fn(|a| base[a] + column[a] * at[0] + row[a] * at[1])
    };
    let origin = [rays.origin_voxel, rays.origin_column_voxel, rays.origin_row_voxel];
    let direction = [rays.direction_voxel, rays.direction_column_voxel, rays.direction_row_voxel];
    (voxel(origin), voxel(direction))
}

/// Between which parameters the ray is inside of the volume; the second is the less one where it never is.
pub fn crossing((origin, direction): ([f64; 3], [f64; 3]), size: [u32; 3]) -> (f64, f64) {
    let (mut enter, mut leave) = (0.0f64, 1e300f64);
    for axis in 0..3 {
        let extent = f64::from(size[axis]);
        if direction[axis] == 0.0 {
            if !(0.0..=extent).contains(&origin[axis]) {
                leave = -1.0;
            }
            continue;
        }
        let ends = [0.0, extent].map(|end| (end - origin[axis]) / direction[axis]);
        enter = enter.max(ends[0].min(ends[1]));
        leave = leave.min(ends[0].max(ends[1]));
    }
    (enter, leave)
}

/// Where `used` levels begin that change somewhere on the way, at the same parameter of all rays.
pub fn depths_between(random: &mut Random, [near, far]: [f64; 2], used: u32) -> Vec<f64> {
    let mut depths = vec![0.0];
    for level in 1..used {
        let part = f64::from(level) / f64::from(used);
        depths.push(near + (far - near) * part * random.between(0.8, 1.0));
    }
    depths
}
