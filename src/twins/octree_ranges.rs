//! Value ranges of a channel's nodes: of leaves from bricks, of all others from their children.
//!
//! What is not known has the widest range, so that nothing else needs to know of it: it shows wherever
//! any value would. What the source does not have has the empty range.
//!
//! # Units
//! Stored values. A range holds every value that a sample in the node's box can have at the tree's level:
//! of its voxels and one more on every side, which also makes up for half a voxel of rounding.
//!
//! # Source
//! residency-octree-2023 sections 5.2 and 5.3; there a range has 8 bits, here it is exact.

use crate::twins::octree::Nodes;
use crate::twins::octree_shape::Shape;
use crate::volume::{BRICK_APRON, Size3, ValueRange, Voxel, VoxelFormat, Voxels, with_voxel_type};

/// How a range stands in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// u8, u16 and the alpha of rgba8: least in the low half of a word, greatest in the high one.
    Unsigned,
    /// i16: the same, 32768 higher.
    Signed,
    /// f32: least in one word, greatest in the next.
    Float,
}

impl Coding {
    /// Of a voxel format.
    pub fn of(format: VoxelFormat) -> Coding {
        match format {
            VoxelFormat::U8 | VoxelFormat::U16 | VoxelFormat::Rgba8 => Coding::Unsigned,
            VoxelFormat::I16 => Coding::Signed,
            VoxelFormat::F32 => Coding::Float,
        }
    }

    /// Words of a range.
    pub fn words(self) -> usize {
        if self == Coding::Float { 2 } else { 1 }
    }

    /// The widest range: nothing is known.
    pub fn unknown(self) -> ValueRange {
        match self {
            Coding::Unsigned => ValueRange { least: 0.0, greatest: 65535.0 },
            Coding::Signed => ValueRange { least: -32768.0, greatest: 32767.0 },
            Coding::Float => ValueRange { least: f32::NEG_INFINITY, greatest: f32::INFINITY },
        }
    }
}

/// Least and greatest of the codes of an empty range.
const EMPTY_CODES: (u16, u16) = (u16::MAX, 0);

/// A range as it stands in words; the second is 0 where one is enough.
pub type Codes = [u32; 2];

impl Coding {
    /// Holds `range`, ends between two codes rounded outwards.
    pub fn codes(self, range: ValueRange) -> Codes {
        let moved = if self == Coding::Signed { 32768.0 } else { 0.0 };
        match self {
            // One pattern for each value.
            Coding::Float => [range.least + 0.0, range.greatest + 0.0].map(f32::to_bits),
            _ if range.is_empty() => [u32::from(EMPTY_CODES.0), 0],
            _ => {
                // Rounded before it is moved, which would round to nearest; casts keep within 16 bits.
                let least = u32::from((range.least.floor() + moved) as u16);
                let greatest = u32::from((range.greatest.ceil() + moved) as u16);
                [least | greatest << 16, 0]
            }
        }
    }

    /// The range of some codes.
    pub fn range(self, codes: Codes) -> ValueRange {
        let moved = if self == Coding::Signed { 32768.0 } else { 0.0 };
        match self {
            Coding::Float => {
                ValueRange { least: f32::from_bits(codes[0]), greatest: f32::from_bits(codes[1]) }
            }
            _ => {
                let (least, greatest) = (codes[0] as u16, (codes[0] >> 16) as u16);
                if (least, greatest) == EMPTY_CODES {
                    return ValueRange::EMPTY;
                }
                ValueRange {
                    least: f32::from(least) - moved,
                    greatest: f32::from(greatest) - moved,
                }
            }
        }
    }

    /// Codes of the smallest range that holds both.
    fn union(self, a: Codes, b: Codes) -> Codes {
        const LOW: u32 = 0xffff;
        match self {
            Coding::Float => {
                let union = self.range(a).union(self.range(b));
                [union.least, union.greatest].map(f32::to_bits)
            }
            // Nothing is least of all and greatest of all, too.
            _ => [(a[0] & LOW).min(b[0] & LOW) | (a[0] & !LOW).max(b[0] & !LOW), 0],
        }
    }
}

