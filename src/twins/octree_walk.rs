//! A ray's way through the nodes: runs of samples that share a box, and what is to be done with each.
//!
//! Runs are found block by block, with the positions of `brick_march`: which box a sample lies in depends
//! on its number alone. A box's ranges reach half a voxel beyond it on all sides, so that rounding at its
//! border changes nothing that is seen.
//!
//! # Source
//! residency-octree-2023 algorithm 1, without its descent: see `twins/octree_words.rs`.

use crate::twins::brick_march::samples_until_border;
use crate::twins::fixed_point::{Fixed3, fixed_advance, fixed_float, fixed_fraction};
use crate::twins::limits::BLOCK_SAMPLES;
use crate::twins::octree::{here, node_of_voxel};
use crate::twins::octree_ranges::Ranges;
use crate::twins::octree_resident::Resident;
use crate::twins::octree_shape::Shape;

/// A ray within one level.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Of sample 0, voxels of the level, centre origin.
    pub start: Fixed3,
    /// From one sample to the next.
    pub delta: Fixed3,
    /// How many there are.
    pub samples: u32,
    /// The level that it wants.
    pub level: usize,
}

/// A channel as rays see it.
pub struct Channel<'a> {
    /// Its bricks.
    pub resident: &'a Resident,
    /// Least and greatest level at which it is drawn.
    pub levels: [usize; 2],
}

/// What there is of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Has {
    /// It shows nothing: no brick is needed.
    Nothing,
    /// This value, everywhere in the leaf; only the host knows which.
    OneValue(f32),
    /// A brick of this level: the wanted one, or the finest coarser one that is resident, in which case
    /// the wanted one is wished for.
    Level(usize),
    /// Nothing resident: wished for, and passed over or waited for.
    Missing,
}

/// What becomes of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Nothing shows: crossed.
    Cross,
    /// One value of every channel that shows: no sample is taken, but its depth in closed form.
    OneValue(u32),
    /// Samples are taken, channel by channel.
    Take(Vec<Has>),
}

/// Samples that share a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Number of the first sample.
    pub first: u32,
    /// One past the last.
    pub end: u32,
    /// What becomes of them.
    pub action: Action,
}

/// All runs of a ray, and how many words were read for them.
pub fn walk(shape: &Shape, words: &[u32], channels: &[Channel], ray: &Ray) -> (Vec<Run>, u32) {
    let tree = &shape.trees[ray.level];
    let step_voxel = fixed_float(ray.delta);
    let mut runs = Vec::new();
    let mut reads = 0;
    let mut next = 0;
    while next < ray.samples {
        let anchor_sample = next / BLOCK_SAMPLES * BLOCK_SAMPLES;
        let anchor = fixed_advance(ray.start, ray.delta, anchor_sample);
        let fraction = fixed_fraction(anchor.fraction);
        let samples = BLOCK_SAMPLES.min(ray.samples - anchor_sample);
        let mut known = next - anchor_sample;
        while known < samples {
            let steps = known as f32;
            let position: [f32; 3] = std::array::from_fn(|a| fraction[a] + steps * step_voxel[a]);
            let voxel = std::array::from_fn(|axis| {
                anchor.cell[axis] + (position[axis] + 0.5).floor() as i32
            });
            let here = here(shape.leaf, &shape.tiers, tree, words, voxel);
            reads += 1;
            let relative = |first: [i32; 3]| std::array::from_fn(|a| first[a] - anchor.cell[a]);
            let in_box =
                samples_until_border(position, step_voxel, relative(here.first), here.edge);
            let (count, action) = if here.shows == 0 {
                (in_box, Action::Cross)
            } else if here.one_value {
                (in_box, Action::OneValue(here.shows))
            } else {
                let payload = shape.payload.map(|edge| edge as i32);
                let brick = brick_of_voxel(shape, ray.level, voxel);
                let first = std::array::from_fn(|axis| brick[axis] as i32 * payload[axis]);
                let in_brick = samples_until_border(position, step_voxel, relative(first), payload);
                let has =
                    channels.iter().enumerate().map(|(at, channel)| match here.shows >> at & 1 {
                        0 => Has::Nothing,
                        _ => has(shape, channel, ray.level, brick),
                    });
                (in_box.min(in_brick), Action::Take(has.collect()))
            };
            // Only where nothing shows does a run go beyond its block: what is taken stays in it.
            let end = match action {
                Action::Take(_) => (known + count).min(samples),
                _ => known + count,
            };
            let first = anchor_sample + known;
            runs.push(Run { first, end: (anchor_sample + end).min(ray.samples), action });
            known = end;
        }
        next = anchor_sample + known;
    }
    (runs, reads)
}

/// What all channels have at a voxel, to rays of `level`; `ranges` are theirs.
pub fn at_voxel(
    shape: &Shape,
    words: &[u32],
    channels: &[Channel],
    ranges: &[&Ranges],
    (level, voxel): (usize, [i32; 3]),
) -> Vec<Has> {
    let tree = &shape.trees[level];
    let here = here(shape.leaf, &shape.tiers, tree, words, voxel);
    let leaf = node_of_voxel(shape.leaf, tree, shape.lowest(tree), voxel);
    let of_channel = |(at, (channel, ranges)): (usize, (&Channel, &&Ranges))| {
        if here.shows >> at & 1 == 0 {
            return Has::Nothing;
        }
        let drawn = level.clamp(channel.levels[0], channel.levels[1]);
        let range = ranges.get(shape.node_around(drawn, tree.tier as usize, leaf));
        match range.least == range.greatest {
            true => Has::OneValue(range.least),
            false => has(shape, channel, level, brick_of_voxel(shape, level, voxel)),
        }
    };
    channels.iter().zip(ranges).enumerate().map(of_channel).collect()
}

/// The brick of a level around a voxel of it.
fn brick_of_voxel(shape: &Shape, level: usize, voxel: [i32; 3]) -> [u32; 3] {
    let bricks = shape.bricks(level);
    std::array::from_fn(|a| (voxel[a].max(0) as u32 / shape.payload[a]).min(bricks[a] - 1))
}

/// What a channel has around a brick of the ray's level.
fn has(shape: &Shape, channel: &Channel, level: usize, brick: [u32; 3]) -> Has {
    let wanted = level.clamp(channel.levels[0], channel.levels[1]);
    let [from, to] = [level, wanted].map(|level| shape.trees[level].halvings);
    // Where it is drawn finer than the ray's level, its own bricks are looked up sample by sample.
    let around: [u32; 3] = std::array::from_fn(|axis| match to[axis] >= from[axis] {
        true => brick[axis] >> (to[axis] - from[axis]),
        false => brick[axis] << (from[axis] - to[axis]),
    });
    channel.resident.best(wanted, around).map_or(Has::Missing, Has::Level)
}
