//! Leaf words on the host: whatever becomes known in whatever order, the copy that the device would have is
//! that of a naive model, which computes every word from all that is known.

use std::sync::Arc;

use ashfall::error::{Error, Result};
use ashfall::loading::{Block, Inspect};
use ashfall::render::paging::{Judge, LeafChannel, LeafWords};
use ashfall::render::{Layout, TexelLayout};
use ashfall::source::BrickEntry;
use ashfall::twins::octree::{Nodes, RISE_SHIFT, bits_of_word, unpacked};
use ashfall::twins::transfer::TransferSegment;
use ashfall::volume::{BrickGrid, BrickId, Size3, ValueRange, VoxelFormat};

use crate::host_model::{Known, Model, drawn, failed, surveyed};
use crate::random::Random;
use crate::world::{Plan, World, extent};

const ALL: [usize; 2] = [0, 31];

/// Words of 8, 16 and 32 bits, all formats of one part.
const PLANS: &[Plan] = &[
    Plan {
        size: [26, 19, 17],
        spacing: [1.0; 3],
        payload: [8; 3],
        leaf: [2; 3],
        format: VoxelFormat::U8,
        channels: &[ALL, [1, 2]],
    },
    Plan {
        size: [37, 22, 26],
        spacing: [0.7, 1.0, 1.3],
        payload: [12, 7, 5],
        leaf: [3, 4, 4],
        format: VoxelFormat::U16,
        channels: &[ALL, [0, 0], [1, 1], [2, 31], ALL, [0, 1]],
    },
    Plan {
        size: [40, 13, 9],
        spacing: [1.0; 3],
        payload: [8; 3],
        leaf: [4; 3],
        format: VoxelFormat::I16,
        channels: &[
            ALL,
            ALL,
            [1, 1],
            ALL,
            ALL,
            [2, 2],
            ALL,
            [0, 0],
            ALL,
            ALL,
            [0, 1],
            ALL,
            [1, 31],
            ALL,
        ],
    },
    Plan {
        size: [30, 31, 18],
        spacing: [1.0, 1.0, 2.0],
        payload: [8; 3],
        leaf: [4; 3],
        format: VoxelFormat::F32,
        channels: &[ALL, ALL, [1, 31], [0, 0]],
    },
    // More blocks than one, most of their bricks of one leaf.
    Plan {
        size: [76, 9, 40],
        spacing: [1.0; 3],
        payload: [4; 3],
        leaf: [4; 3],
        format: VoxelFormat::U8,
        channels: &[ALL, [1, 2], ALL, ALL],
    },
];

/// What the device would have.
struct Device {
    bytes: Vec<u8>,
    bits: u32,
    sent: u64,
}

impl Device {
    fn take(&mut self, leaf_words: &mut LeafWords) {
        let mut next = 0;
        for (offset, bytes) in leaf_words.changed() {
            assert!(offset % 4 == 0 && bytes.len() % 4 == 0 && !bytes.is_empty());
            assert!(offset >= next, "spans rise and are apart");
            next = offset + bytes.len() as u64 + 257;
            self.bytes[offset as usize..][..bytes.len()].copy_from_slice(&bytes);
            self.sent += bytes.len() as u64;
        }
        assert!(leaf_words.changed().is_empty(), "said twice");
        assert_eq!(leaf_words.work.bytes_changed, self.sent);
    }

    fn word(&self, number: usize) -> u32 {
        let bit = number * self.bits as usize;
        let word = u32::from_le_bytes(self.bytes[bit / 32 * 4..][..4].try_into().expect("four"));
        let small = u64::from(word) >> (bit % 32) & ((1 << self.bits) - 1);
        unpacked(small as u32, self.bits)
    }
}

fn range(format: VoxelFormat, random: &mut Random) -> ValueRange {
    let (least, greatest, whole) = extent(format);
    let value = |random: &mut Random| {
        let value = least + (greatest - least) * random.unit() as f32;
        if whole { value.round() } else { value }
    };
    let (a, b) = (value(random), value(random));
    let mut range = match random.below(8) {
        0 => ValueRange::EMPTY,
        // Few values, so that neighbours share one now and then.
        1..4 => ValueRange::of(least + random.below(3) as f32),
        4 => ValueRange { least: a, greatest: (a + 0.01 * (greatest - a)).max(a) },
        _ => ValueRange { least: a.min(b), greatest: a.max(b) },
    };
    if !whole && random.once_in(10) && !range.is_empty() {
        range.greatest = f32::INFINITY;
    }
    if !whole && random.once_in(20) && !range.is_empty() {
        range.least = f32::NEG_INFINITY;
    }
    range
}

