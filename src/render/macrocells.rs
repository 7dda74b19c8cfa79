//! What rays read of macrocells under the scene's transfer functions: how far around nothing is seen, or
//! how long steps may be. Made anew when a transfer function changes, never per view.

use rayon::prelude::*;
use serde::Serialize;

use crate::error::Result;
use crate::gpu::{Gpu, Image, ImageFormat, ImageSpec};
use crate::render::image_layout::{Layout, TexelLayout};
use crate::render::paging::Judge;
use crate::render::plan::PlannedImage;
use crate::render::plan_images::ChannelFacts;
use crate::render::scene_data::SceneData;
use crate::render::settings::Settings;
use crate::render::transfer_segments::{Windowed, segments_between, transfer_segments, value_at};
use crate::twins::macrocells::{CODE_SHOWS, CODE_STEP_MAX, CODES_OF_LEVEL, LEVEL_WHOLE, REACH_MAX};
use crate::twins::transfer::TransferSegment;
use crate::volume::{Macrocells, Size3, ValueRange, VoxelFormat};

/// Part of the tolerance that one feature of the integrand may cost: a ray meets many.
const TOLERANCE_OF_FEATURE: f64 = 0.15;
/// Finest steps, in smallest voxel edges.
const STEP_EDGES_LEAST: f64 = 1.0 / 512.0;
/// The coarsest that finest steps are: intervals of one edge.
const STEP_EDGES_MOST: f64 = 1.0 / INTERVAL_STEPS;
/// Finest steps in an interval.
const INTERVAL_STEPS: f64 = (1 << LEVEL_WHOLE) as f64;

/// Part of all macrocells that must show nothing, else looking for them costs more than it saves.
const HIDDEN_PART_LEAST: f64 = 0.05;

/// The image of codes that rays read.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedMacrocells {
    /// How many there are.
    pub count: u64,
    /// How many show nothing.
    pub hidden: u64,
    /// Finest step of the integrator "adaptive", smallest voxel edges.
    pub finest_edges: Option<f64>,
    /// Its intervals: steps are parts of one, or whole ones joined.
    pub interval_edges: Option<f64>,
    #[serde(skip)]
    pub(super) codes: Macrocells<u8>,
}

impl PlannedMacrocells {
    /// Codes for the scene's volume drawn directly; nothing where rays need none. A channel without a
    /// texel layout has one value.
    ///
    /// # Errors
    /// When voxels cannot be read.
    pub(super) fn new(
        data: &SceneData,
        facts: &[ChannelFacts],
        texel_layouts: &[Option<TexelLayout>],
        settings: &Settings,
    ) -> Result<Option<PlannedMacrocells>> {
        let quality = &data.scene.quality;
        let adaptive = quality.integrator.has_tolerance();
        let homogeneous = texel_layouts.iter().all(Option::is_none);
        if homogeneous || !(adaptive || settings.skipping) {
            return Ok(None);
        }
        let (volume, voxels) = data.volume()?;
        let ranges = data.volumes[0].macrocells()?;
        let mut channels = Vec::new();
        for (index, (facts, layout)) in facts.iter().zip(texel_layouts).enumerate() {
            let format = facts.format;
            let layout =
                layout.unwrap_or_else(|| TexelLayout::of(format, facts.range, Layout::Plain));
            let scaling = (voxels.channels[index].slope, voxels.channels[index].intercept);
            let from_texel = (layout.scale, layout.offset);
            let segments = transfer_segments(&volume.channels[index], scaling, from_texel);
            let judge = Judge { format, layout, segments, skipping: true };
            let holes = facts.nan_count > 0;
            channels.push(Channel { ranges: &ranges[index], judge, holes });
        }
        let tolerance = adaptive.then(|| Tolerance {
            of_pixel: quality.tolerance,
            edge_world: voxels.world_from_voxel.smallest_edge(),
        });
        let codes = codes(&channels, tolerance);
        let count = codes.codes.of.len() as u64;
        if !adaptive && (codes.hidden as f64) < HIDDEN_PART_LEAST * count as f64 {
            return Ok(None);
        }
        let (finest_edges, interval_edges) = match adaptive {
            true => {
                let finest = codes.step_edges * f64::from(1 << settings.steps_longer);
                (Some(finest), Some(finest * INTERVAL_STEPS))
            }
            false => (None, None),
        };
        Ok(Some(PlannedMacrocells {
            count,
            hidden: codes.hidden,
            finest_edges,
            interval_edges,
            codes: codes.codes,
        }))
    }

