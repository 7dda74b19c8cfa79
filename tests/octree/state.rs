//! An octree that is kept up to date by what happens: bricks become known, arrive and leave, transfer
//! functions change, channels are swapped.

use ashfall::twins::octree::Nodes;
use ashfall::twins::octree_ranges::{
    Coding, Ranges, Work, leaf_ranges, not_one_value, update_ranges,
};
use ashfall::twins::octree_resident::Resident;
use ashfall::twins::octree_shape::Shape;
use ashfall::twins::octree_words::{Shown, Words};
use ashfall::volume::ValueRange;

use crate::random::Random;
use crate::world::{World, extent};

/// What shows: values in any of these closed intervals.
pub type Intervals = Vec<[f32; 2]>;

pub fn shows(intervals: &Intervals, range: ValueRange) -> bool {
    intervals.iter().any(|[from, to]| range.least <= *to && range.greatest >= *from)
}

/// How much is known of a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    Nothing,
    /// Its range, from the source.
    Range,
    /// Those of its leaves, since it was here.
    Leaves,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    Survey { channel: usize, level: usize, brick: [u32; 3] },
    Arrive { channel: usize, level: usize, brick: [u32; 3] },
    Leave { channel: usize, level: usize, brick: [u32; 3] },
    Transfer { channel: usize },
    Swap { channel: usize, source: usize },
}

#[derive(Clone)]
pub struct Channel {
    pub source: usize,
    pub intervals: Intervals,
    pub ranges: Ranges,
    pub resident: Resident,
    /// By level and brick, x fastest: how much is known, and whether it is resident.
    pub bricks: Vec<Vec<(Known, bool)>>,
}

#[derive(Clone)]
pub struct State {
    pub shape: Shape,
    pub channels: Vec<Channel>,
    pub words: Words,
    pub of_ranges: Work,
    pub of_words: Work,
    pub of_resident: Work,
    /// Words that the device would be sent.
    pub sent: u64,
}

pub fn index(shape: &Shape, level: usize, [x, y, z]: [u32; 3]) -> usize {
    let [nx, ny, _] = shape.bricks(level);
    ((z * ny + y) * nx + x) as usize
}

/// Range of a brick as a source states it, apron included.
pub fn brick_range(world: &World, source: usize, level: usize, brick: [u32; 3]) -> ValueRange {
    let of = &world.sources[source][level];
    let payload = world.plan.payload;
    let start: [i64; 3] = std::array::from_fn(|a| i64::from(brick[a] * payload[a]));
    let end =
        std::array::from_fn(|a| (start[a] + i64::from(payload[a])).min(of.size[a].into()) + 1);
    let (range, equal) = of.range(start.map(|at| at - 1), end);
    if equal { range } else { not_one_value(range) }
}

impl State {
    pub fn new(world: &World, fan_out: u32, random: &mut Random) -> State {
        let shape = world.plan.shape(fan_out);
        let coding = Coding::of(world.plan.format);
        let unknown = || -> Vec<Vec<(Known, bool)>> {
            let of_level = |level: usize| {
                let bricks = shape.bricks(level).iter().product::<u32>();
                vec![(Known::Nothing, false); bricks as usize]
            };
            (0..shape.trees.len()).map(of_level).collect()
        };
        let channels = (0..world.plan.channels.len()).map(|source| Channel {
            source,
            intervals: intervals(world, random),
            ranges: Ranges::unknown(coding, shape.nodes()),
            resident: Resident::nothing(&shape),
            bricks: unknown(),
        });
        let channels: Vec<Channel> = channels.collect();
        let words = Words::unknown(&shape, channels.len());
        let none = Work::default();
        let mut state = State {
            shape,
            channels,
            words,
            of_ranges: none,
            of_words: none,
            of_resident: none,
            sent: 0,
        };
        state.reclassify(world);
        state
    }

    /// Something that can happen.
    pub fn event(&self, random: &mut Random) -> Event {
        let channel = random.index(self.channels.len());
        match random.below(1000) {
            0..4 => return Event::Transfer { channel },
            4..8 => {
                let taken = |source: &usize| self.channels.iter().any(|c| c.source == *source);
                let free = (0..=self.channels.len()).find(|source| !taken(source));
                return Event::Swap { channel, source: free.expect("one more source") };
            }
            _ => {}
        }
        let level = random.index(self.shape.trees.len());
        let bricks = self.shape.bricks(level);
        let brick = bricks.map(|count| random.below(count.into()) as u32);
        let (_, here) = self.channels[channel].bricks[level][index(&self.shape, level, brick)];
        match random.below(4) {
            0 => Event::Survey { channel, level, brick },
            _ if here => Event::Leave { channel, level, brick },
            _ => Event::Arrive { channel, level, brick },
        }
    }

