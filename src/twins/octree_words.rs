//! From ranges to words: what shows under the transfer functions, for all channels of a scene at once,
//! and how far up the box reaches in which the same shows.
//!
//! # Invariants
//! - A leaf whose bit is not set shows nothing of the channel, whatever the sample in it.
//! - Whatever lies in the box of a word has that word's channels.
//!
//! # Source
//! residency-octree-2023 section 6.1 and figure 8: the largest node in which all channels are empty. There
//! rays look for it; here it is found when something changes.

use std::ops::Range;

use crate::twins::octree::{
    CHANNELS_MAX, DIFFERS, Nodes, ONE_VALUE, RISE_SHIFT, SHOWS, Tier, Tree,
};
use crate::twins::octree_ranges::{Ranges, Work};
use crate::twins::octree_shape::Shape;
use crate::volume::ValueRange;

/// What a node shows of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Nothing.
    Nothing,
    /// One value everywhere, and it shows.
    OneValue,
    /// Something, or nothing is known.
    Something,
}

/// The class of a range; `shows` says whether some value of a range does.
pub fn class_of(range: ValueRange, shows: impl Fn(ValueRange) -> bool) -> Class {
    if range.is_empty() || !shows(range) {
        Class::Nothing
    } else if range.least == range.greatest {
        Class::OneValue
    } else {
        Class::Something
    }
}

/// A channel that the scene shows.
pub struct Shown<'a> {
    /// Of its nodes.
    pub ranges: &'a Ranges,
    /// Whether some value of a range shows under its transfer function.
    pub shows: &'a dyn Fn(ValueRange) -> bool,
    /// Least and greatest level at which it is drawn.
    pub levels: [usize; 2],
}

impl Shown<'_> {
    /// The level of the channel where rays are in `level`.
    pub fn level(&self, level: usize) -> usize {
        level.clamp(self.levels[0], self.levels[1])
    }
}

/// Words of all trees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Words {
    /// `[leaf]` of all trees: what rays read.
    pub of_leaf: Vec<u32>,
    /// `[node]` of all trees: what all leaves beneath have, without a rise, or [`DIFFERS`].
    pub of_node: Vec<u32>,
    /// Bit for each [`RUN_WORDS`] of `of_leaf`: some of them changed since [`Words::take_changed`].
    changed: Vec<u64>,
}

/// Words of leaves of which it is known only together whether they have changed.
pub const RUN_WORDS: usize = 64;

impl Words {
    /// Of `channels` channels of which nothing is known: all show.
    ///
    /// # Panics
    /// When a word has no room for so many: our own bug, since scenes are checked.
    pub fn unknown(shape: &Shape, channels: usize) -> Words {
        assert!(channels <= CHANNELS_MAX as usize, "{channels} channels in a word");
        Words::everywhere(shape, (1 << channels) - 1)
    }

    /// The same channels show everywhere, with more than one value.
    pub fn everywhere(shape: &Shape, shows: u32) -> Words {
        let mut of_leaf = Vec::with_capacity(shape.words());
        for tree in &shape.trees {
            let word = shows | tree.rise_max << RISE_SHIFT;
            let leaves = Nodes::all(shape.lowest(tree)).count();
            of_leaf.extend(std::iter::repeat_n(word, leaves as usize));
        }
        let runs = of_leaf.len().div_ceil(RUN_WORDS);
        Words {
            of_leaf,
            of_node: vec![shows; shape.nodes()],
            changed: vec![u64::MAX; runs.div_ceil(64)],
        }
    }

    /// Where `of_leaf` has changed since the last call, or since there are words: ranges of whole
    /// [`RUN_WORDS`], save at the end, rising and apart.
    pub fn take_changed(&mut self) -> Vec<Range<usize>> {
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for (index, bits) in self.changed.iter_mut().enumerate() {
            let mut left = std::mem::take(bits);
            while left != 0 {
                let start = (64 * index + left.trailing_zeros() as usize) * RUN_WORDS;
                left &= left - 1;
                let end = (start + RUN_WORDS).min(self.of_leaf.len());
                match ranges.last_mut() {
                    Some(last) if last.end == start => last.end = end,
                    _ if start < end => ranges.push(start..end),
                    _ => {}
                }
            }
        }
        ranges
    }

