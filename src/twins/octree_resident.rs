//! Which levels of a channel are resident around each brick, a bit per level and place; twin of
//! `shaders/octree_resident.comp`.
//!
//! A place's own level and all coarser ones have one brick there, and its bit says whether that is mapped;
//! a finer level's bit says whether any of its bricks in the box is. Nodes smaller than bricks have what
//! their brick has, and are not stored.
//!
//! # Invariants
//! - A finer level's bit is the OR of that bit over the place's children.
//! - A coarser level's bit is that of the place's parent.
//!
//! # Source
//! residency-octree-2023 section 5.3; there every leaf has a mask. The shader goes through coarser levels
//! one after another for all changes, the twin change by change: what follows is the same.

use bytemuck::{Pod, Zeroable};

use crate::twins::limits::CACHE_GROUP;
use crate::twins::octree::Nodes;
use crate::twins::octree_ranges::Work;
use crate::twins::octree_shape::Shape;

/// Bricks of one level, as numbers go: levels one after another, finest first, x fastest.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Places {
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Of all finer levels.
    pub first: u32,
    /// Halvings of level 0 that lead to the level, along each axis.
    pub halvings: [u32; 3],
    /// Nothing.
    pub unused_0: u32,
}

/// A brick that came or went.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Change {
    /// Which.
    pub brick: [u32; 3],
    /// Its level.
    pub level: u32,
    /// The channel's first word.
    pub first_word: u32,
    /// 1: it came; 0: it went.
    pub there: u32,
    /// Nothing.
    pub unused_0: u32,
    /// Nothing.
    pub unused_1: u32,
}

/// Push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Push {
    /// In the list.
    pub first_change: u32,
    /// At most [`CHANGES_MAX`].
    pub change_count: u32,
    /// Of the volume.
    pub level_count: u32,
}

/// Changes of one dispatch: 32 a lane.
pub const CHANGES_MAX: u32 = 32 * CACHE_GROUP;

impl Places {
    /// Of every level.
    pub fn of(shape: &Shape) -> Vec<Places> {
        let mut first = 0;
        let of_level = |level: usize| {
            let bricks = shape.bricks(level);
            let halvings = shape.trees[level].halvings;
            let places = Places { bricks, first, halvings, unused_0: 0 };
            first += bricks.iter().product::<u32>();
            places
        };
        (0..shape.trees.len()).map(of_level).collect()
    }

    /// The place of a brick.
    pub fn place(&self, [x, y, z]: [u32; 3]) -> usize {
        (self.first + (z * self.bricks[1] + y) * self.bricks[0] + x) as usize
    }

    /// Bricks of this level that share space with these of the level `from`.
    fn bricks_in(&self, from: &Places, bricks: Nodes) -> Nodes {
        let moved = |at: u32, axis: usize| {
            let (from, to) = (from.halvings[axis], self.halvings[axis]);
            if to >= from { at >> (to - from) } else { at << (from - to) }
        };
        let end = |axis: usize| match self.halvings[axis] >= from.halvings[axis] {
            true => moved(bricks.end[axis] - 1, axis) + 1,
            false => moved(bricks.end[axis], axis).min(self.bricks[axis]),
        };
        Nodes {
            start: std::array::from_fn(|axis| moved(bricks.start[axis], axis)),
            end: std::array::from_fn(end),
        }
    }
}

/// What is resident of one channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Resident {
    /// Of every level.
    pub places: Vec<Places>,
    /// `[place]` a bit per level.
    pub levels: Vec<u32>,
}

impl Resident {
    /// Nothing.
    pub fn nothing(shape: &Shape) -> Resident {
        let places = Places::of(shape);
        let count =
            places.last().map_or(0, |last| last.first + last.bricks.iter().product::<u32>());
        Resident { places, levels: vec![0; count as usize] }
    }

    /// Another channel took the place, or the source has changed: nothing is resident.
    pub fn forget(&mut self) {
        self.levels.fill(0);
    }

    /// A brick has arrived.
    pub fn arrives(&mut self, level: usize, brick: [u32; 3], work: &mut Work) {
        let change = Change { brick, level: level as u32, there: 1, ..Change::default() };
        octree_resident(&self.places, &mut self.levels, &[change], work);
    }

    /// A brick was given up.
    pub fn leaves(&mut self, level: usize, brick: [u32; 3], work: &mut Work) {
        let change = Change { brick, level: level as u32, ..Change::default() };
        octree_resident(&self.places, &mut self.levels, &[change], work);
    }

    /// Finest level at or above `level` that is resident around one of its bricks.
    pub fn best(&self, level: usize, brick: [u32; 3]) -> Option<usize> {
        let bits = self.levels[self.places[level].place(brick)] >> level << level;
        (bits != 0).then(|| bits.trailing_zeros() as usize)
    }
}

/// Makes the words of all places around the changes right. Upwards it ends at the first place that has
/// the level already, or still.
pub fn octree_resident(places: &[Places], words: &mut [u32], changes: &[Change], work: &mut Work) {
    for change in changes {
        let level = change.level as usize;
        let own = Nodes::NONE.with(change.brick);
        for finer in &places[..=level] {
            for brick in finer.bricks_in(&places[level], own).each() {
                let bits = &mut words[change.first_word as usize + finer.place(brick)];
                let before = *bits;
                *bits = *bits & !(1 << level) | change.there << level;
                work.looked_at += 1;
                work.changed += u64::from(*bits != before);
            }
        }
        for above in level + 1..places.len() {
            let (this, finer) = (&places[above], &places[above - 1]);
            let parent = this.bricks_in(&places[level], own);
            let has = |child: [u32; 3]| {
                words[change.first_word as usize + finer.place(child)] >> level & 1 == 1
            };
            let some = finer.bricks_in(this, parent).each().any(has);
            let bits = &mut words[change.first_word as usize + this.place(parent.start)];
            work.looked_at += 1;
            if *bits >> level & 1 == u32::from(some) {
                break;
            }
            *bits ^= 1 << level;
            work.changed += 1;
        }
    }
}
