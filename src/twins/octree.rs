//! The residency octree as rays see it: boxes of a volume in tiers of nodes, a tree for each level, and
//! one small word for each leaf that says which channels show something in the box around. The last part,
//! from [`LevelLeaves`] on, is the twin of `shaders/common/octree.glsl`.
//!
//! A node is a box in space, whatever the level; what is known of it, is known for one level: means of
//! a coarser level reach beyond the voxels that they stand for, so that no level's range bounds another's.
//!
//! # Units
//! Voxels of a level count from its corner; a sample lies in the box that holds its voxel.
//!
//! # Source
//! residency-octree-2023 sections 3, 5.2 and 7 (full, pointerless); docs/OCTREE.md says where we depart.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

/// Nodes of one size.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Tier {
    /// Nodes along each axis.
    pub nodes: [u32; 3],
    /// Nodes of all finer tiers.
    pub first: u32,
    /// So often is a leaf's edge doubled, along each axis.
    pub shift: [u32; 3],
    /// Nothing.
    pub unused_0: u32,
}

/// What is known for one level: its leaves lie in the first tier whose nodes are no smaller than a leaf in
/// the level's own voxels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Tree {
    /// Halvings of level 0 that lead to the level, along each axis.
    pub halvings: [u32; 3],
    /// The tier of its leaves.
    pub tier: u32,
    /// A node's number, less its number among the nodes of all tiers.
    pub first_node: u32,
    /// Its first leaf's word.
    pub first_word: u32,
    /// The most that a word of it rises.
    pub rise_max: u32,
    /// Nothing.
    pub unused_0: u32,
}

/// Bits of a word, one for each channel: it shows something in the box.
pub const SHOWS: u32 = (1 << CHANNELS_MAX) - 1;
/// Bit of a word: each channel that shows has one value in the box.
pub const ONE_VALUE: u32 = 1 << CHANNELS_MAX;
/// From this bit on: how many tiers above its leaf the box of a word is.
pub const RISE_SHIFT: u32 = CHANNELS_MAX + 1;
/// Channels that a word of 32 bits has room for.
pub const CHANNELS_MAX: u32 = 28;
/// A word's box is at most so many leaves wide: what changes beside a leaf reaches no farther.
pub const RISE_LEAVES: u32 = 32;
/// Instead of a node's word: its children's differ.
pub const DIFFERS: u32 = u32::MAX;

/// Bits that a leaf's word takes on the device: the rise and one value take four.
pub fn bits_of_word(channels: u32) -> u32 {
    [8, 16, 32].into_iter().find(|bits| channels + 4 <= *bits).unwrap_or(32)
}

/// A word in 8, 16 or 32 bits: as it stands, without the channels that it has no room for.
pub fn packed(word: u32, bits: u32) -> u32 {
    (word & SHOWS) | word >> CHANNELS_MAX << (bits - 4)
}

/// The word that was packed.
pub fn unpacked(packed: u32, bits: u32) -> u32 {
    let channels = bits - 4;
    (packed & ((1 << channels) - 1)) | packed >> channels << CHANNELS_MAX
}

/// A half-open box of nodes of one tier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Nodes {
    /// First node along each axis.
    pub start: [u32; 3],
    /// One past the last node along each axis.
    pub end: [u32; 3],
}

impl Nodes {
    /// No node.
    pub const NONE: Nodes = Nodes { start: [u32::MAX; 3], end: [0; 3] };