/// Ranges of one channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ranges {
    /// How they stand in `words`.
    pub coding: Coding,
    /// `[node]` of all trees, one or two each.
    pub words: Vec<u32>,
}

impl Ranges {
    /// Nothing is known of any node.
    pub fn unknown(coding: Coding, nodes: usize) -> Ranges {
        let mut ranges = Ranges { coding, words: vec![0; nodes * coding.words()] };
        ranges.forget();
        ranges
    }

    /// Nothing is known any more: another channel took the place, or the source has changed.
    pub fn forget(&mut self) {
        let codes = self.coding.codes(self.coding.unknown());
        let count = self.coding.words();
        self.words.chunks_exact_mut(count).for_each(|node| node.copy_from_slice(&codes[..count]));
    }

    /// Of a node.
    pub fn get(&self, node: usize) -> ValueRange {
        self.coding.range(self.codes(node))
    }

    /// Makes a node's range hold `range`, ends between two codes rounded outwards; whether it was another.
    pub fn set(&mut self, node: usize, range: ValueRange) -> bool {
        self.put(node, self.coding.codes(range))
    }

    /// As it stands.
    pub fn codes(&self, node: usize) -> Codes {
        match self.coding {
            Coding::Float => [self.words[2 * node], self.words[2 * node + 1]],
            _ => [self.words[node], 0],
        }
    }

    fn put(&mut self, node: usize, codes: Codes) -> bool {
        let changed = self.codes(node) != codes;
        match self.coding {
            Coding::Float => self.words[2 * node..][..2].copy_from_slice(&codes),
            _ => self.words[node] = codes[0],
        }
        changed
    }
}

/// Nodes that an update has looked at, and those that it changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Recomputed.
    pub looked_at: u64,
    /// Of them, got something else.
    pub changed: u64,
}

/// Gives leaves of a level what `of` says, and all nodes above the hull of their children; stops at the
/// first tier in which nothing changes. Says which leaves changed.
pub fn update_ranges(
    shape: &Shape,
    level: usize,
    ranges: &mut Ranges,
    leaves: Nodes,
    of: impl Fn([u32; 3]) -> ValueRange,
    work: &mut Work,
) -> Nodes {
    update_some_ranges(shape, level, ranges, leaves, |leaf| Some(of(leaf)), work)
}

/// The same where some of the leaves keep what they have.
pub fn update_some_ranges(
    shape: &Shape,
    level: usize,
    ranges: &mut Ranges,
    leaves: Nodes,
    of: impl Fn([u32; 3]) -> Option<ValueRange>,
    work: &mut Work,
) -> Nodes {
    let tree = &shape.trees[level];
    let lowest = shape.lowest(tree);
    let mut changed = Nodes::NONE;
    work.looked_at += leaves.count();
    let coding = ranges.coding;
    // Neighbours often have the same.
    let mut last = (ValueRange::EMPTY, coding.codes(ValueRange::EMPTY));
    for [start, y, z] in leaves.rows() {
        let first = tree.number(lowest, [0, y, z]);
        for x in start..leaves.end[0] {
            let Some(range) = of([x, y, z]) else { continue };
            if range != last.0 {
                last = (range, coding.codes(range));
            }
            if ranges.put(first + x as usize, last.1) {
                changed = changed.with([x, y, z]);
                work.changed += 1;
            }
        }
    }
    let mut finer_changed = changed;
    for pair in shape.tiers[tree.tier as usize..].windows(2) {
        let [finer, tier] = pair else { unreachable!("windows of two") };
        if finer_changed.is_empty() {
            break;
        }
        let parents = finer_changed.in_tier(finer, tier);
        finer_changed = Nodes::NONE;
        work.looked_at += parents.count();
        for parent in parents.each() {
            let children = Nodes::NONE.with(parent).in_tier(tier, finer);
            let mut hull = coding.codes(ValueRange::EMPTY);
            for [start, y, z] in children.rows() {
                let first = tree.number(finer, [0, y, z]);
                for x in start..children.end[0] {
                    hull = coding.union(hull, ranges.codes(first + x as usize));
                }
            }
            if ranges.put(tree.number(tier, parent), hull) {
                finer_changed = finer_changed.with(parent);
                work.changed += 1;
            }
        }
    }
    changed
}

