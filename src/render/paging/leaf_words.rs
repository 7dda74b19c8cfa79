//! The residency octree's host side: what is known of every channel's leaves, and the words that rays read.
//!
//! Apart from the host cache, since it speaks of voxels alone, wherever they are.
//!
//! # Invariants
//! - What is said last of a brick counts; but of one whose leaves are known from its voxels, a survey says
//!   nothing new.
//! - A failed brick is drawn as nothing, until something else is said of it; where a coarser one stands in for
//!   it, nothing is known of it.
//! - Words follow from what is known, whatever the order in which it became known.
//!
//! # Source
//! docs/OCTREE.md.

use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

use crate::error::Result;
use crate::loading::{Block, Inspect};
use crate::render::paging::visibility::Judge;
use crate::source::BrickEntry;
use crate::twins::octree::{Nodes, SHOWS, bits_of_word, packed};
use crate::twins::octree_ranges::{
    Coding, Ranges, Work, leaf_ranges, not_one_value, update_some_ranges,
};
use crate::twins::octree_shape::Shape;
use crate::twins::octree_words::{Class, RUN_WORDS, Shown, Words, class_of};
use crate::volume::{BrickGrid, BrickId, Size3, ValueRange, VoxelFormat, Voxels, sanitized};

/// Spans of the device's buffer no farther apart become one: a copy command costs more than these bytes.
const GAP_BYTES_MAX: u64 = 256;
/// Leaves that are looked at to say how much is hidden.
const SAMPLED_LEAVES: usize = 1 << 14;

/// A channel that the scene shows.
#[derive(Clone, Debug)]
pub struct LeafChannel {
    /// Its number in the source.
    pub in_source: u16,
    /// What of it shows.
    pub judge: Judge,
    /// Least and greatest level at which it is drawn.
    pub levels: [usize; 2],
}

/// What was done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafWork {
    /// Nodes whose ranges were looked at.
    pub ranges: Work,
    /// Nodes whose words were looked at.
    pub words: Work,
    /// Words of leaves that got another value.
    pub words_changed: u64,
    /// Bytes for the device.
    pub bytes_changed: u64,
}

/// See the module.
pub struct LeafWords {
    shape: Arc<Shape>,
    channels: Vec<Channel>,
    words: Words,
    bits: u32,
    /// Coarser bricks stand in for failed ones.
    stand_ins: bool,
    /// Number of the first brick of every level.
    brick_first: Vec<usize>,
    /// What was done.
    pub work: LeafWork,
}

struct Channel {
    in_source: u16,
    judge: Judge,
    levels: [usize; 2],
    ranges: Ranges,
    /// Bit by number of brick: its leaves are known from its voxels.
    learned: Vec<u64>,
    memo: Memo,
}

impl LeafWords {
    /// Of a volume of which nothing is known: channels as the scene has them, their word's bits in order.
    /// `stand_ins`: coarser bricks stand in for failed ones, as in substitute refinement.
    ///
    /// # Panics
    /// When there are more channels than a word has room for: our own bug, since scenes are checked.
    pub fn new(shape: Arc<Shape>, channels: Vec<LeafChannel>, stand_ins: bool) -> LeafWords {
        let brick_first = brick_first(&shape);
        let last = shape.trees.len().saturating_sub(1);
        let bricks = brick_first.last().copied().unwrap_or(0);
        let channel = |LeafChannel { in_source, judge, levels }| Channel {
            ranges: Ranges::unknown(Coding::of(judge.format), shape.nodes()),
            learned: vec![0; bricks.div_ceil(64)],
            memo: Memo::default(),
            levels: bounded(levels, last),
            in_source,
            judge,
        };
        let bits = bits_of_word(channels.len() as u32);
        let channels: Vec<Channel> = channels.into_iter().map(channel).collect();
        let words = Words::unknown(&shape, channels.len());
        let work = LeafWork::default();
        let mut leaf_words =
            LeafWords { shape, channels, words, bits, stand_ins, brick_first, work };
        leaf_words.know_nothing();
        leaf_words
    }