    /// Every node of a tier.
    pub fn all(tier: &Tier) -> Nodes {
        Nodes { start: [0; 3], end: tier.nodes }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.start[axis] >= self.end[axis])
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        let edge = |axis: usize| u64::from(self.end[axis].saturating_sub(self.start[axis]));
        edge(0) * edge(1) * edge(2)
    }

    /// The smallest box with this node too.
    #[must_use]
    pub fn with(self, node: [u32; 3]) -> Nodes {
        Nodes {
            start: std::array::from_fn(|axis| self.start[axis].min(node[axis])),
            end: std::array::from_fn(|axis| self.end[axis].max(node[axis] + 1)),
        }
    }

    /// The smallest box that holds both.
    #[must_use]
    pub fn joined(self, other: Nodes) -> Nodes {
        Nodes {
            start: std::array::from_fn(|axis| self.start[axis].min(other.start[axis])),
            end: std::array::from_fn(|axis| self.end[axis].max(other.end[axis])),
        }
    }

    /// Those of both.
    #[must_use]
    pub fn common(self, other: Nodes) -> Nodes {
        Nodes {
            start: std::array::from_fn(|axis| self.start[axis].max(other.start[axis])),
            end: std::array::from_fn(|axis| self.end[axis].min(other.end[axis])),
        }
    }

    /// Nodes of the tier `to` that share space with these of the tier `from`.
    #[must_use]
    pub fn in_tier(&self, from: &Tier, to: &Tier) -> Nodes {
        if self.is_empty() {
            return Nodes::NONE;
        }
        let moved = |at: u32, axis: usize| {
            let (from, to) = (from.shift[axis], to.shift[axis]);
            if to >= from { at >> (to - from) } else { at << (from - to) }
        };
        let end = |axis: usize| match to.shift[axis] >= from.shift[axis] {
            true => moved(self.end[axis] - 1, axis) + 1,
            false => moved(self.end[axis], axis).min(to.nodes[axis]),
        };
        Nodes {
            start: std::array::from_fn(|axis| moved(self.start[axis], axis)),
            end: std::array::from_fn(end),
        }
    }

    /// The first of every row along x.
    pub fn rows(self) -> impl Iterator<Item = [u32; 3]> {
        let (x, ys) = (self.start[0], self.start[1]..self.end[1]);
        (self.start[2]..self.end[2]).flat_map(move |z| ys.clone().map(move |y| [x, y, z]))
    }

    /// Each of them, x fastest, then y, then z.
    pub fn each(self) -> impl Iterator<Item = [u32; 3]> {
        let along = |axis: usize| -> Range<u32> { self.start[axis]..self.end[axis] };
        let (xs, ys) = (along(0), along(1));
        along(2).flat_map(move |z| {
            let xs = xs.clone();
            ys.clone().flat_map(move |y| xs.clone().map(move |x| [x, y, z]))
        })
    }
}

impl Tier {
    /// A node's number within the tier.
    pub fn index(&self, [x, y, z]: [u32; 3]) -> u32 {
        (z * self.nodes[1] + y) * self.nodes[0] + x
    }

    /// The node of a coarser tier around a node.
    pub fn ancestor(&self, tier: &Tier, node: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|axis| node[axis] >> (tier.shift[axis] - self.shift[axis]))
    }
}

impl Tree {
    /// A node's number among all that is known for all levels.
    pub fn number(&self, tier: &Tier, node: [u32; 3]) -> usize {
        self.first_node.wrapping_add(tier.first + tier.index(node)) as usize
    }
}

/// The node of a tier around a voxel of the tree's level; voxels outside count to the nearest node.
pub fn node_of_voxel(leaf: [u32; 3], tree: &Tree, tier: &Tier, voxel: [i32; 3]) -> [u32; 3] {
    std::array::from_fn(|axis| {
        let leaves = voxel[axis].max(0) as u32 / leaf[axis];
        (leaves >> (tier.shift[axis] - tree.halvings[axis])).min(tier.nodes[axis] - 1)
    })
}

/// First voxel of a node and voxels along its edges, in voxels of the tree's level; at the far faces a
/// node goes on outside.
pub fn box_of_node(
    leaf: [u32; 3],
    tree: &Tree,
    tier: &Tier,
    node: [u32; 3],
) -> ([i32; 3], [i32; 3]) {
    let edge = std::array::from_fn(|a| (leaf[a] << (tier.shift[a] - tree.halvings[a])) as i32);
    (std::array::from_fn(|a| node[a] as i32 * edge[a]), edge)
}

