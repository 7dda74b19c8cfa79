//! Which levels of a channel are resident around each brick: a bit per level and place.
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
//! residency-octree-2023 section 5.3; there every leaf has a mask.

use crate::twins::octree::Nodes;
use crate::twins::octree_ranges::Work;
use crate::twins::octree_shape::Shape;

/// Bricks of one level, as numbers go: levels one after another, finest first, x fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Places {
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Of all finer levels.
    pub first: u32,
    /// Halvings of level 0 that lead to the level, along each axis.
    pub halvings: [u32; 3],
}

impl Places {
    /// Of every level.
    pub fn of(shape: &Shape) -> Vec<Places> {
        let mut first = 0;
        let of_level = |level: usize| {
            let bricks = shape.bricks(level);
            let places = Places { bricks, first, halvings: shape.trees[level].halvings };
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

    /// A brick has arrived. Upwards it stops at the first place that has the level already.
    pub fn arrives(&mut self, level: usize, brick: [u32; 3], work: &mut Work) {
        self.set_beneath(level, brick, true, work);
        let mut at = brick;
        for above in level + 1..self.places.len() {
            at = self.parent(above, at);
            let place = self.places[above].place(at);
            work.looked_at += 1;
            if self.levels[place] >> level & 1 == 1 {
                break;
            }
            self.levels[place] |= 1 << level;
            work.changed += 1;
        }
    }

    /// A brick was given up. Upwards it stops at the first place with another brick of the level.
    pub fn leaves(&mut self, level: usize, brick: [u32; 3], work: &mut Work) {
        self.set_beneath(level, brick, false, work);
        let mut at = brick;
        for above in level + 1..self.places.len() {
            at = self.parent(above, at);
            let (this, finer) = (&self.places[above], &self.places[above - 1]);
            let children = finer.bricks_in(this, Nodes::NONE.with(at));
            work.looked_at += 1;
            if children.each().any(|child| self.levels[finer.place(child)] >> level & 1 == 1) {
                break;
            }
            self.levels[this.place(at)] &= !(1 << level);
            work.changed += 1;
        }
    }

    /// Finest level at or above `level` that is resident around one of its bricks.
    pub fn best(&self, level: usize, brick: [u32; 3]) -> Option<usize> {
        let bits = self.levels[self.places[level].place(brick)] >> level << level;
        (bits != 0).then(|| bits.trailing_zeros() as usize)
    }

    /// The brick of the next coarser level, `above`, around a brick.
    fn parent(&self, above: usize, brick: [u32; 3]) -> [u32; 3] {
        let halved =
            |axis: usize| self.places[above].halvings[axis] - self.places[above - 1].halvings[axis];
        std::array::from_fn(|axis| brick[axis] >> halved(axis))
    }

    fn set_beneath(&mut self, level: usize, brick: [u32; 3], there: bool, work: &mut Work) {
        for finer in 0..=level {
            let (to, from) = (self.places[finer], self.places[level]);
            let bricks = to.bricks_in(&from, Nodes::NONE.with(brick));
            work.looked_at += bricks.count();
            for brick in bricks.each() {
                let bits = &mut self.levels[to.place(brick)];
                let before = *bits;
                *bits = *bits & !(1 << level) | u32::from(there) << level;
                work.changed += u64::from(*bits != before);
            }
        }
    }
}
