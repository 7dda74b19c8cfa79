//! Words of leaves as they follow from what is known of bricks, written once more, naively: every hull is of
//! all leaves, every word is computed anew.

use std::sync::Arc;

use ashfall::error::Result;
use ashfall::render::paging::{Judge, LeafChannel, LeafWords, Shows};
use ashfall::render::{Layout, TexelLayout};
use ashfall::source::BrickEntry;
use ashfall::twins::octree::{Nodes, ONE_VALUE, RISE_LEAVES, RISE_SHIFT, Tier};
use ashfall::twins::octree_ranges::Coding;
use ashfall::twins::octree_shape::Shape;
use ashfall::twins::transfer::TransferSegment;
use ashfall::volume::{BrickId, ValueRange, VoxelFormat, Voxels, sanitized};

use crate::random::Random;
use crate::world::{Plan, extent};

/// What is known of a brick.
#[derive(Clone, Debug)]
pub enum Known {
    Nothing,
    /// One range for all leaves: surveyed or failed.
    Range(ValueRange),
    /// Of its leaves.
    Leaves(Vec<ValueRange>),
}

pub struct Model {
    pub plan: Plan,
    pub shape: Arc<Shape>,
    pub judges: Vec<Judge>,
    /// Coarser bricks stand in for failed ones.
    pub stand_ins: bool,
    /// Numbers in the source, all odd.
    pub in_source: Vec<u16>,
    levels: Vec<[usize; 2]>,
    /// By channel, level and brick, x fastest.
    pub known: Vec<Vec<Vec<Known>>>,
}

fn index([nx, ny, _]: [u32; 3], [x, y, z]: [u32; 3]) -> usize {
    ((z * ny + y) * nx + x) as usize
}

fn judge(format: VoxelFormat, random: &mut Random) -> Judge {
    let (least, greatest, _) = extent(format);
    let layout = TexelLayout::of(format, ValueRange { least, greatest }, Layout::Plain);
    let width = f64::from(greatest - least) * random.one(&[1.0, 0.3, 0.02]);
    let low = random.between(f64::from(least), f64::from(greatest) - width);
    let mut begins: Vec<f32> = (0..random.below(4)).map(|_| random.unit() as f32).collect();
    begins.sort_by(f32::total_cmp);
    begins.insert(0, 0.0);
    let segment = |begins_at: f32| TransferSegment {
        start: [0.5, 0.5, 0.5, if random.once_in(2) { 0.0 } else { 1.0 }],
        begins_at,
        window_scale: (layout.scale / width) as f32,
        window_offset: ((layout.offset - low) / width) as f32,
        ..TransferSegment::default()
    };
    let segments = begins.into_iter().map(segment).collect();
    Judge { format, layout, segments, skipping: !random.once_in(8) }
}

/// As ranges are kept: of whole values rounded outwards.
fn kept(range: ValueRange, format: VoxelFormat) -> ValueRange {
    match format {
        VoxelFormat::F32 => range,
        _ => ValueRange { least: range.least.floor(), greatest: range.greatest.ceil() },
    }
}

pub fn drawn(range: ValueRange, alike: bool) -> ValueRange {
    if range.is_empty() {
        return range;
    }
    let [least, greatest] = [range.least, range.greatest].map(sanitized);
    let wider = least == greatest && !alike;
    ValueRange { least, greatest: if wider { greatest.next_up() } else { greatest } }
}

/// Of a failed brick, for which a coarser one may stand in.
pub fn failed(format: VoxelFormat, stand_ins: bool) -> ValueRange {
    if stand_ins { Coding::of(format).unknown() } else { ValueRange::EMPTY }
}

pub fn surveyed(entry: &Result<BrickEntry>, format: VoxelFormat, stand_ins: bool) -> ValueRange {
    match entry {
        Err(_) => failed(format, stand_ins),
        Ok(BrickEntry::Absent) => ValueRange::EMPTY,
        Ok(BrickEntry::Constant(bytes)) => {
            let value = Voxels::from_bytes(format, &bytes[..format.bytes()]).value(0);
            if value.is_nan() { ValueRange::EMPTY } else { drawn(ValueRange::of(value), true) }
        }
        Ok(BrickEntry::Stored { range, .. }) => {
            if range.least.is_nan() || range.greatest.is_nan() {
                return Coding::of(format).unknown();
            }
            drawn(*range, format != VoxelFormat::F32)
        }
    }
}