    /// The image that holds the codes.
    pub(super) fn image(&self, gpu: &Gpu) -> PlannedImage {
        let spec = ImageSpec {
            name: "macrocells",
            size: self.codes.size.to_array(),
            format: ImageFormat::R8Unorm,
            stored: false,
        };
        PlannedImage {
            name: spec.name,
            size: spec.size,
            format: spec.format.name(),
            layout: Layout::Plain.name(),
            memory_bytes: Image::memory_bytes(gpu, &spec),
            spec,
            channel: None,
        }
    }
}

/// A channel's macrocells, and what judges them.
struct Channel<'a> {
    /// Of stored values.
    ranges: &'a Macrocells<ValueRange>,
    /// Tells what is hidden.
    judge: Judge,
    /// Whether some voxel is NaN: any cell may then end in nothing.
    holes: bool,
}

/// Steps for a tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tolerance {
    /// Greatest error of a pixel.
    of_pixel: f64,
    /// Smallest voxel edge, world units.
    edge_world: f64,
}

/// Codes of all macrocells.
struct Codes {
    /// See [`crate::twins::macrocells`].
    codes: Macrocells<u8>,
    /// How many show nothing.
    hidden: u64,
    /// Finest step, smallest voxel edges; what codes count from.
    step_edges: f64,
}

/// Codes of channels that are drawn together; of steps where there is a tolerance.
fn codes(channels: &[Channel], tolerance: Option<Tolerance>) -> Codes {
    let size = channels.first().map_or(Size3::new(1, 1, 1), |channel| channel.ranges.size);
    let count = size.x as usize * size.y as usize * size.z as usize;
    let shown: Vec<bool> = (0..count)
        .into_par_iter()
        .map(|at| channels.iter().any(|channel| !channel.judge.hides(channel.ranges.of[at])))
        .collect();
    let mut of: Vec<u8> = vec![CODE_SHOWS; count];
    let mut step_edges = 0.0;
    if let Some(tolerance) = tolerance {
        let steps: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|at| if shown[at] { step_of(channels, at, tolerance) } else { f64::INFINITY })
            .collect();
        let finest = steps.iter().copied().fold(f64::INFINITY, f64::min);
        step_edges = finest.clamp(STEP_EDGES_LEAST, STEP_EDGES_MOST);
        of.par_iter_mut().zip(steps).for_each(|(code, step)| {
            let octaves = (step / step_edges).log2();
            // The nearest power of two: half an octave is added before rays round down.
            let eighths = (octaves + 0.5) * f64::from(CODES_OF_LEVEL);
            *code = CODE_SHOWS + eighths.clamp(0.0, f64::from(CODE_STEP_MAX)) as u8;
        });
    }
    let reach = reach(&shown, size);
    of.par_iter_mut().zip(reach).for_each(|(code, reach)| {
        if reach > 0 {
            *code = reach;
        }
    });
    let hidden = shown.iter().filter(|shown| !**shown).count() as u64;
    Codes { codes: Macrocells { size, of }, hidden, step_edges }
}

/// Longest step, smallest voxel edges, whose error keeps to the tolerance where nothing stands before.
fn step_of(channels: &[Channel], at: usize, tolerance: Tolerance) -> f64 {
    let mut change = Change::default();
    for channel in channels {
        change.add(&Change::of(channel, channel.ranges.of[at]));
    }
    let allowed = tolerance.of_pixel * TOLERANCE_OF_FEATURE;
    let per_edge = tolerance.edge_world;
    // A kink: rate h^2 / 8, no more than half the swing; a jump: half of it.
    let by_rate = (8.0 * allowed / (change.rate * per_edge)).sqrt();
    let by_swing = 2.0 * allowed / (change.swing * per_edge);
    let by_jump = 2.0 * allowed / (change.jump * per_edge);
    by_rate.max(by_swing).min(by_jump)
}

/// How extinction, and extinction times colour, change within a range of values; per world unit, the
/// greatest over all of them.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    /// Per smallest voxel edge along a ray.
    rate: f64,
    /// Greatest less least.
    swing: f64,
    /// Greatest jump.
    jump: f64,
}

impl Change {
    fn add(&mut self, other: &Change) {
        self.rate += other.rate;
        self.swing += other.swing;
        self.jump += other.jump;
    }