/// The range of a box that is not of one value though all that its range speaks of is equal: some of it
/// is NaN, or its colours differ.
#[must_use]
pub fn not_one_value(range: ValueRange) -> ValueRange {
    match range.least == range.greatest {
        true => ValueRange { greatest: range.greatest.next_up(), ..range },
        false => range,
    }
}

/// Ranges of the leaves in a brick whose voxels have arrived: `voxels` of `size`, apron included, for
/// leaves of `edges` voxels; x fastest, then y, then z.
pub fn leaf_ranges(voxels: &Voxels, size: Size3, edges: [u32; 3]) -> Vec<ValueRange> {
    with_voxel_type!(voxels.format(), V => {
        leaf_ranges_of::<V>(V::of(voxels).expect("voxels of their own format"), size, edges)
    })
}

fn leaf_ranges_of<V: Voxel>(voxels: &[V], size: Size3, edges: [u32; 3]) -> Vec<ValueRange> {
    let apron = 2 * BRICK_APRON;
    let stored = size.to_array().map(|edge| edge as usize);
    let payload = size.to_array().map(|edge| edge - apron);
    let leaves: [usize; 3] = std::array::from_fn(|a| payload[a].div_ceil(edges[a]) as usize);
    let span = |axis: usize, leaf: usize| {
        let start = leaf as u32 * edges[axis];
        start as usize..((start + edges[axis]).min(payload[axis]) + apron) as usize
    };
    let values: Vec<f32> = voxels.iter().map(|voxel| voxel.part(V::PARTS - 1) as f32).collect();
    let mut ranges = Vec::with_capacity(leaves.iter().product());
    // Axis by axis, longest runs first: planes, then lines, then voxels.
    let plane_len = stored[0] * stored[1];
    let mut plane = Extremes::of(plane_len);
    let mut line = Extremes::of(stored[0]);
    for z in 0..leaves[2] {
        plane.clear();
        for k in span(2, z) {
            let of = &values[k * plane_len..][..plane_len];
            plane.widen(of, of);
        }
        for y in 0..leaves[1] {
            line.clear();
            for j in span(1, y) {
                let at = j * stored[0]..(j + 1) * stored[0];
                line.widen(&plane.least[at.clone()], &plane.greatest[at]);
            }
            for x in 0..leaves[0] {
                let across = span(0, x);
                let least =
                    line.least[across.clone()].iter().copied().fold(f32::INFINITY, f32::min);
                let greatest =
                    line.greatest[across.clone()].iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let range = ValueRange { least, greatest };
                let alike = || {
                    let of =
                        |i: usize, j: usize, k: usize| voxels[(k * stored[1] + j) * stored[0] + i];
                    let first = of(across.start, span(1, y).start, span(2, z).start);
                    span(2, z)
                        .all(|k| span(1, y).all(|j| across.clone().all(|i| of(i, j, k) == first)))
                };
                ranges.push(if least == greatest && !alike() {
                    not_one_value(range)
                } else {
                    range
                });
            }
        }
    }
    ranges
}

/// Least and greatest values at each place of a plane or line.
struct Extremes {
    least: Vec<f32>,
    greatest: Vec<f32>,
}

impl Extremes {
    fn of(len: usize) -> Extremes {
        Extremes { least: vec![0.0; len], greatest: vec![0.0; len] }
    }

    fn clear(&mut self) {
        self.least.fill(f32::INFINITY);
        self.greatest.fill(f32::NEG_INFINITY);
    }

    /// NaN changes nothing.
    fn widen(&mut self, least: &[f32], greatest: &[f32]) {
        for (place, value) in self.least.iter_mut().zip(least) {
            *place = if *value < *place { *value } else { *place };
        }
        for (place, value) in self.greatest.iter_mut().zip(greatest) {
            *place = if *value > *place { *value } else { *place };
        }
    }
}