    /// Makes words right again where ranges of leaves of `level` have changed, in the tree of every level
    /// whose rays meet them, or where a transfer function has. Says how many words of leaves changed.
    pub fn update(
        &mut self,
        shape: &Shape,
        channels: &[Shown],
        level: usize,
        leaves: Nodes,
        work: &mut Work,
    ) -> u64 {
        let from = shape.lowest(&shape.trees[level]);
        let rays = (0..shape.trees.len())
            .filter(|rays| channels.iter().any(|channel| channel.level(*rays) == level));
        let mut changed = 0;
        for rays in rays {
            let to = shape.lowest(&shape.trees[rays]);
            changed += self.update_tree(shape, channels, rays, leaves.in_tier(from, to), work);
        }
        changed
    }

    /// As [`Words::update`], of all leaves of all trees, once each.
    pub fn update_all(&mut self, shape: &Shape, channels: &[Shown], work: &mut Work) -> u64 {
        let trees = shape.trees.iter().enumerate();
        let of = |(level, tree)| {
            self.update_tree(shape, channels, level, Nodes::all(shape.lowest(tree)), work)
        };
        trees.map(of).sum()
    }

    fn update_tree(
        &mut self,
        shape: &Shape,
        channels: &[Shown],
        level: usize,
        leaves: Nodes,
        work: &mut Work,
    ) -> u64 {
        let tree = &shape.trees[level];
        let lowest = shape.lowest(tree);
        let (mut stale, mut changed) = (Nodes::NONE, Nodes::NONE);
        work.looked_at += leaves.count();
        let mut row = vec![0; leaves.end[0].saturating_sub(leaves.start[0]) as usize];
        for start in leaves.rows() {
            words_of_row(shape, channels, level, start, &mut row);
            let first = tree.number(lowest, start);
            let [x, y, z] = start;
            for (at, word) in row.iter().enumerate() {
                let (place, node) = (&mut self.of_node[first + at], [x + at as u32, y, z]);
                if *place != *word {
                    *place = *word;
                    stale = stale.with(node);
                    work.changed += 1;
                } else if word & ONE_VALUE == 0 {
                    continue;
                }
                // Of the same word, the one value may be another.
                changed = changed.with(node);
            }
        }
        // Upwards while something changes; then every leaf under what has changed.
        for index in tree.tier as usize + 1..=(tree.tier + tree.rise_max) as usize {
            let [finer, tier] = [&shape.tiers[index - 1], &shape.tiers[index]];
            let parents = changed.in_tier(finer, tier);
            let mut others = Nodes::NONE;
            changed = Nodes::NONE;
            work.looked_at += parents.count();
            for parent in parents.each() {
                let word = self.word_of_children(shape, channels, level, index, parent);
                let place = &mut self.of_node[tree.number(tier, parent)];
                if *place != word {
                    *place = word;
                    others = others.with(parent);
                    work.changed += 1;
                } else if word == DIFFERS || word & ONE_VALUE == 0 {
                    continue;
                }
                changed = changed.with(parent);
            }
            if changed.is_empty() {
                break;
            }
            stale = stale.joined(others.in_tier(tier, lowest));
        }
        work.looked_at += stale.count();
        let top = (tree.tier + tree.rise_max) as usize;
        let nodes = stale.in_tier(lowest, &shape.tiers[top]);
        self.rise(shape, tree, top, nodes, stale)
    }

    /// Makes words of the leaves `stale` under these nodes of the tier `index` right: they rise to the largest
    /// node in which all leaves have the same. Says how many changed.
    fn rise(
        &mut self,
        shape: &Shape,
        tree: &Tree,
        index: usize,
        nodes: Nodes,
        stale: Nodes,
    ) -> u64 {
        let (tier, lowest) = (&shape.tiers[index], shape.lowest(tree));
        let mut count = 0;
        for node in nodes.each() {
            let word = self.of_node[tree.number(tier, node)];
            let beneath = Nodes::NONE.with(node);
            if word == DIFFERS {
                let finer = &shape.tiers[index - 1];
                let children = beneath.in_tier(tier, finer).common(stale.in_tier(lowest, finer));
                count += match index - 1 > tree.tier as usize {
                    true => self.rise(shape, tree, index - 1, children, stale),
                    // Leaves do not differ from themselves.
                    false => self.rise_not(tree, lowest, children),
                };
                continue;
            }
            let word = word | (index as u32 - tree.tier) << RISE_SHIFT;
            let leaves = beneath.in_tier(tier, lowest).common(stale);
            for start in leaves.rows() {
                let first = (tree.first_word + lowest.index(start)) as usize;
                for at in first..first + (leaves.end[0] - leaves.start[0]) as usize {
                    count += self.put(at, word);
                }
            }
        }
        count
    }