impl Model {
    pub fn new(plan: Plan, random: &mut Random) -> Model {
        let shape = Arc::new(plan.shape(random.one(&[2, 2, 4])));
        let of_level = |level: usize| {
            vec![Known::Nothing; shape.bricks(level).iter().product::<u32>() as usize]
        };
        let nothing: Vec<_> = (0..shape.trees.len()).map(of_level).collect();
        Model {
            judges: plan.channels.iter().map(|_| judge(plan.format, random)).collect(),
            stand_ins: random.once_in(2),
            in_source: (0..plan.channels.len() as u16).map(|channel| 2 * channel + 1).collect(),
            levels: plan.channels.to_vec(),
            known: vec![nothing; plan.channels.len()],
            plan,
            shape,
        }
    }

    pub fn leaf_words(&self) -> LeafWords {
        LeafWords::new(Arc::clone(&self.shape), self.leaf_channels(), self.stand_ins)
    }

    pub fn leaf_channels(&self) -> Vec<LeafChannel> {
        let channel = |(at, judge): (usize, &Judge)| LeafChannel {
            in_source: self.in_source[at],
            judge: judge.clone(),
            levels: self.levels[at],
        };
        self.judges.iter().enumerate().map(channel).collect()
    }

    /// The channel of the scene that this one of the source is.
    pub fn shown(&self, in_source: u16) -> Option<usize> {
        self.in_source.iter().position(|shown| *shown == in_source)
    }

    /// Another channel takes the place of one, or the same is shown otherwise.
    pub fn change(&mut self, channel: usize, random: &mut Random) {
        if random.once_in(2) {
            // As many as there are places, so that one comes back now and then.
            let count = self.in_source.len() as u16;
            let one = channel as u16 + count * random.below(3) as u16;
            if self.in_source[channel] != 2 * one + 1 {
                self.in_source[channel] = 2 * one + 1;
                self.known[channel].iter_mut().flatten().for_each(|known| *known = Known::Nothing);
            }
        }
        self.judges[channel] = judge(self.plan.format, random);
        if random.once_in(3) {
            let least = random.index(3);
            self.levels[channel] = [least, least + random.index(3)];
        }
    }

    pub fn known(&mut self, channel: usize, id: BrickId) -> Option<&mut Known> {
        let level = usize::from(id.level);
        let (at, brick) = (level.min(self.shape.trees.len() - 1), [id.x, id.y, id.z]);
        let bricks = self.shape.bricks(at);
        let inside = at == level && (0..3).all(|axis| brick[axis] < bricks[axis]);
        inside.then(|| &mut self.known[channel][level][index(bricks, brick)])
    }

    /// The range of a leaf of a level.
    fn leaf(&self, channel: usize, level: usize, leaf: [u32; 3]) -> ValueRange {
        let (edges, payload) = (self.shape.leaf_edges(level), self.plan.payload);
        let voxel: [u32; 3] = std::array::from_fn(|axis| leaf[axis] * edges[axis]);
        let brick: [u32; 3] = std::array::from_fn(|axis| voxel[axis] / payload[axis]);
        let range = match &self.known[channel][level][index(self.shape.bricks(level), brick)] {
            Known::Nothing => Coding::of(self.plan.format).unknown(),
            Known::Range(range) => *range,
            Known::Leaves(ranges) => {
                let within = std::array::from_fn(|a| voxel[a] % payload[a] / edges[a]);
                ranges[index(self.leaves_along(level, brick), within)]
            }
        };
        kept(range, self.plan.format)
    }

    pub fn leaves_along(&self, level: usize, brick: [u32; 3]) -> [u32; 3] {
        let (edges, payload) = (self.shape.leaf_edges(level), self.plan.payload);
        std::array::from_fn(|axis| {
            let rest = self.shape.sizes[level][axis] - brick[axis] * payload[axis];
            rest.min(payload[axis]).div_ceil(edges[axis])
        })
    }

