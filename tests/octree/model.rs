//! The octree's rules written once more, naively: every node is computed from all leaves, every place from
//! all resident bricks, by boxes of level-0 voxels; no tree, no updates.

use ashfall::twins::octree::{DIFFERS, ONE_VALUE, RISE_LEAVES, RISE_SHIFT, Tier};
use ashfall::twins::octree_ranges::not_one_value;
use ashfall::volume::{ValueRange, VoxelFormat};

use crate::state::{Channel, Known, State, brick_range, index, shows};
use crate::world::World;

/// A half-open box of level-0 voxels.
#[derive(Clone, Copy, Debug)]
struct Box3 {
    start: [u64; 3],
    end: [u64; 3],
}

impl Box3 {
    fn holds(&self, other: &Box3) -> bool {
        (0..3).all(|a| self.start[a] <= other.start[a] && self.end[a] >= other.end[a])
    }

    fn meets(&self, other: &Box3) -> bool {
        (0..3).all(|a| self.start[a] < other.end[a] && other.start[a] < self.end[a])
    }
}

fn box_of(at: [u32; 3], edge: [u64; 3]) -> Box3 {
    Box3 {
        start: std::array::from_fn(|a| u64::from(at[a]) * edge[a]),
        end: std::array::from_fn(|a| (u64::from(at[a]) + 1) * edge[a]),
    }
}

fn all(count: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
    (0..count[2])
        .flat_map(move |z| (0..count[1]).flat_map(move |y| (0..count[0]).map(move |x| [x, y, z])))
}

struct Model<'a> {
    world: &'a World,
    state: &'a State,
}

impl Model<'_> {
    fn node(&self, tier: &Tier, node: [u32; 3]) -> Box3 {
        let leaf = self.state.shape.leaf;
        box_of(node, std::array::from_fn(|a| u64::from(leaf[a]) << tier.shift[a]))
    }

    fn scale(&self, level: usize) -> [u64; 3] {
        self.world.plan.levels().get(level as u8).expect("a level").scale.map(u64::from)
    }

    fn brick(&self, level: usize, brick: [u32; 3]) -> Box3 {
        let (payload, scale) = (self.world.plan.payload, self.scale(level));
        box_of(brick, std::array::from_fn(|a| u64::from(payload[a]) * scale[a]))
    }

    /// What is known of a leaf of a level: of its voxels and one more on every side, or of its brick.
    fn leaf(&self, channel: &Channel, level: usize, space: &Box3) -> ValueRange {
        let shape = &self.state.shape;
        let brick = all(shape.bricks(level))
            .find(|brick| self.brick(level, *brick).holds(space))
            .expect("a leaf lies in one brick");
        let range = match channel.bricks[level][index(shape, level, brick)].0 {
            Known::Nothing => return channel.ranges.coding.unknown(),
            Known::Range => brick_range(self.world, channel.source, level, brick),
            Known::Leaves => {
                let of = &self.world.sources[channel.source][level];
                let scale = self.scale(level);
                let start = std::array::from_fn(|a| (space.start[a] / scale[a]) as i64 - 1);
                let end = std::array::from_fn(|a| {
                    ((space.end[a] / scale[a]) as i64).min(of.size[a].into()) + 1
                });
                let (range, equal) = of.range(start, end);
                if equal { range } else { not_one_value(range) }
            }
        };
        match self.world.plan.format {
            VoxelFormat::F32 => range,
            _ => ValueRange { least: range.least.floor(), greatest: range.greatest.ceil() },
        }
    }

    /// Channels that show in a box, and whether all of it has one value each.
    fn word(&self, tier: &Tier, node: [u32; 3], rays: usize, ranges: &[Vec<Vec<Leaf>>]) -> u32 {
        let space = self.node(tier, node);
        let (mut shown, mut one) = (0, true);
        for (at, channel) in self.state.channels.iter().enumerate() {
            let levels = self.world.plan.channels[at];
            let last = self.state.shape.trees.len() - 1;
            let level = rays.clamp(levels[0].min(last), levels[1].min(last));
            let hull = hull(&ranges[at][level], &space);
            if !hull.is_empty() && shows(&channel.intervals, hull) {
                shown |= 1 << at;
                one &= hull.least == hull.greatest;
            }
        }
        if shown != 0 && one { shown | ONE_VALUE } else { shown }
    }
}

type Leaf = (Box3, ValueRange);

/// Of all leaves that share space with a box.
fn hull(leaves: &[Leaf], space: &Box3) -> ValueRange {
    let met = leaves.iter().filter(|(leaf, _)| leaf.meets(space));
    met.fold(ValueRange::EMPTY, |hull, (_, range)| hull.union(*range))
}

