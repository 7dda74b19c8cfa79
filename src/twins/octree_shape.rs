//! Which nodes a residency octree has: from the levels of a volume, its bricks, the leaf and the fan-out.
//!
//! # Invariants
//! - The nodes of one tier part those of the next coarser one; the last tier is one node.
//! - A leaf of a level's tree lies in one brick of that level, and its edges are whole voxels of it.
//! - Every level has a tier whose nodes are its bricks, where the fan-out is 2.

use crate::twins::octree::{LevelLeaves, Nodes, RISE_BITS, RISE_LEAVES, Tier, Tree};
use crate::volume::{Levels, Size3};

/// What is free to choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// Least voxels along each edge of a leaf.
    pub leaf: [u32; 3],
    /// Children of a node along each axis, at most: 2 or 4.
    pub fan_out: u32,
    /// Nodes at most; leaves grow up to bricks to keep to it.
    pub nodes_max: u64,
}

/// The nodes of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Voxels of a level along the edges of its leaves, where level and tier halve alike.
    pub leaf: [u32; 3],
    /// Voxels of a brick along each axis.
    pub payload: [u32; 3],
    /// Leaves of level 0 first.
    pub tiers: Vec<Tier>,
    /// One for each level.
    pub trees: Vec<Tree>,
    /// Voxels of each level.
    pub sizes: Vec<[u32; 3]>,
    /// Leaves of level 0 along the edges of its bricks, as a power of two.
    pub brick_shift: [u32; 3],
}

/// Levels that a word of residency has bits for.
pub const LEVELS_MAX: usize = 32;

impl Shape {
    /// Nodes of a volume in bricks of `payload` voxels; nothing where numbers of nodes or levels do not
    /// fit 32 bits.
    ///
    /// # Panics
    /// When the fan-out is neither 2 nor 4, or a leaf has no voxel: our own bug.
    pub fn new(levels: &Levels, payload: Size3, wanted: &Wanted) -> Option<Shape> {
        assert!([2, 4].contains(&wanted.fan_out), "fan-out {}", wanted.fan_out);
        assert!(wanted.leaf.iter().all(|edge| *edge > 0), "leaves without voxels");
        if levels.count() > LEVELS_MAX {
            return None;
        }
        let payload = payload.to_array();
        let mut brick_shift = [0, 1, 2].map(|axis| {
            let edge = payload[axis];
            let halved =
                |times: &u32| edge.is_multiple_of(1 << times) && edge >> times >= wanted.leaf[axis];
            (1..31).take_while(halved).last().unwrap_or(0)
        });
        let halvings: Vec<[u32; 3]> =
            levels.iter().map(|level| level.scale.map(u32::ilog2)).collect();
        let size = levels.get(0)?.size.to_array();
        loop {
            let leaf = std::array::from_fn(|axis| payload[axis] >> brick_shift[axis]);
            let shifts = shifts(brick_shift, &halvings, wanted.fan_out.ilog2());
            let (tiers, trees, nodes) = numbered(size, leaf, &shifts, &halvings);
            let fits = nodes <= wanted.nodes_max;
            if !fits && brick_shift != [0; 3] {
                // Without the finest tier, counted from the next.
                brick_shift = std::array::from_fn(|axis| brick_shift[axis] - shifts[1][axis]);
                continue;
            }
            if nodes > u64::from(u32::MAX) {
                return None;
            }
            let sizes = levels.iter().map(|level| level.size.to_array()).collect();
            return Some(Shape { leaf, payload, tiers, trees, sizes, brick_shift });
        }
    }

    /// Nodes of all trees.
    pub fn nodes(&self) -> usize {
        let last = self.trees.last().zip(self.tiers.last());
        last.map_or(0, |(tree, root)| tree.number(root, [0; 3]) + 1)
    }

    /// Leaves of all trees.
    pub fn words(&self) -> usize {
        let last = self.trees.last();
        last.map_or(0, |tree| {
            tree.first_word as usize + Nodes::all(self.lowest(tree)).count() as usize
        })
    }

    /// The tier of a tree's leaves.
    pub fn lowest(&self, tree: &Tree) -> &Tier {
        &self.tiers[tree.tier as usize]
    }

    /// Number of what is known, for the level `drawn`, of a node of the tier `index`: of the node around
    /// it where that level's leaves are larger.
    pub fn node_around(&self, drawn: usize, index: usize, node: [u32; 3]) -> usize {
        let tree = &self.trees[drawn];
        let tier = &self.tiers[index.max(tree.tier as usize)];
        tree.number(tier, self.tiers[index].ancestor(tier, node))
    }

    /// Voxels along the edges of a level's leaves.
    pub fn leaf_edges(&self, level: usize) -> [u32; 3] {
        let tree = &self.trees[level];
        let shift = self.lowest(tree).shift;
        std::array::from_fn(|axis| self.leaf[axis] << (shift[axis] - tree.halvings[axis]))
    }