/// What a ray learns at a voxel: of how large a box, and what shows there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Here {
    /// Bits of the channels that show something.
    pub shows: u32,
    /// Whether each of them has one value.
    pub one_value: bool,
    /// First voxel of the box, of the tree's level.
    pub first: [i32; 3],
    /// Voxels along its edges.
    pub edge: [i32; 3],
}

/// What is known around a voxel of the tree's level: one word is read, whatever the depth.
pub fn here(leaf: [u32; 3], tiers: &[Tier], tree: &Tree, words: &[u32], voxel: [i32; 3]) -> Here {
    let lowest = &tiers[tree.tier as usize];
    let node = node_of_voxel(leaf, tree, lowest, voxel);
    let word = words[(tree.first_word + lowest.index(node)) as usize];
    let tier = &tiers[(tree.tier + (word >> RISE_SHIFT)) as usize];
    let (first, edge) = box_of_node(leaf, tree, tier, lowest.ancestor(tier, node));
    Here { shows: word & SHOWS, one_value: word & ONE_VALUE != 0, first, edge }
}

/// The leaves of one level, as rays find them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct LevelLeaves {
    /// Leaves along each axis.
    pub leaves: [u32; 3],
    /// Its first leaf's word.
    pub first_word: u32,
    /// So often is `leaf` doubled along the edges of the level's leaves.
    pub shift: [u32; 3],
    /// Nothing.
    pub unused_0: u32,
    /// From bit 3 * rise on: how often the edge of a leaf is doubled in the box of such a word.
    pub rises: [u32; 3],
    /// Nothing.
    pub unused_1: u32,
    /// How often it is doubled in a brick.
    pub brick_shift: [u32; 3],
    /// Nothing.
    pub unused_2: u32,
}

/// Bits of a rise in [`LevelLeaves::rises`]: boxes are at most [`RISE_LEAVES`] leaves wide.
pub const RISE_BITS: u32 = 3;

/// Leaves as one view's rays find them.
#[derive(Clone, Copy)]
pub struct Leaves<'a> {
    /// Voxels along the edges of a leaf of level 0.
    pub leaf: [u32; 3],
    /// Of each level.
    pub levels: &'a [LevelLeaves],
    /// Words, packed into `bits` each.
    pub words: &'a [u32],
    /// 8, 16 or 32.
    pub bits: u32,
}

impl Leaves<'_> {
    /// Which channels show something around a voxel of a level, and in how large a box that is all; where
    /// some does, in one brick.
    pub fn around(&self, level: usize, voxel: [i32; 3]) -> Here {
        let of_level = &self.levels[level];
        let edge: [u32; 3] = std::array::from_fn(|a| self.leaf[a] << of_level.shift[a]);
        let leaf: [u32; 3] =
            std::array::from_fn(|a| (voxel[a].max(0) as u32 / edge[a]).min(of_level.leaves[a] - 1));
        let [x, y, z] = leaf;
        let index = of_level.first_word + (z * of_level.leaves[1] + y) * of_level.leaves[0] + x;
        let bit = index * self.bits;
        let packed = self.words[(bit / 32) as usize] >> (bit % 32);
        let packed = if self.bits < 32 { packed & ((1 << self.bits) - 1) } else { packed };
        let word = unpacked(packed, self.bits);
        let shows = word & SHOWS;
        let rise = word >> RISE_SHIFT;
        let shift: [u32; 3] = std::array::from_fn(|axis| {
            let risen = of_level.rises[axis] >> (RISE_BITS * rise) & 7;
            if shows == 0 { risen } else { risen.min(of_level.brick_shift[axis]) }
        });
        let first = |axis: usize| (leaf[axis] >> shift[axis] << shift[axis]) * edge[axis];
        Here {
            shows,
            one_value: word & ONE_VALUE != 0,
            first: std::array::from_fn(|axis| first(axis) as i32),
            edge: std::array::from_fn(|axis| (edge[axis] << shift[axis]) as i32),
        }
    }
}
