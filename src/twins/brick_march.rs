//! A ray's way through the bricks of a volume; twin of `shaders/common/brick_march.glsl`, but for the
//! papers' order.

use crate::twins::bits::{bits_between, each_bit, samples_taken_of};
use crate::twins::brick_look_up::{Channel, Found, Has, Scene, look_up, substitute};
use crate::twins::cache::Cache;
use crate::twins::classify::{Block, Medium, join_block};
use crate::twins::exponential::attenuate;
use crate::twins::filter::{Along, filtered, filtered_along};
use crate::twins::fixed_point::{Fixed3, fixed_advance, fixed_float, fixed_fraction};
use crate::twins::limits::{
    BLOCK_SAMPLES, ENTRY_ABSENT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_HIDDEN,
};
use crate::twins::march_bricks::Push;
use crate::twins::octree::Here;
use crate::twins::preintegrate::{Content, Point, Span, composite_span};
use crate::twins::ranks::place_of_brick;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_block::{
    MET_ABSENT, MET_CHANNELS_SHIFT, MET_FAILED, MET_PENDING, MET_STATES, RayBlock,
};
use crate::twins::transfer::{TransferSegment, classify};

/// What shapes the march beside the scene.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// A ray goes from level to level as its footprint grows; else it stays in one.
    pub several_levels: bool,
    /// A ray takes a coarser level for a missing brick; else it waits.
    pub substitute: bool,
    /// Rays end early.
    pub early_stop: bool,
    /// As [`crate::twins::ray_march::Settings::preintegrated`].
    pub preintegrated: bool,
}

/// Samples that lie in one brick, and what the channels have there.
struct Run {
    /// Samples that are taken, bit by bit.
    shown: u32,
    /// Those of them that are as the one before, in one box with it.
    alike: u32,
    found: Vec<Found>,
}

/// Runs that are looked up before any of them is sampled.
const RUNS: usize = 4;