fn entry(format: VoxelFormat, random: &mut Random) -> Result<BrickEntry> {
    let (least, ..) = extent(format);
    match random.below(20) {
        0 => Err(Error::input("a bad day")),
        1..4 => Ok(BrickEntry::Absent),
        4..8 => {
            let value = least + random.below(3) as f32;
            let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0];
            let value = if random.once_in(3) { random.one(&special) } else { value };
            Ok(BrickEntry::Constant(match format {
                VoxelFormat::U8 => [value as u8, 0, 0, 0],
                VoxelFormat::I16 => {
                    let [low, high] = (value as i16).to_le_bytes();
                    [low, high, 0, 0]
                }
                VoxelFormat::F32 => value.to_le_bytes(),
                _ => {
                    let [low, high] = (value as u16).to_le_bytes();
                    [low, high, 0, 0]
                }
            }))
        }
        8 => Ok(BrickEntry::Stored {
            range: ValueRange { least: f32::NAN, greatest: least },
            loss: 0.0,
        }),
        _ => Ok(BrickEntry::Stored { range: range(format, random), loss: f32::NAN }),
    }
}

/// Channels of the source, more than any run shows.
const FORMATS: usize = 256;

struct Run {
    world: World,
    model: Model,
    leaf_words: LeafWords,
    inspect: Inspect,
    device: Device,
    random: Random,
}

impl Run {
    fn new(plan: Plan, seed: u64) -> Run {
        let mut random = Random(seed);
        let mut world = World::new(plan, seed);
        if plan.format == VoxelFormat::F32 {
            for level in world.sources.iter_mut().flatten() {
                for value in level.values.iter_mut().step_by(1 + random.index(90)) {
                    *value = f32::INFINITY.copysign(*value - 2.0);
                }
            }
        }
        let model = Model::new(plan, &mut random);
        let leaf_words = model.leaf_words();
        let inspect = leaf_words.inspect(vec![plan.format; FORMATS]);
        let bits = bits_of_word(plan.channels.len() as u32);
        let bytes = LeafWords::bytes(&model.shape, plan.channels.len());
        let device = Device { bytes: vec![0xa5; bytes as usize], bits, sent: 0 };
        Run { world, model, leaf_words, inspect, device, random }
    }

    /// Of the volume, or now and then beside it.
    fn id(&mut self) -> (usize, BrickId) {
        let random = &mut self.random;
        let channel = random.index(self.model.judges.len());
        let level = random.index(self.model.shape.trees.len());
        let mut bricks = self.model.shape.bricks(level);
        let mut level = level as u8;
        match random.below(60) {
            0 => level = self.model.shape.trees.len() as u8,
            1 => bricks[random.index(3)] += 2,
            _ => {}
        }
        let [x, y, z] = bricks.map(|count| random.below(count.into()) as u32);
        (channel, BrickId { volume: 0, channel: self.model.in_source[channel], level, x, y, z })
    }

    fn survey(&mut self) {
        let (_, id) = self.id();
        let format = self.model.plan.format;
        let mut entries = Vec::new();
        match self.random.below(3) {
            0 => {
                for _ in 0..self.random.below(4) {
                    let (_, id) = self.id();
                    entries.push((id, entry(format, &mut self.random)));
                }
            }
            _ if usize::from(id.level) < self.model.shape.trees.len() => {
                let grid = BrickGrid {
                    size: Size3::from_array(self.model.shape.sizes[usize::from(id.level)]),
                    payload: Size3::from_array(self.model.plan.payload),
                };
                // Blocks are of one kind now and then, so that words rise.
                let all = entry(format, &mut self.random);
                let mixed = self.random.once_in(2);
                for id in Block::of(id).bricks(grid) {
                    let own = mixed || self.random.once_in(40);
                    let of = if own { entry(format, &mut self.random) } else { all.clone() };
                    entries.push((id, of));
                }
            }
            _ => entries.push((id, Err(Error::input("no such block")))),
        }
        if self.random.once_in(10) {
            // Not shown by the scene: nothing changes.
            entries.push((BrickId { channel: 2, ..id }, Ok(BrickEntry::Absent)));
        }
        self.leaf_words.take_survey(&entries);
        let stand_ins = self.model.stand_ins;
        for (id, entry) in &entries {
            let Some(channel) = self.model.shown(id.channel) else { continue };
            if let Some(known) = self.model.known(channel, *id)
                && !(matches!(known, Known::Leaves(_)) && entry.is_ok())
            {
                *known = Known::Range(surveyed(entry, format, stand_ins));
            }
        }
    }