    /// By tier, from that of the leaves on: hulls of all leaves beneath each node.
    fn hulls(&self, channel: usize, level: usize) -> Vec<Vec<ValueRange>> {
        let tree = &self.shape.trees[level];
        let lowest = self.shape.lowest(tree);
        let leaves: Vec<_> =
            Nodes::all(lowest).each().map(|leaf| (leaf, self.leaf(channel, level, leaf))).collect();
        let of_tier = |tier: &Tier| {
            let mut hulls = vec![ValueRange::EMPTY; Nodes::all(tier).count() as usize];
            for (leaf, range) in &leaves {
                let hull = &mut hulls[index(tier.nodes, lowest.ancestor(tier, *leaf))];
                *hull = hull.union(*range);
            }
            hulls
        };
        self.shape.tiers[tree.tier as usize..].iter().map(of_tier).collect()
    }

    /// All words that rays read.
    pub fn words(&self) -> Vec<u32> {
        let levels = 0..self.shape.trees.len();
        let of_channel =
            |channel: usize| levels.clone().map(|level| self.hulls(channel, level)).collect();
        let hulls: Vec<Vec<Vec<Vec<ValueRange>>>> =
            (0..self.judges.len()).map(of_channel).collect();
        let mut words = Vec::new();
        for (level, tree) in self.shape.trees.iter().enumerate() {
            let first = tree.tier as usize;
            let lowest = &self.shape.tiers[first];
            // Of a channel in a node of the tier `number`, or in the node around it.
            let range = |at: usize, number: usize, node: [u32; 3]| {
                let last = self.shape.trees.len() - 1;
                let [from, to] = self.levels[at].map(|bound| bound.min(last));
                let drawn = level.clamp(from, to);
                let coarsest = self.shape.trees[drawn].tier as usize;
                let around = number.max(coarsest);
                let tier = &self.shape.tiers[around];
                let node = self.shape.tiers[number].ancestor(tier, node);
                hulls[at][drawn][around - coarsest][index(tier.nodes, node)]
            };
            let of_leaf = |leaf: [u32; 3]| {
                let (mut shown, mut one) = (0, true);
                for (at, judge) in self.judges.iter().enumerate() {
                    let range = range(at, first, leaf);
                    let entry = BrickEntry::Stored { range, loss: 0.0 };
                    if !range.is_empty() && judge.shows(&entry) != Shows::Hidden {
                        shown |= 1 << at;
                        one &= range.least == range.greatest;
                    }
                }
                if shown != 0 && one { shown | ONE_VALUE } else { shown }
            };
            // Whether a word may be that of a node.
            let whole = |number: usize, node: [u32; 3], word: u32| {
                let one = |at: usize| {
                    let range = range(at, number, node);
                    range.least == range.greatest
                };
                word & ONE_VALUE == 0
                    || (0..self.judges.len()).all(|at| word >> at & 1 == 0 || one(at))
            };
            let leaves: Vec<_> =
                Nodes::all(lowest).each().map(|leaf| (leaf, of_leaf(leaf))).collect();
            let mut rises = vec![0; leaves.len()];
            for (above, tier) in self.shape.tiers[first..].iter().enumerate().skip(1) {
                let number = first + above;
                if (0..3).any(|axis| {
                    1u64 << (tier.shift[axis] - lowest.shift[axis]) > RISE_LEAVES.into()
                }) {
                    break;
                }
                let around = |leaf| index(tier.nodes, lowest.ancestor(tier, leaf));
                let mut same = vec![None; Nodes::all(tier).count() as usize];
                for (leaf, word) in &leaves {
                    let node = lowest.ancestor(tier, *leaf);
                    let (least, greatest) = same[around(*leaf)].unwrap_or((*word, *word));
                    let fits = whole(number, node, *word);
                    same[around(*leaf)] =
                        Some((least.min(*word), if fits { greatest.max(*word) } else { u32::MAX }));
                }
                for ((leaf, _), rise) in leaves.iter().zip(&mut rises) {
                    if *rise + 1 == above && same[around(*leaf)].is_some_and(|(a, b)| a == b) {
                        *rise = above;
                    }
                }
            }
            let risen = leaves.iter().zip(rises);
            words.extend(risen.map(|((_, word), rise)| word | (rise as u32) << RISE_SHIFT));
        }
        words
    }
}