    /// Bytes of the device's buffer: every leaf's word, and what makes the last u32 whole.
    pub fn bytes(shape: &Shape, channels: usize) -> u64 {
        let bits = u64::from(bits_of_word(channels as u32));
        (shape.words() as u64 * bits).div_ceil(32) * 4
    }

    /// Bytes that the host keeps for channels of these codings.
    pub fn host_bytes(shape: &Shape, codings: &[Coding]) -> u64 {
        let (nodes, leaves) = (shape.nodes() as u64, shape.words() as u64);
        let of_ranges: u64 = codings.iter().map(|coding| coding.words() as u64).sum();
        let bricks = brick_first(shape).last().copied().unwrap_or(0) as u64;
        let learned = codings.len() as u64 * bricks.div_ceil(64) * 8;
        4 * nodes * (of_ranges + 1) + 4 * leaves + leaves.div_ceil(8 * RUN_WORDS as u64) + learned
    }

    /// Bits of a word in the device's buffer: word `n` stands at bit `n * bits` of an array of u32.
    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// What loaders do with a brick that they have read, for [`LeafWords::take_brick`]; `formats` of all
    /// channels of the source, any of which may be shown later.
    pub fn inspect(&self, formats: Vec<VoxelFormat>) -> Inspect {
        let shape = Arc::clone(&self.shape);
        Arc::new(move |id, bytes| match formats.get(usize::from(id.channel)) {
            Some(format) => ranges_of_brick(&shape, *format, id, bytes),
            None => Vec::new(),
        })
    }

    /// The same of a brick from the RAM cache, unless its leaves are known: those of a channel that was not
    /// shown for a while are not.
    pub fn take_cached(&mut self, id: BrickId, bytes: &[u8]) {
        let known = |at: &usize| has_brick(&self.shape, id) && self.is_learned(*at, id);
        let unknown = self.channels_of(id.channel).into_iter().find(|at| !known(at));
        if let Some(at) = unknown {
            let ranges = ranges_of_brick(&self.shape, self.channels[at].judge.format, id, bytes);
            self.take_brick(id, &ranges);
        }
    }

    /// Shows other channels, as many as before, or the same ones otherwise. Of one that another had the place
    /// of nothing is known.
    pub fn show(&mut self, channels: Vec<LeafChannel>) {
        let last = self.shape.trees.len().saturating_sub(1);
        for (channel, next) in self.channels.iter_mut().zip(channels) {
            if channel.in_source != next.in_source {
                let coding = Coding::of(next.judge.format);
                channel.ranges = Ranges::unknown(coding, self.shape.nodes());
                channel.learned.fill(0);
                channel.in_source = next.in_source;
            }
            channel.judge = next.judge;
            channel.levels = bounded(next.levels, last);
            channel.memo = Memo::default();
        }
        self.with_shown(|words, shape, shown, work| words.update_all(shape, shown, work));
    }

    /// Learns what the source knows of bricks without reading them: their leaves have at most the brick's
    /// range. One of which it cannot say anything has failed.
    pub fn take_survey(&mut self, entries: &[(BrickId, Result<BrickEntry>)]) {
        for of_block in entries.chunk_by(|(a, _), (b, _)| Block::of(*a) == Block::of(*b)) {
            for at in self.channels_of(of_block[0].0.channel) {
                self.take_block(at, of_block);
            }
        }
    }

    /// Learns the ranges of a brick's leaves from its voxels, as [`LeafWords::inspect`] gives them.
    pub fn take_brick(&mut self, id: BrickId, ranges: &[ValueRange]) {
        let level = usize::from(id.level);
        if !has_brick(&self.shape, id) {
            return;
        }
        let leaves = self.shape.leaves_of_brick(level, [id.x, id.y, id.z]);
        if leaves.count() != ranges.len() as u64 {
            return;
        }
        let along: [u32; 3] = std::array::from_fn(|axis| leaves.end[axis] - leaves.start[axis]);
        let of = |leaf: [u32; 3]| {
            let [x, y, z] = std::array::from_fn(|axis| leaf[axis] - leaves.start[axis]);
            Some(ranges[((z * along[1] + y) * along[0] + x) as usize])
        };
        for at in self.channels_of(id.channel) {
            self.set_learned(at, id, true);
            self.learn(at, level, leaves, of);
        }
    }