/// Takes up to `blocks_left` blocks of samples of one ray in one level; gives the place whose brick is
/// not there, if that stops it.
pub fn march_bricks(
    geometry: &RayGeometry,
    state: &mut RayState,
    partial: &mut RayBlock,
    cache: &mut Cache,
    scene: &Scene,
    settings: &Settings,
    (push, blocks_left): (&Push, &mut u32),
) -> Option<u32> {
    let start = Fixed3 { cell: geometry.start_cell, fraction: geometry.start_fraction };
    let delta = Fixed3 { cell: geometry.delta_cell, fraction: geometry.delta_fraction };
    let step_voxel = fixed_float(delta);
    let level = partial.level as usize;
    let mut missing = None;
    let mut sample_index = partial.sample_index;
    let mut block =
        Block { color: partial.color, depth: partial.depth, transmitted: partial.transmitted };
    while *blocks_left > 0 && state.next_sample < geometry.sample_count && missing.is_none() {
        let anchor = fixed_advance(start, delta, state.next_sample);
        let anchor_fraction = fixed_fraction(anchor.fraction);
        let samples = BLOCK_SAMPLES.min(geometry.sample_count - state.next_sample);
        let at = |steps: f32| -> [f32; 3] {
            std::array::from_fn(|a| anchor_fraction[a] + steps * step_voxel[a])
        };
        let transmitted = attenuate(state.optical_depth).transmitted * block.transmitted;
        let weight = 1 + (transmitted * 255.0) as u32;
        let brick_at = |steps: u32| -> ([i32; 3], [i32; 3]) {
            let position = at(steps as f32);
            let voxel: [i32; 3] =
                std::array::from_fn(|a| anchor.cell[a] + (position[a] + 0.5).floor() as i32);
            let brick = std::array::from_fn(|a| {
                (voxel[a].max(0) / scene.payload[a]).min(scene.levels[level].bricks[a] as i32 - 1)
            });
            (voxel, brick)
        };
        let until = |steps: u32, first: [i32; 3], edge: [i32; 3]| {
            let near = std::array::from_fn(|a| first[a] - anchor.cell[a]);
            steps + samples_until_border(at(steps as f32), step_voxel, near, edge)
        };
        let mut runs: Vec<Run> = Vec::new();
        let mut known = sample_index;
        // With an octree, which samples show something is known before any brick is looked up.
        let mut ahead: Vec<(u32, u32, u32, u32)> = Vec::new();
        let mut last_brick = [-1; 3];
        while let (Some(leaves), true) = (&scene.octree, known < samples) {
            let (voxel, brick) = brick_at(known);
            let Here { shows, one_value, first, edge } = leaves.around(level, voxel);
            let end = until(known, first, edge);
            if shows != 0 {
                if brick != last_brick && ahead.len() == RUNS {
                    break;
                }
                if brick != last_brick {
                    ahead.push((known, 0, 0, 0));
                    last_brick = brick;
                }
                let (_, channels, shown, alike) = ahead.last_mut().expect("a run was begun");
                let sampled =
                    scene.channels.iter().enumerate().fold(0, |sampled, (at, channel)| {
                        sampled
                            | if shows >> at & 1 == 1 {
                                samples_taken_of(channel.sample_every, samples)
                            } else {
                                0
                            }
                    });
                let here = bits_between(known, end.min(samples)) & sampled;
                *channels |= shows;
                *shown |= here;
                *alike |=
                    if scene.closed_form && one_value { here & here.wrapping_sub(1) } else { 0 };
            }
            known = if shows != 0 { end.min(samples) } else { end };
        }
        let mut next = ahead.iter();
        while runs.len() < RUNS {
            let of_octree = next.next();
            let (first, needed) = match (of_octree, &scene.octree) {
                (Some((first, channels, ..)), _) => (*first, *channels),
                (None, None) if known < samples => (known, u32::MAX),
                _ => break,
            };
            let (_, brick) = brick_at(first);
            let look_up = |(number, channel): (usize, &Channel)| {
                if needed >> number & 1 == 0 {
                    Found { has: Has::Nothing, state: ENTRY_HIDDEN, shift: [0; 3] }
                } else if settings.substitute {
                    substitute(cache, scene, channel, (level, brick), push.round, weight)
                } else {
                    look_up(cache, scene, channel, (level, brick), push.round)
                }
            };
            let found: Vec<Found> = scene.channels.iter().enumerate().map(look_up).collect();
            for found in &found {
                partial.met |= match found.state {
                    ENTRY_FAILED => MET_FAILED,
                    ENTRY_ABSENT => MET_ABSENT,
                    _ => 0,
                };
            }
            if found.iter().any(|found| found.state <= ENTRY_EXPECTED) {
                if !settings.substitute {
                    missing = Some(place_of_brick(&scene.levels[level], brick));
                    if scene.octree.is_some() {
                        known = first;
                        partial.met = partial.met & MET_STATES | needed << MET_CHANNELS_SHIFT;
                    }
                    break;
                }
                partial.met |= MET_PENDING;
            }
            let nothing = found.iter().all(|found| matches!(found.has, Has::Nothing));
            let (shown, alike) = match of_octree {
                Some((_, _, shown, alike)) => (*shown, *alike),
                None => {
                    let first_voxel = std::array::from_fn(|a| brick[a] * scene.payload[a]);
                    let begin = known;
                    known = until(known, first_voxel, scene.payload);
                    let shown = match scene.skipping && nothing {
                        true => 0,
                        false => {
                            known = known.min(samples);
                            bits_between(begin, known)
                        }
                    };
                    (shown, 0)
                }
            };
            runs.push(Run { shown, alike, found });
        }
        sample_index = known;
        let texel = |channel: &Channel, found: &Found, origin: [i32; 3], steps: f32| {
            let (corner, within) = cell_in_level(anchor.cell, at(steps), found.shift);
            let corner = std::array::from_fn(|a| origin[a] + corner[a] + 1);
            let [texel] = filtered(&channel.atlas, corner, within, |texel| [texel]);
            texel
        };
        let along = |channel: &Channel, found: &Found, origin: [i32; 3], steps: f32| {
            let (corner, within) = cell_in_level(anchor.cell, at(steps), found.shift);
            let corner = std::array::from_fn(|a| origin[a] + corner[a] + 1);
            let way = std::array::from_fn(|a| 0.5 * step_voxel[a] / (1 << found.shift[a]) as f32);
            filtered_along(&channel.atlas, corner, within, way, |texel| texel)
        };
        for Run { shown, alike, found } in &runs {
            let channels = || scene.channels.iter().zip(found);
            if settings.preintegrated {
                for index in each_bit(*shown) {
                    let points = channels().map(|(channel, found)| {
                        let points = [0.0, 1.0, 2.0].map(|phase| match found.has {
                            Has::Nothing => Point::NONE,
                            Has::Constant(texel) => {
                                Point::new([1.0; 3], Along::still(texel), channel.segments)
                            }
                            Has::Slot { origin } => {
                                let steps = 0.5 * ((2 * index) as f32 + phase) - 0.5;
                                let along = along(channel, found, origin, steps);
                                Point::new([1.0; 3], along, channel.segments)
                            }
                        });
                        (points, channel.segments)
                    });
                    let points: Vec<_> = points.collect();
                    for half in 0..2 {
                        let contents: Vec<Content> = points
                            .iter()
                            .map(|(points, segments)| {
                                let span = Span::between(points[half], points[half + 1]);
                                Content::Span(span, segments)
                            })
                            .collect();
                        composite_span(&mut block, &contents, 0.5 * geometry.step_world);
                    }
                }
                // Neighbours share a point.
                let groups = (shown & !(shown << 1)).count_ones();
                state.samples_taken += 2 * shown.count_ones() + groups;
            } else {
                for index in each_bit(*shown & !*alike) {
                    let mut medium = Medium::new(scene.channels.len() > 1);
                    for (channel, found) in channels() {
                        let classified = || match found.has {
                            Has::Nothing => [0.0; 4],
                            Has::Constant(texel) => classified_or_nothing(channel.segments, texel),
                            Has::Slot { origin } => {
                                let texel = texel(channel, found, origin, index as f32);
                                classified_or_nothing(channel.segments, texel)
                            }
                        };
                        medium.mix_in_every(classified, (index, samples), channel.sample_every);
                    }
                    let steps = 1 + (!(alike >> index >> 1)).trailing_zeros();
                    block.composite(medium.mixed(), steps as f32 * geometry.step_world);
                }
                state.samples_taken += (shown & !alike).count_ones();
            }
        }
        if sample_index >= samples {
            *blocks_left -= 1;
            join_block(state, &block);
            block = Block::EMPTY;
            let skipped = (sample_index / BLOCK_SAMPLES * BLOCK_SAMPLES).max(samples);
            state.next_sample = geometry.sample_count.min(state.next_sample + skipped);
            sample_index = sample_index.saturating_sub(skipped);
            if settings.early_stop && attenuate(state.optical_depth).transmitted < push.early_stop {
                state.next_sample = geometry.sample_count;
                partial.level = scene.levels.len() as u32;
            }
        }
    }
    partial.color = block.color;
    partial.depth = block.depth;
    partial.transmitted = block.transmitted;
    partial.sample_index = if state.next_sample < geometry.sample_count { sample_index } else { 0 };
    missing
}