    pub fn happen(&mut self, world: &World, event: Event, random: &mut Random) {
        match event {
            Event::Survey { channel, level, brick } => {
                let at = index(&self.shape, level, brick);
                let (known, _) = &mut self.channels[channel].bricks[level][at];
                if *known == Known::Nothing {
                    *known = Known::Range;
                    let range = brick_range(world, self.channels[channel].source, level, brick);
                    self.learn(world, channel, level, brick, |_| range);
                }
            }
            Event::Arrive { channel, level, brick } => {
                let at = index(&self.shape, level, brick);
                let of = &mut self.channels[channel];
                of.resident.arrives(level, brick, &mut self.of_resident);
                let (known, here) = &mut of.bricks[level][at];
                *here = true;
                if *known != Known::Leaves {
                    *known = Known::Leaves;
                    let (voxels, size) = world.brick(of.source, level, brick);
                    let ranges = leaf_ranges(&voxels, size, self.shape.leaf_edges(level));
                    self.learn(world, channel, level, brick, |leaf| ranges[leaf]);
                }
            }
            Event::Leave { channel, level, brick } => {
                let at = index(&self.shape, level, brick);
                let of = &mut self.channels[channel];
                of.resident.leaves(level, brick, &mut self.of_resident);
                of.bricks[level][at].1 = false;
            }
            Event::Transfer { channel } => {
                self.channels[channel].intervals = intervals(world, random);
                self.reclassify(world);
            }
            Event::Swap { channel, source } => {
                let of = &mut self.channels[channel];
                of.source = source;
                of.ranges.forget();
                of.resident.forget();
                of.bricks.iter_mut().for_each(|level| level.fill((Known::Nothing, false)));
                self.reclassify(world);
            }
        }
    }

    fn learn(
        &mut self,
        world: &World,
        channel: usize,
        level: usize,
        brick: [u32; 3],
        of: impl Fn(usize) -> ValueRange,
    ) {
        let leaves = self.shape.leaves_of_brick(level, brick);
        let along: [u32; 3] = std::array::from_fn(|a| leaves.end[a] - leaves.start[a]);
        let within = |leaf: [u32; 3]| {
            let [x, y, z] = std::array::from_fn(|axis| leaf[axis] - leaves.start[axis]);
            ((z * along[1] + y) * along[0] + x) as usize
        };
        let ranges = &mut self.channels[channel].ranges;
        let range = |leaf| of(within(leaf));
        let changed = update_ranges(&self.shape, level, ranges, leaves, range, &mut self.of_ranges);
        self.update_words(world, level, changed);
    }

    fn update_words(&mut self, world: &World, level: usize, leaves: Nodes) {
        let judges: Vec<_> = self
            .channels
            .iter()
            .map(|channel| |range: ValueRange| shows(&channel.intervals, range))
            .collect();
        let shown: Vec<Shown> = self
            .channels
            .iter()
            .zip(&judges)
            .zip(world.plan.channels)
            .map(|((channel, shows), levels)| Shown {
                ranges: &channel.ranges,
                shows,
                levels: levels.map(|level| level.min(self.shape.trees.len() - 1)),
            })
            .collect();
        self.sent += self.words.update(&self.shape, &shown, level, leaves, &mut self.of_words);
    }

    pub fn reclassify(&mut self, world: &World) {
        for level in 0..self.shape.trees.len() {
            let leaves = Nodes::all(self.shape.lowest(&self.shape.trees[level]));
            self.update_words(world, level, leaves);
        }
    }
}

/// Nothing, everything, a part, or two narrow parts of all values.
pub fn intervals(world: &World, random: &mut Random) -> Intervals {
    let (least, greatest, _) = extent(world.plan.format);
    let part = |random: &mut Random, width: f64| {
        let from = random.unit() * (1.0 - width);
        let value = |unit: f64| least + (greatest - least) * unit as f32;
        [value(from), value(from + width)]
    };
    match random.below(6) {
        0 => Vec::new(),
        1 => vec![[f32::NEG_INFINITY, f32::INFINITY]],
        2 | 3 => vec![part(random, 0.3)],
        _ => vec![part(random, 0.01), part(random, 0.002)],
    }
}