    /// A brick could not be read in this epoch.
    pub fn failed(&mut self, id: BrickId) {
        let stand_ins = self.stand_ins;
        self.say(id, |coding| failed_range(coding, stand_ins));
    }

    /// A failed brick may be asked for again: nothing is known of it.
    pub fn forget_failed(&mut self, id: BrickId) {
        self.say(id, Coding::unknown);
    }

    /// The source has changed: nothing is known.
    pub fn forget(&mut self) {
        for channel in &mut self.channels {
            channel.ranges.forget();
            channel.learned.fill(0);
        }
        self.know_nothing();
    }

    /// What changed in the device's buffer since the last call, everything at first: offsets in bytes and what
    /// stands there, both multiples of 4, rising and apart.
    pub fn changed(&mut self) -> Vec<(u64, Vec<u8>)> {
        let bytes_of_word = u64::from(self.bits / 8);
        let mut spans: Vec<Range<usize>> = Vec::new();
        for run in self.words.take_changed() {
            match spans.last_mut() {
                Some(last) if (run.start - last.end) as u64 * bytes_of_word <= GAP_BYTES_MAX => {
                    last.end = run.end;
                }
                _ => spans.push(run),
            }
        }
        let spans: Vec<_> = spans
            .into_iter()
            .map(|span| {
                let offset = span.start as u64 * bytes_of_word;
                (offset, self.device_bytes(&self.words.of_leaf[span]))
            })
            .collect();
        self.work.bytes_changed += spans.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
        spans
    }

    /// The part of the finest level's leaves that show nothing, by a sample of them.
    pub fn hidden_share(&self) -> f64 {
        let Some(tree) = self.shape.trees.first() else { return 0.0 };
        let leaves = Nodes::all(self.shape.lowest(tree)).count() as usize;
        let words = &self.words.of_leaf[tree.first_word as usize..][..leaves];
        // An odd stride meets every place within a brick.
        let stride = (leaves / SAMPLED_LEAVES) | 1;
        let sampled = || words.iter().step_by(stride);
        let hidden = sampled().filter(|word| **word & SHOWS == 0).count();
        hidden as f64 / sampled().count().max(1) as f64
    }