    /// A brick of the volume's own voxels.
    fn brick(&mut self) {
        let (channel, id) = self.id();
        let level = usize::from(id.level);
        let brick = [id.x, id.y, id.z];
        if self.model.known(channel, id).is_none() {
            assert!((self.inspect)(id, &[0; 64]).is_empty());
            self.leaf_words.take_brick(id, &[ValueRange::EMPTY]);
            return;
        }
        let (voxels, _) = self.world.brick(channel, level, brick);
        let ranges = (self.inspect)(id, voxels.bytes());
        assert!((self.inspect)(id, &voxels.bytes()[1..]).is_empty(), "too short");
        let beyond = BrickId { channel: FORMATS as u16, ..id };
        assert!((self.inspect)(beyond, voxels.bytes()).is_empty(), "no such channel");
        let edges = self.model.shape.leaf_edges(level);
        let of = &self.world.sources[channel][level];
        let along = self.model.leaves_along(level, brick);
        let leaves = Nodes { start: [0; 3], end: along };
        let naive: Vec<ValueRange> = leaves
            .each()
            .map(|leaf| {
                let payload = self.model.plan.payload;
                let start: [i64; 3] = std::array::from_fn(|axis| {
                    i64::from(brick[axis] * payload[axis] + leaf[axis] * edges[axis]) - 1
                });
                let end = std::array::from_fn(|axis| {
                    let end = start[axis] + 1 + i64::from(edges[axis]);
                    end.min(of.size[axis].into()) + 1
                });
                let (range, alike) = of.range(start, end);
                drawn(range, alike)
            })
            .collect();
        assert_eq!(ranges, naive, "{id:?}");
        if !self.random.once_in(3) {
            return self.tell(channel, id, naive);
        }
        // From the RAM cache: only what is not known is looked at.
        self.leaf_words.take_cached(id, voxels.bytes());
        let known = self.model.known(channel, id).expect("it is there");
        if !matches!(known, Known::Leaves(_)) {
            *known = Known::Leaves(naive);
        }
    }

    /// Ranges of no volume at all, or too many of them.
    fn ranges(&mut self) {
        let (channel, id) = self.id();
        if self.model.known(channel, id).is_none() {
            return;
        }
        let along = self.model.leaves_along(usize::from(id.level), [id.x, id.y, id.z]);
        let alike = self.random.once_in(2).then(|| range(self.model.plan.format, &mut self.random));
        let one =
            |random: &mut Random| alike.unwrap_or_else(|| range(self.model.plan.format, random));
        let ranges: Vec<_> =
            (0..along.iter().product()).map(|_: u32| one(&mut self.random)).collect();
        let wrong = [ranges.clone(), vec![ValueRange::EMPTY]].concat();
        self.leaf_words.take_brick(id, &wrong);
        self.tell(channel, id, ranges);
    }

    fn tell(&mut self, channel: usize, id: BrickId, ranges: Vec<ValueRange>) {
        self.leaf_words.take_brick(id, &ranges);
        if let Some(known) = self.model.known(channel, id) {
            *known = Known::Leaves(ranges);
        }
    }

    fn happen(&mut self) {
        match self.random.below(1000) {
            0..3 => {
                self.leaf_words.forget();
                let all = self.model.known.iter_mut().flatten().flatten();
                all.for_each(|known| *known = Known::Nothing);
            }
            3..30 => {
                let channel = self.random.index(self.model.judges.len());
                self.model.change(channel, &mut self.random);
                self.leaf_words.show(self.model.leaf_channels());
            }
            30..250 => self.survey(),
            250..600 => self.brick(),
            600..800 => self.ranges(),
            800..900 => {
                let (channel, id) = self.id();
                self.leaf_words.failed(id);
                let range = failed(self.model.plan.format, self.model.stand_ins);
                if let Some(known) = self.model.known(channel, id) {
                    *known = Known::Range(range);
                }
            }
            _ => {
                let (channel, id) = self.id();
                self.leaf_words.forget_failed(id);
                if let Some(known) = self.model.known(channel, id) {
                    *known = Known::Nothing;
                }
            }
        }
    }

    fn check(&mut self) -> std::result::Result<(), String> {
        self.device.take(&mut self.leaf_words);
        for (number, word) in self.model.words().into_iter().enumerate() {
            let got = self.device.word(number);
            if got != word {
                return Err(format!("word {number}: {got:x} for {word:x}"));
            }
        }
        Ok(())
    }
}