    fn of(channel: &Channel, range: ValueRange) -> Change {
        let mut change = Change::default();
        if range.is_empty() {
            return change;
        }
        let Judge { layout, segments, .. } = &channel.judge;
        let windowed = |value: f32| Windowed::of(value, layout, segments).at;
        let ends = [windowed(range.least), windowed(range.greatest)];
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let (mut least, mut greatest) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
        let mut before: Option<[f64; 4]> = None;
        for (segment, [start, end]) in segments_between(segments, low, high) {
            let points = [start, end].map(|at| integrand(segment, at));
            if let Some(before) = before {
                let apart = points[0].value.iter().zip(before).map(|(a, b)| (a - b).abs());
                change.jump = apart.fold(change.jump, f64::max);
            }
            before = Some(points[1].value);
            for point in points {
                for part in 0..4 {
                    least[part] = least[part].min(point.value[part]);
                    greatest[part] = greatest[part].max(point.value[part]);
                    if end > start {
                        change.rate = change.rate.max(point.slope[part].abs() * (high - low));
                    }
                }
            }
        }
        let swing = (0..4).map(|part| greatest[part] - least[part]).fold(0.0, f64::max);
        change.swing = swing;
        if channel.holes {
            let most = greatest.iter().chain(&least).map(|part| part.abs()).fold(0.0, f64::max);
            change.jump = change.jump.max(most);
        }
        if channel.judge.format == VoxelFormat::Rgba8 {
            // Colours may go from one end to the other between two voxels.
            let most = greatest[3].max(0.0);
            change.rate += most;
            change.swing = change.swing.max(most);
        }
        change
    }
}

/// Extinction times rgb, and extinction.
struct Integrand {
    value: [f64; 4],
    slope: [f64; 4],
}

fn integrand(segment: &TransferSegment, at: f64) -> Integrand {
    let (value, slope) = (value_at(segment, at), segment.slope.map(f64::from));
    let (extinction, rise) = (value[3], slope[3]);
    let product = |part: usize| if part < 3 { extinction * value[part] } else { extinction };
    let change = |part: usize| match part {
        3 => rise,
        _ => rise * value[part] + extinction * slope[part],
    };
    Integrand { value: std::array::from_fn(product), slope: std::array::from_fn(change) }
}

/// For each macrocell the distance to the nearest that shows something, in macrocells along the axis on
/// which they are farthest apart, at most [`REACH_MAX`].
fn reach(shown: &[bool], size: Size3) -> Vec<u8> {
    let reach = shown.iter().map(|shown| if *shown { 0 } else { REACH_MAX }).collect();
    let [x, y, z] = size.to_array().map(|edge| edge as usize);
    let strides = [(1, x), (x, y), (x * y, z)];
    strides.into_iter().fold(reach, |reach: Vec<u8>, (stride, edge)| {
        let nearest = |at: usize| {
            let along = at / stride % edge;
            let mut least = reach[at];
            let mut radius = 0;
            while usize::from(least) > radius {
                radius += 1;
                if along >= radius {
                    least = least.min(reach[at - radius * stride].max(radius as u8));
                }
                if along + radius < edge {
                    least = least.min(reach[at + radius * stride].max(radius as u8));
                }
            }
            least
        };
        (0..reach.len()).into_par_iter().map(nearest).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_the_greatest_distance_along_an_axis() {
        let size = Size3::new(20, 7, 9);
        let mut shown = vec![false; 20 * 7 * 9];
        let places = [[3, 2, 8], [12, 6, 1]];
        for [x, y, z] in places {
            shown[size.index(x, y, z)] = true;
        }
        let reach = reach(&shown, size);
        let far = |[x, y, z]: [u32; 3], at: [u32; 3]| {
            let apart = [x.abs_diff(at[0]), y.abs_diff(at[1]), z.abs_diff(at[2])];
            apart.into_iter().max().unwrap_or(0)
        };
        for z in 0..size.z {
            for y in 0..size.y {
                for x in 0..size.x {
                    let nearest = places.iter().map(|at| far([x, y, z], *at)).min();
                    let expected = nearest.expect("two places").min(u32::from(REACH_MAX));
                    assert_eq!(u32::from(reach[size.index(x, y, z)]), expected, "{x} {y} {z}");
                }
            }
        }
    }
}