    fn device_bytes(&self, words: &[u32]) -> Vec<u8> {
        let small = words.iter().map(|word| packed(*word, self.bits));
        let mut bytes: Vec<u8> = match self.bits {
            8 => small.map(|word| word as u8).collect(),
            16 => small.flat_map(|word| (word as u16).to_le_bytes()).collect(),
            _ => small.flat_map(u32::to_le_bytes).collect(),
        };
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    /// All leaves alike: what shows of any value shows everywhere.
    fn know_nothing(&mut self) {
        let mut shows = 0;
        for (at, channel) in self.channels.iter().enumerate() {
            let unknown = channel.ranges.coding.unknown();
            let class = class_of(unknown, |range| channel.shows(range));
            shows |= u32::from(class != Class::Nothing) << at;
        }
        self.words = Words::everywhere(&self.shape, shows);
    }

    /// One range for all of a brick's leaves, which are no longer known from its voxels.
    fn say(&mut self, id: BrickId, range: impl Fn(Coding) -> ValueRange) {
        if !has_brick(&self.shape, id) {
            return;
        }
        let level = usize::from(id.level);
        let leaves = self.shape.leaves_of_brick(level, [id.x, id.y, id.z]);
        for at in self.channels_of(id.channel) {
            self.set_learned(at, id, false);
            let range = range(self.channels[at].ranges.coding);
            self.learn(at, level, leaves, |_| Some(range));
        }
    }

    /// Bricks of one block, all their leaves at once: what they share above is made right only once.
    fn take_block(&mut self, at: usize, entries: &[(BrickId, Result<BrickEntry>)]) {
        let format = self.channels[at].judge.format;
        let mut said: Vec<([u32; 3], ValueRange)> = Vec::with_capacity(entries.len());
        for (id, entry) in entries {
            if !has_brick(&self.shape, *id) {
                continue;
            }
            let range = match entry {
                Ok(_) if self.is_learned(at, *id) => continue,
                Ok(entry) => brick_range(entry, format),
                Err(_) => failed_range(Coding::of(format), self.stand_ins),
            };
            self.set_learned(at, *id, false);
            said.push(([id.x, id.y, id.z], range));
        }
        let Some((id, _)) = entries.first() else { return };
        let bricks = said.iter().fold(Nodes::NONE, |bricks, (brick, _)| bricks.with(*brick));
        if bricks.is_empty() {
            return;
        }
        let across: [u32; 2] = std::array::from_fn(|axis| bricks.end[axis] - bricks.start[axis]);
        let index = |brick: [u32; 3]| {
            let [x, y, z] = std::array::from_fn(|axis| brick[axis] - bricks.start[axis]);
            ((z * across[1] + y) * across[0] + x) as usize
        };
        let mut ranges = vec![None; bricks.count() as usize];
        for (brick, range) in said {
            ranges[index(brick)] = Some(range);
        }
        let level = usize::from(id.level);
        let shift = self.shape.leaf_shift(level);
        let leaves = self.shape.leaves_of_bricks(level, bricks);
        self.learn(at, level, leaves, |leaf| {
            ranges[index(std::array::from_fn(|axis| leaf[axis] >> shift[axis]))]
        });
    }

    /// Gives leaves of a level their ranges, and makes what follows from them right.
    fn learn(
        &mut self,
        at: usize,
        level: usize,
        leaves: Nodes,
        of: impl Fn([u32; 3]) -> Option<ValueRange>,
    ) {
        let LeafWords { shape, channels, work, .. } = self;
        let ranges = &mut channels[at].ranges;
        let changed = update_some_ranges(shape, level, ranges, leaves, of, &mut work.ranges);
        if !changed.is_empty() {
            self.update_words(level, changed);
        }
    }

    /// Makes words right again where ranges of these leaves, or what shows of them, have changed.
    fn update_words(&mut self, level: usize, leaves: Nodes) {
        self.with_shown(|words, shape, shown, work| {
            words.update(shape, shown, level, leaves, work)
        });
    }

    /// Changes words by what channels show; `change` says how many changed.
    fn with_shown(&mut self, change: impl FnOnce(&mut Words, &Shape, &[Shown], &mut Work) -> u64) {
        let LeafWords { shape, channels, words, work, .. } = self;
        let take = |channel: &mut Channel| RefCell::new(std::mem::take(&mut channel.memo));
        let memos: Vec<RefCell<Memo>> = channels.iter_mut().map(take).collect();
        let shows: Vec<_> = channels
            .iter()
            .zip(&memos)
            .map(|(channel, memo)| |range: ValueRange| memo.borrow_mut().shows(channel, range))
            .collect();
        let shown: Vec<Shown> = channels
            .iter()
            .zip(&shows)
            .map(|(channel, shows)| Shown {
                ranges: &channel.ranges,
                shows,
                levels: channel.levels,
            })
            .collect();
        work.words_changed += change(words, shape, &shown, &mut work.words);
        for (channel, memo) in channels.iter_mut().zip(memos) {
            channel.memo = memo.into_inner();
        }
    }

    fn channels_of(&self, in_source: u16) -> Vec<usize> {
        let of = |at: &usize| self.channels[*at].in_source == in_source;
        (0..self.channels.len()).filter(of).collect()
    }

    fn brick_number(&self, id: BrickId) -> usize {
        let level = usize::from(id.level);
        let [across, down, _] = self.shape.bricks(level).map(|count| count as usize);
        let [x, y, z] = [id.x, id.y, id.z].map(|at| at as usize);
        self.brick_first[level] + (z * down + y) * across + x
    }

    fn is_learned(&self, at: usize, id: BrickId) -> bool {
        let number = self.brick_number(id);
        self.channels[at].learned[number / 64] >> (number % 64) & 1 == 1
    }

    fn set_learned(&mut self, at: usize, id: BrickId, learned: bool) {
        let number = self.brick_number(id);
        let word = &mut self.channels[at].learned[number / 64];
        *word = *word & !(1 << (number % 64)) | u64::from(learned) << (number % 64);
    }
}

impl Channel {
    /// Whether some value of a range shows.
    fn shows(&self, range: ValueRange) -> bool {
        !self.judge.skipping || !self.judge.hides(range)
    }
}

/// Ranges judged before, since neighbours often have the same one: of each that meets in a place, the last.
#[derive(Default)]
struct Memo {
    judged: Vec<([u32; 2], bool)>,
}

/// A power of two.
const MEMO_PLACES: usize = 1024;
/// Bits of both ends of what no range is: it shows.
const NO_RANGE: ([u32; 2], bool) = ([u32::MAX; 2], true);

impl Memo {
    fn shows(&mut self, channel: &Channel, range: ValueRange) -> bool {
        if self.judged.is_empty() {
            self.judged = vec![NO_RANGE; MEMO_PLACES];
        }
        let ends = [range.least, range.greatest].map(f32::to_bits);
        // The high bits of a product with an odd number depend on all bits of both ends.
        let both = u64::from(ends[0]) << 32 | u64::from(ends[1]);
        let mixed = both.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let place = &mut self.judged[(mixed >> (64 - MEMO_PLACES.ilog2())) as usize];
        if place.0 != ends {
            *place = (ends, channel.shows(range));
        }
        place.1
    }
}

/// What is drawn of a brick that could not be read: nothing, or a coarser one, which may show anything.
fn failed_range(coding: Coding, stand_ins: bool) -> ValueRange {
    if stand_ins { coding.unknown() } else { ValueRange::EMPTY }
}

/// What every leaf of a brick may hold, as far as its entry tells, of what is drawn.
fn brick_range(entry: &BrickEntry, format: VoxelFormat) -> ValueRange {
    let range = entry.range(format);
    if range.is_empty() {
        return ValueRange::EMPTY;
    }
    if range.least.is_nan() || range.greatest.is_nan() {
        return Coding::of(format).unknown();
    }
    let range = ValueRange { least: sanitized(range.least), greatest: sanitized(range.greatest) };
    match (entry, format) {
        // Holes and colours are not in the range.
        (BrickEntry::Stored { .. }, VoxelFormat::F32 | VoxelFormat::Rgba8) => not_one_value(range),
        _ => range,
    }
}

/// Levels that there are, the least of them no greater than the greatest.
fn bounded(levels: [usize; 2], last: usize) -> [usize; 2] {
    [levels[0].min(levels[1]), levels[1]].map(|level| level.min(last))
}

/// Ranges of a brick's leaves; none where the bytes are not this brick's.
fn ranges_of_brick(
    shape: &Shape,
    format: VoxelFormat,
    id: BrickId,
    bytes: &[u8],
) -> Vec<ValueRange> {
    if !has_brick(shape, id) {
        return Vec::new();
    }
    let level = usize::from(id.level);
    let grid = BrickGrid {
        size: Size3::from_array(shape.sizes[level]),
        payload: Size3::from_array(shape.payload),
    };
    let size = grid.stored_size([id.x, id.y, id.z]);
    let mut voxels = Voxels::from_bytes(format, bytes);
    if size.len() != Some(voxels.len()) {
        return Vec::new();
    }
    if let Voxels::F32(values) = &mut voxels {
        // As they are drawn; the infinities themselves are what no value is above.
        values.iter_mut().for_each(|value| *value = sanitized(*value));
    }
    leaf_ranges(&voxels, size, shape.leaf_edges(level))
}

fn has_brick(shape: &Shape, id: BrickId) -> bool {
    let level = usize::from(id.level);
    level < shape.trees.len()
        && [id.x, id.y, id.z].iter().zip(shape.bricks(level)).all(|(at, count)| *at < count)
}

/// Number of the first brick of every level, and of all bricks.
fn brick_first(shape: &Shape) -> Vec<usize> {
    let mut first = vec![0];
    for level in 0..shape.trees.len() {
        let bricks: usize = shape.bricks(level).iter().map(|count| *count as usize).product();
        first.push(first[level] + bricks);
    }
    first
}