/// What differs from the rules, or nothing.
pub fn differs(world: &World, state: &State) -> Result<(), String> {
    let model = Model { world, state };
    let shape = &state.shape;
    let leaves_of = |channel: &Channel, level: usize| -> Vec<Leaf> {
        let lowest = shape.lowest(&shape.trees[level]);
        let leaf = |node| {
            let space = model.node(lowest, node);
            (space, model.leaf(channel, level, &space))
        };
        all(lowest.nodes).map(leaf).collect()
    };
    let levels = 0..shape.trees.len();
    let of_channel =
        |channel: &Channel| levels.clone().map(|level| leaves_of(channel, level)).collect();
    let ranges: Vec<Vec<Vec<Leaf>>> = state.channels.iter().map(of_channel).collect();
    for (at, channel) in state.channels.iter().enumerate() {
        for (level, tree) in shape.trees.iter().enumerate() {
            for tier in &shape.tiers[tree.tier as usize..] {
                for node in all(tier.nodes) {
                    let wanted = hull(&ranges[at][level], &model.node(tier, node));
                    let got = channel.ranges.get(tree.number(tier, node));
                    if got != wanted {
                        return Err(format!(
                            "range of node {node:?} of {tier:?}, channel {at}, level {level}: {got:?} for {wanted:?}"
                        ));
                    }
                }
            }
        }
    }
    for (level, tree) in shape.trees.iter().enumerate() {
        let lowest = shape.lowest(tree);
        let words: Vec<(Box3, u32)> = all(lowest.nodes)
            .map(|leaf| (model.node(lowest, leaf), model.word(lowest, leaf, level, &ranges)))
            .collect();
        for (index, leaf) in all(lowest.nodes).enumerate() {
            let (space, word) = words[index];
            let mut rise = 0;
            for (above, tier) in shape.tiers[tree.tier as usize..].iter().enumerate().skip(1) {
                let doublings = |axis: usize| tier.shift[axis] - lowest.shift[axis];
                if (0..3).any(|axis| 1u64 << doublings(axis) > RISE_LEAVES.into()) {
                    break;
                }
                let around = std::array::from_fn(|axis| leaf[axis] >> doublings(axis));
                let larger = model.node(tier, around);
                assert!(larger.holds(&space), "nodes are nested");
                let same = words.iter().all(|(other, its)| !larger.meets(other) || *its == word);
                let whole = model.word(tier, around, level, &ranges);
                if !same || (word & ONE_VALUE != 0 && whole != word) {
                    break;
                }
                rise = above as u32;
            }
            let wanted = word | rise << RISE_SHIFT;
            let got = state.words.of_leaf[tree.first_word as usize + index];
            if got != wanted {
                return Err(format!(
                    "word of leaf {leaf:?}, level {level}: {got:x} for {wanted:x}"
                ));
            }
            if state.words.of_node[tree.number(lowest, leaf)] == DIFFERS {
                return Err(format!("leaf {leaf:?} of level {level} differs from itself"));
            }
        }
    }
    for (at, channel) in state.channels.iter().enumerate() {
        resident(&model, channel).map_err(|why| format!("channel {at}: {why}"))?;
    }
    Ok(())
}

fn resident(model: &Model, channel: &Channel) -> Result<(), String> {
    let shape = &model.state.shape;
    let mut there: Vec<(usize, Box3)> = Vec::new();
    for level in 0..shape.trees.len() {
        for brick in all(shape.bricks(level)) {
            if channel.bricks[level][index(shape, level, brick)].1 {
                there.push((level, model.brick(level, brick)));
            }
        }
    }
    let mut place = 0;
    for level in 0..shape.trees.len() {
        for brick in all(shape.bricks(level)) {
            let space = model.brick(level, brick);
            let met = there.iter().filter(|(_, other)| other.meets(&space));
            let wanted = met.fold(0u32, |bits, (level, _)| bits | 1 << level);
            let got = channel.resident.levels[place];
            if got != wanted {
                return Err(format!("levels at {brick:?}, level {level}: {got:b} for {wanted:b}"));
            }
            let best = channel.resident.best(level, brick);
            let finest = there.iter().filter(|(l, other)| *l >= level && other.holds(&space));
            let wanted = finest.map(|(level, _)| *level).min();
            if best != wanted {
                return Err(format!("best at {brick:?}, level {level}: {best:?} for {wanted:?}"));
            }
            place += 1;
        }
    }
    Ok(())
}
