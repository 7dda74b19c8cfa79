//! One channel's levels while voxels stream in: each level keeps only the slices that its next bricks
//! and the next coarser level need.
//!
//! A slice of level k that is complete is summed into level k + 1 as soon as the slices it shares coarse
//! voxels with are complete; a layer of bricks is cut as soon as the slice above it is. So all levels
//! are made in one pass, in an order that depends on the voxels' order alone.
//!
//! Invariant: slices below `complete` never change again.

use std::collections::VecDeque;
use std::io;
use std::path::Path;

use crate::import::coarsen::coarsen_newest;
use crate::import::level_slices::{LevelSlices, Plan, Take};
use crate::import::reduce::Summed;
use crate::import::slices::Budget;
use crate::source::Description;
use crate::volume::{BRICK_APRON, Size3, ValueRange, Voxels};

/// What became of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It is in.
    Taken,
    /// It belongs to slices that are done already: start again with [`Plan::any_order`].
    OutOfOrder,
}

/// One channel, whatever its voxel type.
pub trait Chain: Send {
    /// Takes voxels of level 0.
    ///
    /// # Errors
    /// When a file cannot be written, or `take` says so.
    fn push(
        &mut self,
        start: [u32; 3],
        size: Size3,
        voxels: &Voxels,
        take: &mut Take,
    ) -> io::Result<Pushed>;
    /// Makes all bricks that are still to be made. `progress` gets level-0 slices as they are done.
    ///
    /// # Errors
    /// As `push`.
    fn end(&mut self, take: &mut Take, progress: &mut dyn FnMut(u32)) -> io::Result<()>;
    /// Voxels that were pushed.
    fn delivered(&self) -> u64;
    /// Range of level 0 as far as it is cut.
    fn range(&self) -> ValueRange;
    /// Gives its memory back.
    fn release(self: Box<Self>, budget: &mut Budget);
}

/// The chain of a channel of voxel type `V`.
pub struct ChainOf<V> {
    channel: u16,
    plan: Plan,
    levels: Vec<LevelSlices<V>>,
    /// Voxels there are of each slice of level 0 from `levels[0].complete` on.
    covered: VecDeque<u64>,
    /// Slices of level 0 that were set to the absent value.
    opened: u32,
    delivered: u64,
    range: ValueRange,
}

impl<V: Summed> ChainOf<V> {
    /// Takes memory for its slices from `budget`, coarse levels first; the rest goes to disk.
    ///
    /// # Errors
    /// When a file beside `target` cannot be made.
    pub fn new(
        description: &Description,
        channel: u16,
        plan: Plan,
        budget: &mut Budget,
        target: &Path,
    ) -> io::Result<ChainOf<V>> {
        Ok(ChainOf {
            channel,
            plan,
            levels: LevelSlices::all(description, plan, budget, target)?,
            covered: VecDeque::new(),
            opened: 0,
            delivered: 0,
            range: ValueRange::EMPTY,
        })
    }

    /// The first slice of level 0 whose place cannot be used yet.
    fn first_without_place(&self) -> u32 {
        let finest = &self.levels[0];
        let layer_start = finest.next_layer.saturating_mul(finest.grid.payload.z);
        // Summing waits for at most one slice, which the layer's apron keeps as well.
        let needed = layer_start.saturating_sub(BRICK_APRON).min(finest.complete.saturating_sub(1));
        needed.saturating_add(finest.voxels.kept())
    }

    fn push_slice(
        &mut self,
        [x, y, z]: [u32; 3],
        width: u32,
        voxels: &[V],
        take: &mut Take,
    ) -> io::Result<Pushed> {
        while z >= self.first_without_place() {
            // A slice that lacks voxels is complete only if some are known to be absent.
            if !self.plan.some_absent || self.plan.any_order {
                return Ok(Pushed::OutOfOrder);
            }
            self.complete_slice(take)?;
        }
        if z < self.levels[0].complete {
            return Ok(Pushed::OutOfOrder);
        }
        self.open_slices(z + 1)?;
        let finest = &mut self.levels[0];
        finest.voxels.write(z, y as usize, x as usize, width as usize, voxels)?;
        let place = (z - finest.complete) as usize;
        if self.covered.len() <= place {
            self.covered.resize(place + 1, 0);
        }
        self.covered[place] += voxels.len() as u64;
        self.delivered += voxels.len() as u64;
        let whole = u64::from(finest.grid.size.x) * u64::from(finest.grid.size.y);
        while !self.plan.any_order && self.covered.front().is_some_and(|&got| got >= whole) {
            self.complete_slice(take)?;
        }
        Ok(Pushed::Taken)
    }

    fn open_slices(&mut self, end: u32) -> io::Result<()> {
        while self.plan.some_absent && self.opened < end {
            self.levels[0].voxels.fill(self.opened, V::ABSENT)?;
            self.opened += 1;
        }
        Ok(())
    }

    fn complete_slice(&mut self, take: &mut Take) -> io::Result<()> {
        self.open_slices(self.levels[0].complete + 1)?;
        self.covered.pop_front();
        self.levels[0].complete += 1;
        self.advance(0, take)
    }

    /// Does what the newest slice of level `number` makes possible, in all levels.
    fn advance(&mut self, number: usize, take: &mut Take) -> io::Result<()> {
        if coarsen_newest(&mut self.levels, number, self.plan.tasks)? {
            self.advance(number + 1, take)?;
        }
        // The last slice can make two layers possible: its own and the one that has it as apron.
        while self.levels[number].layer_is_ready() {
            let range = &mut self.range;
            let mut take_ranged = |first, encoded: crate::store::Encoded| {
                if number == 0 {
                    *range = range.union(encoded.range());
                }
                take(first, encoded)
            };
            self.levels[number].cut_layer(self.channel, self.plan, &mut take_ranged)?;
        }
        Ok(())
    }
}

impl<V: Summed> Chain for ChainOf<V> {
    fn push(
        &mut self,
        start: [u32; 3],
        size: Size3,
        voxels: &Voxels,
        take: &mut Take,
    ) -> io::Result<Pushed> {
        let voxels = V::of(voxels).expect("voxels were converted to the channel's format");
        let slice = size.x as usize * size.y as usize;
        for (z, voxels) in (start[2]..).zip(voxels.chunks_exact(slice)) {
            let start = [start[0], start[1], z];
            if self.push_slice(start, size.x, voxels, take)? == Pushed::OutOfOrder {
                return Ok(Pushed::OutOfOrder);
            }
        }
        Ok(Pushed::Taken)
    }

    fn end(&mut self, take: &mut Take, progress: &mut dyn FnMut(u32)) -> io::Result<()> {
        while self.levels[0].complete < self.levels[0].grid.size.z {
            self.complete_slice(take)?;
            progress(self.levels[0].complete);
        }
        Ok(())
    }

    fn delivered(&self) -> u64 {
        self.delivered
    }

    fn range(&self) -> ValueRange {
        self.range
    }

    fn release(self: Box<Self>, budget: &mut Budget) {
        self.levels.into_iter().for_each(|level| level.release(budget));
    }
}
