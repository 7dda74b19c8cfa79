//! Takes decoded runs to the chains of their channels, and finished bricks to the writer.

use std::io;
use std::path::Path;

use crossbeam_channel::{Receiver, Sender};

use crate::error::{Error, Result};
use crate::import::Run;
use crate::import::chain::{Chain, ChainOf, Pushed};
use crate::import::convert::Counts;
use crate::import::level_slices::{Plan, Take};
use crate::import::pipeline::{Progress, voxel_bytes};
use crate::import::slices::Budget;
use crate::source::Description;
use crate::store::{Encoded, disk_error};
use crate::volume::{BrickId, with_voxel_type};

/// A run in the kept format, and what was changed in it.
pub type Decoded = Result<(Run, Counts)>;

/// All chains of an import.
pub struct Build<'a> {
    target: &'a Path,
    plan: Plan,
    budget: Budget,
    description: &'a mut Description,
    /// Of channels that have begun and not ended.
    chains: Vec<Option<Box<dyn Chain>>>,
    ended: Vec<bool>,
    /// Of one channel.
    all_voxels: u64,
    done_bytes: u64,
    total_bytes: u64,
}

impl<'a> Build<'a> {
    /// Nothing is taken from `budget` before voxels come. Counts and ranges go to `description`.
    pub fn new(
        target: &'a Path,
        plan: Plan,
        budget: Budget,
        description: &'a mut Description,
    ) -> Build<'a> {
        let channels = description.channels.len();
        // In any order, level 0 is written whole before the first brick is cut: two passes.
        let passes = if plan.any_order { 2 } else { 1 };
        Build {
            target,
            plan,
            budget,
            chains: (0..channels).map(|_| None).collect(),
            ended: vec![false; channels],
            all_voxels: description.size().voxel_count() as u64,
            done_bytes: 0,
            total_bytes: voxel_bytes(description).saturating_mul(passes),
            description,
        }
    }

    /// Takes all runs and makes all bricks.
    ///
    /// # Errors
    /// Of the input, of the disk, or when voxels are missing.
    pub fn run(
        &mut self,
        runs: &Receiver<Decoded>,
        to_writer: &Sender<(BrickId, Encoded)>,
        progress: &mut Progress,
    ) -> Result<Pushed> {
        let mut take = |first: BrickId, encoded: Encoded| {
            to_writer.send((first, encoded)).map_err(|_| io::Error::other("the writer stopped"))
        };
        for run in runs {
            let (run, counts) = run?;
            check(self.description, &run)?;
            if self.push(&run, counts, &mut take)? == Pushed::OutOfOrder {
                return Ok(Pushed::OutOfOrder);
            }
            self.done_bytes += run.voxels.bytes().len() as u64;
            progress(self.done_bytes, self.total_bytes);
        }
        for channel in 0..self.ended.len() {
            if !self.ended[channel] {
                self.end(channel, &mut take, progress)?;
            }
        }
        Ok(Pushed::Taken)
    }

    fn push(&mut self, run: &Run, counts: Counts, take: &mut Take) -> Result<Pushed> {
        let channel = run.channel as usize;
        if self.ended[channel] {
            return Ok(Pushed::OutOfOrder);
        }
        let mut chain = self.chain(channel)?;
        let pushed = chain
            .push(run.start, run.size, &run.voxels, take)
            .map_err(|why| disk_error(self.target, &why))?;
        let row = &mut self.description.channels[channel];
        row.nan_voxels += counts.nan;
        row.infinite_voxels += counts.infinite;
        if chain.delivered() == self.all_voxels && !self.plan.any_order {
            // Its memory is the next channel's.
            row.range = chain.range();
            self.ended[channel] = true;
            chain.release(&mut self.budget);
        } else {
            self.chains[channel] = Some(chain);
        }
        Ok(pushed)
    }

    /// Makes what is left of a channel when all runs have come; one without a run is absent as a
    /// whole.
    fn end(&mut self, channel: usize, take: &mut Take, progress: &mut Progress) -> Result<()> {
        let mut chain = self.chain(channel)?;
        let row = &mut self.description.channels[channel];
        row.absent_voxels = self.all_voxels.saturating_sub(chain.delivered());
        if row.absent_voxels > 0 && !self.plan.some_absent {
            return Err(Error::input(format!(
                "the input ended early: {} of {} voxels of channel {channel} are missing; \
                 fetch a whole copy",
                row.absent_voxels, self.all_voxels
            )));
        }
        let slices = u64::from(self.description.size().z);
        let row = &mut self.description.channels[channel];
        let slice_bytes = self.all_voxels / slices * row.format.bytes() as u64;
        let (before, total) = (self.done_bytes, self.total_bytes);
        let mut slices_done = 0;
        chain
            .end(take, &mut |slices| {
                slices_done = u64::from(slices) * slice_bytes;
                progress((before + slices_done).min(total), total);
            })
            .map_err(|why| disk_error(self.target, &why))?;
        self.done_bytes = (before + slices_done).min(total);
        row.range = chain.range();
        chain.release(&mut self.budget);
        Ok(())
    }

    /// The chain of a channel, begun if need be.
    fn chain(&mut self, channel: usize) -> Result<Box<dyn Chain>> {
        if let Some(chain) = self.chains[channel].take() {
            return Ok(chain);
        }
        let (description, budget) = (&*self.description, &mut self.budget);
        let (number, plan, target) = (channel as u16, self.plan, self.target);
        with_voxel_type!(description.channels[channel].format, V => {
            match ChainOf::<V>::new(description, number, plan, budget, target) {
                Ok(chain) => Ok(Box::new(chain)),
                Err(why) => Err(disk_error(target, &why)),
            }
        })
    }
}

/// A reader that gives runs outside its own volume has a bug; one sentence is kinder than a panic.
fn check(description: &Description, run: &Run) -> Result<()> {
    let size = description.size().to_array();
    let inside = (0..3).all(|axis| {
        let run_size = run.size.to_array()[axis];
        run_size > 0 && run.start[axis].checked_add(run_size).is_some_and(|end| end <= size[axis])
    });
    let whole = run.size.voxel_count() == run.voxels.len() as u128;
    if inside && whole && (run.channel as usize) < description.channels.len() {
        return Ok(());
    }
    Err(Error::input(format!(
        "the reader gave voxels at {:?} of {} outside the volume of {}; please report this file",
        run.start,
        run.size,
        description.size()
    )))
}
