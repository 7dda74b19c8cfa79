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

use rayon::prelude::*;

use crate::import::cut::{Window, loss, stored_planes};
use crate::import::reduce::{Summed, means, sum_sums, sum_voxels};
use crate::import::slices::{Budget, Slices};
use crate::source::Description;
use crate::store::{Compression, Encoded, encode};
use crate::volume::{BRICK_APRON, BrickGrid, BrickId, Level, Size3, ValueRange, Voxels};

/// Voxel bytes that one task cuts and packs: enough to outweigh handing it over.
pub const TASK_BYTES: usize = 256 << 10;

/// Where finished bricks go, in an order that never depends on threads.
pub type Take<'a> = dyn FnMut(BrickId, Encoded) -> io::Result<()> + 'a;

/// How a chain works.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Of the bricks.
    pub compression: Compression,
    /// Bricks tasks that are in memory at once.
    pub tasks: usize,
    /// Keep all of level 0, so that runs may come in any order.
    pub any_order: bool,
    /// Whether some voxels will not come: they are set to the absent value first.
    pub some_absent: bool,
}

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

struct LevelSlices<V> {
    level: Level,
    grid: BrickGrid,
    /// Axes that the next level halves; nothing in the last.
    halved: Option<[bool; 3]>,
    voxels: Slices<V>,
    /// Of the last two slices, in all levels that are summed but level 0.
    sums: Option<Slices<f64>>,
    counts: Option<Slices<f64>>,
    complete: u32,
    next_layer: u32,
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
        let all: Vec<Level> = description.levels.iter().collect();
        let mut levels = Vec::with_capacity(all.len());
        for (number, &level) in all.iter().enumerate().rev() {
            let [x, y, z] = level.size.to_array();
            let kept = match (number, plan.any_order) {
                (0, true) => z,
                _ => z.min(description.payload.z + 2 * BRICK_APRON),
            };
            let next = all.get(number + 1);
            let summed = number > 0 && next.is_some();
            let mut items = |parts: usize, wanted: bool| {
                let size = [x as usize * parts, y as usize];
                wanted.then(|| Slices::new(size, 2.min(z), budget, target)).transpose()
            };
            let sums = items(V::PARTS, summed)?;
            let counts = items(1, summed && V::COUNTED)?;
            levels.push(LevelSlices {
                level,
                grid: BrickGrid { size: level.size, payload: description.payload },
                halved: next
                    .map(|next| std::array::from_fn(|axis| next.scale[axis] != level.scale[axis])),
                voxels: Slices::new([x as usize, y as usize], kept, budget, target)?,
                sums,
                counts,
                complete: 0,
                next_layer: 0,
            });
        }
        levels.reverse();
        Ok(ChainOf {
            channel,
            plan,
            levels,
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
        let level = &self.levels[number];
        let newest = level.complete - 1;
        if let Some(halved) = level.halved {
            let factor = if halved[2] { 2 } else { 1 };
            if (newest + 1).is_multiple_of(factor) || newest + 1 == level.grid.size.z {
                self.reduce(number, newest / factor, newest - newest % factor..newest + 1)?;
                self.levels[number + 1].complete += 1;
                self.advance(number + 1, take)?;
            }
        }
        // The last slice can make two layers possible: its own and the one that has it as apron.
        loop {
            let level = &self.levels[number];
            let size_z = level.grid.size.z;
            let start = level.next_layer.saturating_mul(level.grid.payload.z);
            let end = start.saturating_add(level.grid.payload.z).min(size_z);
            if start >= size_z || level.complete < (end + BRICK_APRON).min(size_z) {
                return Ok(());
            }
            self.cut_layer(number, take)?;
            self.levels[number].next_layer += 1;
        }
    }

    /// Makes slice `coarse_z` of the next level out of `slices` of this one.
    fn reduce(
        &mut self,
        number: usize,
        coarse_z: u32,
        slices: std::ops::Range<u32>,
    ) -> io::Result<()> {
        let size_0 = self.levels[0].grid.size.to_array();
        let (finer, coarser) = self.levels.split_at_mut(number + 1);
        let (finer, coarser) = (&finer[number], &mut coarser[0]);
        let halved = finer.halved.expect("there is a next level");
        let [nx, ny, _] = coarser.grid.size.to_array();
        let covered = |axis: usize, coarse: u32| {
            let scale = u64::from(coarser.level.scale[axis]);
            f64::from((u64::from(size_0[axis]) - u64::from(coarse) * scale).min(scale) as u32)
        };
        let covered_x: Vec<f64> = (0..nx).map(|x| covered(0, x)).collect();
        let fine_rows = finer.grid.size.y as usize;
        let fine_width = finer.grid.size.x as usize;
        let factor_y = if halved[1] { 2 } else { 1 };
        // Blocks of rows as tasks; a batch of them is in memory at once.
        let row_bytes = fine_width * V::PARTS * size_of::<f64>() * factor_y * 2;
        let block = (TASK_BYTES * 4 / row_bytes).clamp(1, ny as usize);
        let starts: Vec<usize> = (0..ny as usize).step_by(block).collect();
        let width = nx as usize * V::PARTS;
        let do_block = |&start: &usize| -> io::Result<_> {
            let rows = block.min(ny as usize - start);
            let fine = start * factor_y..((start + rows) * factor_y).min(fine_rows);
            let mut sums = vec![0.0; rows * width];
            let mut counts = vec![0.0; if V::COUNTED { rows * nx as usize } else { 0 }];
            let mut voxels = vec![V::ABSENT; rows * nx as usize];
            let at = |row: usize| (start + row) * factor_y - fine.start;
            let end = |row: usize| (at(row) + factor_y).min(fine.len());
            if number == 0 {
                let planes = slices
                    .clone()
                    .map(|z| finer.voxels.rows(z, fine.clone()))
                    .collect::<io::Result<Vec<_>>>()?;
                for row in 0..rows {
                    let here = at(row) * fine_width..end(row) * fine_width;
                    let fine: Vec<&[V]> = planes
                        .iter()
                        .flat_map(|plane| plane[here.clone()].chunks_exact(fine_width))
                        .collect();
                    let count_row = row * nx as usize..(row + 1) * nx as usize;
                    let counts = counts.get_mut(count_row).unwrap_or_default();
                    sum_voxels(&fine, halved[0], &mut sums[row * width..(row + 1) * width], counts);
                }
            } else {
                let add = |from: &Slices<f64>, parts: usize, out: &mut [f64]| {
                    let (fine_width, width) = (fine_width * parts, nx as usize * parts);
                    let planes = slices
                        .clone()
                        .map(|z| from.rows(z, fine.clone()))
                        .collect::<io::Result<Vec<_>>>()?;
                    for (row, out) in out.chunks_exact_mut(width).enumerate() {
                        let here = at(row) * fine_width..end(row) * fine_width;
                        let fine: Vec<&[f64]> = planes
                            .iter()
                            .flat_map(|plane| plane[here.clone()].chunks_exact(fine_width))
                            .collect();
                        sum_sums(&fine, parts, halved[0], out);
                    }
                    io::Result::Ok(())
                };
                add(finer.sums.as_ref().expect("kept for the next level"), V::PARTS, &mut sums)?;
                if let Some(from) = &finer.counts {
                    add(from, 1, &mut counts)?;
                }
            }
            for row in 0..rows {
                let here = row * nx as usize..(row + 1) * nx as usize;
                means(
                    &sums[row * width..(row + 1) * width],
                    counts.get(here.clone()).unwrap_or_default(),
                    &covered_x,
                    covered(1, (start + row) as u32) * covered(2, coarse_z),
                    &mut voxels[here],
                );
            }
            Ok((start, sums, counts, voxels))
        };
        for batch in starts.chunks(self.plan.tasks) {
            let done: Vec<_> = if batch.len() == 1 {
                vec![do_block(&batch[0])]
            } else {
                batch.par_iter().map(do_block).collect()
            };
            for block in done {
                let (start, sums, counts, voxels) = block?;
                coarser.voxels.write(coarse_z, start, 0, nx as usize, &voxels)?;
                if let Some(kept) = &mut coarser.sums {
                    kept.write(coarse_z, start, 0, width, &sums)?;
                }
                if let Some(kept) = &mut coarser.counts {
                    kept.write(coarse_z, start, 0, nx as usize, &counts)?;
                }
            }
        }
        Ok(())
    }

    /// Cuts the next layer of bricks of a level and gives them away, row by row.
    fn cut_layer(&mut self, number: usize, take: &mut Take) -> io::Result<()> {
        let level = &self.levels[number];
        let grid = level.grid;
        let layer = level.next_layer;
        let bricks = grid.bricks();
        let brick_bytes = grid.stored_size([0, 0, layer]).len().expect("fits") * size_of::<V>();
        let per_task = (TASK_BYTES / brick_bytes).clamp(1, bricks.x as usize);
        let tasks: Vec<[u32; 2]> = (0..bricks.y)
            .flat_map(|y| (0..bricks.x).step_by(per_task).map(move |x| [x, y]))
            .collect();
        let cut = |&[x, y]: &[u32; 2]| -> io::Result<(BrickId, Encoded)> {
            let end = (x + per_task as u32).min(bricks.x);
            let encoded = cut_bricks(level, self.plan.compression, [x, y, layer], end)?;
            let id =
                BrickId { volume: 0, channel: self.channel, level: number as u8, x, y, z: layer };
            Ok((id, encoded))
        };
        for batch in tasks.chunks(self.plan.tasks) {
            let done: Vec<_> = batch.par_iter().map(cut).collect();
            for bricks in done {
                let (first, encoded) = bricks?;
                if number == 0 {
                    self.range = self.range.union(encoded.range());
                }
                take(first, encoded)?;
            }
        }
        Ok(())
    }
}

/// Bricks (x..end_x, y, z) of a level.
fn cut_bricks<V: Summed>(
    level: &LevelSlices<V>,
    compression: Compression,
    [x, y, z]: [u32; 3],
    end_x: u32,
) -> io::Result<Encoded> {
    let grid = level.grid;
    let [first, last] = [[x, y, z], [end_x - 1, y, z]].map(|brick| grid.payload_box(brick));
    let size = grid.size.to_array();
    let around = |axis: usize| {
        let start = first.start[axis].saturating_sub(BRICK_APRON);
        start..(last.end[axis] + BRICK_APRON).min(size[axis])
    };
    let zs: Vec<u32> = stored_planes(first.start[2], first.end[2], size[2]).collect();
    let mut copies = Vec::new();
    let window = if let Some(planes) = zs.iter().map(|&z| level.voxels.slice(z)).collect() {
        Window { planes, pitch: size[0] as usize, origin: [0, 0] }
    } else {
        let [xs, ys, copied_zs] = [around(0), around(1), around(2)];
        for z in copied_zs.clone() {
            let [y, x] = [&ys, &xs].map(|range| range.start as usize..range.end as usize);
            copies.push(level.voxels.copy_box(z, y, x)?);
        }
        let plane = |&z: &u32| copies[(z - copied_zs.start) as usize].as_slice();
        let planes = zs.iter().map(plane).collect();
        Window { planes, pitch: xs.len(), origin: [xs.start, ys.start] }
    };
    let mut encoded = Encoded::default();
    let mut voxels = Vec::new();
    for x in x..end_x {
        let payload = grid.payload_box([x, y, z]);
        window.cut(grid, payload, &mut voxels);
        let lost = || level.halved.map_or(0.0, |halved| loss(&voxels, payload, grid.size, halved));
        encode(&voxels, grid.stored_size([x, y, z]), compression, lost, &mut encoded);
    }
    Ok(encoded)
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
        for level in self.levels {
            level.voxels.release(budget);
            for kept in [level.sums, level.counts].into_iter().flatten() {
                kept.release(budget);
            }
        }
    }
}