    /// The same of leaves that do not rise.
    fn rise_not(&mut self, tree: &Tree, lowest: &Tier, leaves: Nodes) -> u64 {
        let mut count = 0;
        for start in leaves.rows() {
            let number = tree.number(lowest, start);
            let first = (tree.first_word + lowest.index(start)) as usize;
            for at in 0..leaves.end[0].saturating_sub(leaves.start[0]) as usize {
                count += self.put(first + at, self.of_node[number + at]);
            }
        }
        count
    }

    fn put(&mut self, leaf: usize, word: u32) -> u64 {
        if self.of_leaf[leaf] == word {
            return 0;
        }
        self.of_leaf[leaf] = word;
        let run = leaf / RUN_WORDS;
        self.changed[run / 64] |= 1 << (run % 64);
        1
    }

    /// Equal words of all children, and one value only where they share it.
    fn word_of_children(
        &self,
        shape: &Shape,
        channels: &[Shown],
        level: usize,
        index: usize,
        parent: [u32; 3],
    ) -> u32 {
        let tree = &shape.trees[level];
        let [finer, tier] = [&shape.tiers[index - 1], &shape.tiers[index]];
        let children = Nodes::NONE.with(parent).in_tier(tier, finer);
        let first = self.of_node[tree.number(finer, children.start)];
        let along = (children.end[0] - children.start[0]) as usize;
        let same = |start| {
            let row = &self.of_node[tree.number(finer, start)..][..along];
            row.iter().all(|word| *word == first)
        };
        if first == DIFFERS || !children.rows().all(same) {
            return DIFFERS;
        }
        let shared = |channel: &Shown| {
            let range = range_in(shape, channel, level, index, parent);
            range.least == range.greatest
        };
        let mut shown = channels.iter().enumerate().filter(|(at, _)| first >> at & 1 == 1);
        let one = first & ONE_VALUE == 0 || shown.all(|(_, channel)| shared(channel));
        if one { first } else { DIFFERS }
    }
}

/// The range of what a channel shows in a node of the tier `index` to rays of `level`; of the node around
/// it where the channel's own leaves are larger.
fn range_in(
    shape: &Shape,
    channel: &Shown,
    level: usize,
    index: usize,
    node: [u32; 3],
) -> ValueRange {
    channel.ranges.get(shape.node_around(channel.level(level), index, node))
}

/// Words of a row of leaves along x, without rises.
fn words_of_row(shape: &Shape, channels: &[Shown], level: usize, start: [u32; 3], row: &mut [u32]) {
    let from = shape.lowest(&shape.trees[level]);
    row.fill(ONE_VALUE);
    for (at, channel) in channels.iter().enumerate() {
        let tree = &shape.trees[channel.level(level)];
        // The node around, where the channel's own leaves are larger.
        let tier = &shape.tiers[tree.tier.max(shape.trees[level].tier) as usize];
        let [_, y, z] = from.ancestor(tier, start);
        let first = tree.number(tier, [0, y, z]);
        let shift = tier.shift[0] - from.shift[0];
        // Neighbours often have the same.
        let (mut last, mut class) = (None, Class::Nothing);
        for (x, word) in (start[0]..).zip(&mut *row) {
            let codes = channel.ranges.codes(first + (x >> shift) as usize);
            if last != Some(codes) {
                last = Some(codes);
                class = class_of(channel.ranges.coding.range(codes), channel.shows);
            }
            match class {
                Class::Nothing => {}
                Class::OneValue => *word |= 1 << at,
                Class::Something => *word = (*word | 1 << at) & !ONE_VALUE,
            }
        }
    }
    // Of nothing it is not said that it has one value.
    row.iter_mut().filter(|word| **word & SHOWS == 0).for_each(|word| *word = 0);
}