    /// The leaves of every level, as rays find them.
    pub fn level_leaves(&self) -> Vec<LevelLeaves> {
        let of_tree = |tree: &Tree| {
            let lowest = self.lowest(tree);
            let rises = |axis: usize| {
                let tiers = &self.tiers[tree.tier as usize..=(tree.tier + tree.rise_max) as usize];
                let doubled = tiers.iter().map(|tier| tier.shift[axis] - lowest.shift[axis]);
                doubled
                    .enumerate()
                    .fold(0, |all, (rise, by)| all | by << (RISE_BITS as usize * rise))
            };
            LevelLeaves {
                leaves: lowest.nodes,
                first_word: tree.first_word,
                shift: std::array::from_fn(|axis| lowest.shift[axis] - tree.halvings[axis]),
                rises: std::array::from_fn(rises),
                brick_shift: std::array::from_fn(|axis| {
                    self.brick_shift[axis] + tree.halvings[axis] - lowest.shift[axis]
                }),
                ..LevelLeaves::default()
            }
        };
        self.trees.iter().map(of_tree).collect()
    }

    /// Bricks of a level along each axis.
    pub fn bricks(&self, level: usize) -> [u32; 3] {
        let size = self.sizes[level];
        std::array::from_fn(|axis| size[axis].div_ceil(self.payload[axis]))
    }

    /// Leaves of a level along the edges of its bricks, as a power of two.
    pub fn leaf_shift(&self, level: usize) -> [u32; 3] {
        let tree = &self.trees[level];
        let lowest = self.lowest(tree);
        std::array::from_fn(|a| self.brick_shift[a] + tree.halvings[a] - lowest.shift[a])
    }

    /// The leaves of a level that one of its bricks holds.
    pub fn leaves_of_brick(&self, level: usize, brick: [u32; 3]) -> Nodes {
        self.leaves_of_bricks(level, Nodes::NONE.with(brick))
    }

    /// The leaves of a level that a box of its bricks holds.
    pub fn leaves_of_bricks(&self, level: usize, bricks: Nodes) -> Nodes {
        let (shift, lowest) = (self.leaf_shift(level), self.lowest(&self.trees[level]));
        Nodes {
            start: std::array::from_fn(|a| bricks.start[a] << shift[a]),
            end: std::array::from_fn(|a| (bricks.end[a] << shift[a]).min(lowest.nodes[a])),
        }
    }
}

/// Doublings of a leaf's edge in every tier, finest first: bricks of level 0 halved down to leaves, then
/// the bricks of coarser levels.
fn shifts(brick: [u32; 3], halvings: &[[u32; 3]], step: u32) -> Vec<[u32; 3]> {
    let mut shifts = vec![brick];
    let mut finer = brick;
    while finer != [0; 3] {
        finer = finer.map(|shift| shift.saturating_sub(step));
        shifts.insert(0, finer);
    }
    let last = halvings.len() - 1;
    for (level, halvings) in halvings.iter().enumerate().skip(1) {
        let of_level: [u32; 3] = std::array::from_fn(|axis| brick[axis] + halvings[axis]);
        // Where a brick is hardly larger than a leaf, a level may need a tier of its own.
        let within = |shift: &[u32; 3]| {
            (0..3).all(|axis| (halvings[axis]..=of_level[axis]).contains(&shift[axis]))
        };
        let in_turn = (level as u32).is_multiple_of(step);
        if in_turn || level == last || !shifts.iter().any(within) {
            shifts.push(of_level);
        }
    }
    shifts
}

fn numbered(
    size: [u32; 3],
    leaf: [u32; 3],
    shifts: &[[u32; 3]],
    halvings: &[[u32; 3]],
) -> (Vec<Tier>, Vec<Tree>, u64) {
    let mut nodes = 0u64;
    let mut firsts = Vec::new();
    let tiers: Vec<Tier> = shifts
        .iter()
        .map(|shift| {
            let edge = |axis: usize| u64::from(leaf[axis]) << shift[axis];
            let count = |axis: usize| u64::from(size[axis]).div_ceil(edge(axis)) as u32;
            let tier = Tier {
                nodes: std::array::from_fn(count),
                first: nodes as u32,
                shift: *shift,
                unused_0: 0,
            };
            firsts.push(nodes);
            nodes += Nodes::all(&tier).count();
            tier
        })
        .collect();
    let of_tiers = nodes;
    let (mut begins, mut words) = (0u64, 0u64);
    let tree = |halvings: &[u32; 3]| {
        let holds = |tier: &Tier| (0..3).all(|axis| tier.shift[axis] >= halvings[axis]);
        let lowest = tiers.iter().position(holds).unwrap_or(tiers.len() - 1);
        let narrow = |tier: &&Tier| {
            let low = tiers[lowest].shift;
            (0..3).all(|axis| 1u64 << (tier.shift[axis] - low[axis]) <= u64::from(RISE_LEAVES))
        };
        let rise_max = tiers[lowest..].iter().take_while(narrow).count() as u32 - 1;
        // Trees begin where the one before ends, which is never below the tiers that they lack.
        let tree = Tree {
            halvings: *halvings,
            tier: lowest as u32,
            first_node: begins.wrapping_sub(firsts[lowest]) as u32,
            first_word: words as u32,
            rise_max,
            unused_0: 0,
        };
        begins += of_tiers - firsts[lowest];
        words += Nodes::all(&tiers[lowest]).count();
        tree
    };
    let trees = halvings.iter().map(tree).collect();
    (tiers, trees, begins)
}