/// The cell of a level `shift` levels coarser, and the place in it, of a position relative to a cell.
fn cell_in_level(
    anchor_cell: [i32; 3],
    position: [f32; 3],
    shift: [u32; 3],
) -> ([i32; 3], [f32; 3]) {
    let (mut corner, mut within) = ([0; 3], [0.0; 3]);
    for axis in 0..3 {
        let base = anchor_cell[axis] >> shift[axis];
        let place = match shift[axis] {
            0 => position[axis],
            shift => {
                let rest = (anchor_cell[axis] - (base << shift)) as f32;
                ((rest + 0.5) + position[axis]) / (1 << shift) as f32 - 0.5
            }
        };
        let cell = place.floor();
        corner[axis] = base + cell as i32;
        within[axis] = place - cell;
    }
    (corner, within)
}

fn classified_or_nothing(segments: &[TransferSegment], texel: f32) -> [f32; 4] {
    if texel.is_nan() { [0.0; 4] } else { classify(segments, texel) }
}

/// How many samples, this one at `position` included, lie in the box whose first voxel is `first`, to one or so.
pub fn samples_until_border(
    position: [f32; 3],
    step_voxel: [f32; 3],
    first: [i32; 3],
    edge: [i32; 3],
) -> u32 {
    let count = |axis: usize| {
        let step = step_voxel[axis];
        let still = if step == 0.0 { 1.0 } else { 0.0 };
        let ahead = first[axis] + if step > 0.0 { edge[axis] } else { 0 };
        (ahead as f32 - (position[axis] + 0.5)) / (step + still) + still * 1.0e9
    };
    count(0).min(count(1)).min(count(2)).ceil().clamp(1.0, 1.0e9) as u32
}