#[test]
fn the_device_has_the_words_of_what_is_known() {
    for seed in 0..3 * PLANS.len() as u64 {
        let plan = PLANS[seed as usize % PLANS.len()];
        let mut run = Run::new(plan, seed);
        for step in 0..600 {
            if step % 6 == 0 {
                run.check().unwrap_or_else(|why| panic!("seed {seed}, {plan:?}, {step}: {why}"));
            } else if run.random.once_in(3) {
                run.device.take(&mut run.leaf_words);
            }
            run.happen();
        }
        let words = run.model.words();
        let rises = words.iter().filter(|word| *word >> RISE_SHIFT > 0).count();
        eprintln!("seed {seed}: {} words, {rises} rise, {:?}", words.len(), run.leaf_words.work);
    }
}

/// An octree of one brick of 4 x 4 x 4 voxels and one leaf, in which every value shows.
fn one_leaf(format: VoxelFormat) -> (LeafWords, BrickId) {
    let plan = Plan { size: [4; 3], payload: [4; 3], leaf: [4; 3], format, ..PLANS[0] };
    let segments = vec![TransferSegment { start: [1.0; 4], ..TransferSegment::default() }];
    let layout = TexelLayout::of(format, ValueRange { least: 0.0, greatest: 1.0 }, Layout::Plain);
    let judge = Judge { format, layout, segments, skipping: true };
    // Levels that the volume does not have, and none at all between them.
    let channel = LeafChannel { in_source: 0, judge, levels: [9, 3] };
    let mut leaf_words = LeafWords::new(Arc::new(plan.shape(2)), vec![channel], false);
    assert_eq!(leaf_words.changed(), [(0, vec![1, 0, 0, 0])], "unknown, and nothing beside it");
    (leaf_words, BrickId { volume: 0, channel: 0, level: 0, x: 0, y: 0, z: 0 })
}

#[test]
fn one_value_is_what_every_voxel_has() {
    const ONE: u8 = 1 << 4 | 1;
    let stored = |value: f32| BrickEntry::Stored { range: ValueRange::of(value), loss: 0.0 };
    let nan = BrickEntry::Constant(f32::NAN.to_le_bytes());
    for (format, entry, word) in [
        (VoxelFormat::Rgba8, BrickEntry::Constant([1, 2, 3, 4]), ONE),
        // Of one alpha, and maybe of several colours; nothing is beside the greatest.
        (VoxelFormat::Rgba8, stored(255.0), 1),
        (VoxelFormat::U8, stored(255.0), ONE),
        (VoxelFormat::U16, stored(65535.0), ONE),
        // Holes are not in the range, infinities are drawn as the greatest value.
        (VoxelFormat::F32, stored(f32::INFINITY), 1),
        (VoxelFormat::F32, BrickEntry::Constant(f32::INFINITY.to_le_bytes()), ONE),
        (VoxelFormat::F32, nan, 0),
        (VoxelFormat::F32, BrickEntry::Absent, 0),
    ] {
        let (mut leaf_words, id) = one_leaf(format);
        leaf_words.take_survey(&[(id, Ok(entry))]);
        let wanted = if word == 1 { vec![] } else { vec![(0, vec![word, 0, 0, 0])] };
        assert_eq!(leaf_words.changed(), wanted, "{format} {entry:?}");
    }
    // Its six voxels an axis are of one alpha; the last of another colour.
    let (mut leaf_words, id) = one_leaf(VoxelFormat::Rgba8);
    let inspect = leaf_words.inspect(vec![VoxelFormat::Rgba8]);
    let mut bytes = [9, 8, 7, 255].repeat(6 * 6 * 6);
    for (colour, word) in [(7, ONE), (6, 1)] {
        bytes[4 * 215 + 2] = colour;
        leaf_words.take_brick(id, &inspect(id, &bytes));
        assert_eq!(leaf_words.changed(), [(0, vec![word, 0, 0, 0])]);
    }
}

#[test]
fn a_failed_brick_shows_nothing_until_it_is_forgotten() {
    let (mut leaf_words, id) = one_leaf(VoxelFormat::U8);
    leaf_words.take_brick(id, &[ValueRange { least: 3.0, greatest: 4.0 }]);
    leaf_words.failed(id);
    assert_eq!(leaf_words.changed(), [(0, vec![0; 4])]);
    leaf_words.forget_failed(id);
    assert_eq!(leaf_words.changed(), [(0, vec![1, 0, 0, 0])]);
    leaf_words.take_survey(&[(id, Err(Error::input("a bad day")))]);
    assert_eq!(leaf_words.changed(), [(0, vec![0; 4])]);
    leaf_words.forget();
    assert_eq!(leaf_words.changed(), [(0, vec![1, 0, 0, 0])]);
}
