//! Makes one slice of a level out of the one or two slices of the finer level that it covers.

use std::io;
use std::ops::Range;

use rayon::prelude::*;

use crate::import::level_slices::{LevelSlices, TASK_BYTES};
use crate::import::reduce::{Summed, means, sum_sums, sum_voxels};
use crate::import::slices::Slices;
use crate::volume::Size3;

/// Some coarse rows.
struct Block<V> {
    first_row: usize,
    sums: Vec<f64>,
    counts: Vec<f64>,
    voxels: Vec<V>,
}

/// What all blocks of a slice share.
struct Step<'a, V> {
    finer: &'a LevelSlices<V>,
    halved: [bool; 3],
    /// Finer slices.
    slices: Range<u32>,
    /// Coarse voxels along x.
    width: usize,
    /// Coarse rows.
    rows: usize,
    block_rows: usize,
    /// Level-0 voxels that coarse voxels cover along each axis; along z, that this slice covers.
    covered_x: Vec<f64>,
    covered_y: Vec<f64>,
    covered_z: f64,
}

/// Makes a slice of level `number` + 1 if the newest one of level `number` completes all that it
/// covers; says whether it did. `tasks` blocks are in memory at once.
///
/// # Errors
/// When slices on disk cannot be read or written.
pub fn coarsen_newest<V: Summed>(
    levels: &mut [LevelSlices<V>],
    number: usize,
    tasks: usize,
) -> io::Result<bool> {
    let size_0 = levels[0].grid.size;
    let (finer, coarser) = levels.split_at_mut(number + 1);
    let finer = &finer[number];
    let (Some(halved), Some(coarser)) = (finer.halved, coarser.first_mut()) else {
        return Ok(false);
    };
    let end = finer.complete;
    let factor = if halved[2] { 2 } else { 1 };
    if !end.is_multiple_of(factor) && end != finer.grid.size.z {
        return Ok(false);
    }
    let coarse_z = (end - 1) / factor;
    coarsen(finer, coarser, size_0, coarse_z, coarse_z * factor..end, tasks)?;
    coarser.complete += 1;
    Ok(true)
}

/// Makes slice `coarse_z` of `coarser` out of `slices` of `finer`.
fn coarsen<V: Summed>(
    finer: &LevelSlices<V>,
    coarser: &mut LevelSlices<V>,
    size_0: Size3,
    coarse_z: u32,
    slices: Range<u32>,
    tasks: usize,
) -> io::Result<()> {
    let halved = finer.halved.expect("there is a coarser level");
    let [nx, ny, _] = coarser.grid.size.to_array();
    let covered = |axis: usize, coarse: u32| {
        let scale = u64::from(coarser.level.scale[axis]);
        let left = u64::from(size_0.to_array()[axis]) - u64::from(coarse) * scale;
        left.min(scale) as f64
    };
    // As long as a row of sums and the rows it is made of stay within a task.
    let row_bytes = finer.grid.size.x as usize * V::PARTS * size_of::<f64>() * 4;
    let step = Step {
        finer,
        halved,
        slices,
        width: nx as usize,
        rows: ny as usize,
        block_rows: (4 * TASK_BYTES / row_bytes).clamp(1, ny as usize),
        covered_x: (0..nx).map(|x| covered(0, x)).collect(),
        covered_y: (0..ny).map(|y| covered(1, y)).collect(),
        covered_z: covered(2, coarse_z),
    };
    let starts: Vec<usize> = (0..step.rows).step_by(step.block_rows).collect();
    for batch in starts.chunks(tasks) {
        let done: Vec<_> = match batch {
            // Small slices are not worth handing over.
            [start] => vec![step.block(*start)],
            _ => batch.par_iter().map(|&start| step.block(start)).collect(),
        };
        for block in done {
            let Block { first_row, sums, counts, voxels } = block?;
            coarser.voxels.write(coarse_z, first_row, 0, step.width, &voxels)?;
            if let Some(kept) = &mut coarser.sums {
                kept.write(coarse_z, first_row, 0, step.width * V::PARTS, &sums)?;
            }
            if let Some(kept) = &mut coarser.counts {
                kept.write(coarse_z, first_row, 0, step.width, &counts)?;
            }
        }
    }
    Ok(())
}

impl<V: Summed> Step<'_, V> {
    fn block(&self, first_row: usize) -> io::Result<Block<V>> {
        let rows = self.block_rows.min(self.rows - first_row);
        let voxels = rows * self.width;
        let mut block = Block {
            first_row,
            sums: vec![0.0; voxels * V::PARTS],
            counts: vec![0.0; if V::COUNTED { voxels } else { 0 }],
            voxels: vec![V::ABSENT; voxels],
        };
        if let Some(sums) = &self.finer.sums {
            self.add_sums(sums, V::PARTS, first_row, &mut block.sums)?;
            if let Some(counts) = &self.finer.counts {
                self.add_sums(counts, 1, first_row, &mut block.counts)?;
            }
        } else {
            self.add_voxels(&mut block)?;
        }
        for row in 0..rows {
            let here = row * self.width..(row + 1) * self.width;
            means(
                &block.sums[here.start * V::PARTS..here.end * V::PARTS],
                block.counts.get(here.clone()).unwrap_or_default(),
                &self.covered_x,
                self.covered_y[first_row + row] * self.covered_z,
                &mut block.voxels[here],
            );
        }
        Ok(block)
    }

    /// Finer rows that a coarse row covers.
    fn finer_rows(&self, row: usize) -> Range<usize> {
        let factor = if self.halved[1] { 2 } else { 1 };
        row * factor..((row + 1) * factor).min(self.finer.grid.size.y as usize)
    }

    /// Of level 0, which has no sums yet.
    fn add_voxels(&self, block: &mut Block<V>) -> io::Result<()> {
        let (width, sums_width) = (self.width, self.width * V::PARTS);
        for (row, sums) in block.sums.chunks_exact_mut(sums_width).enumerate() {
            let rows = self.finer_rows(block.first_row + row);
            let planes = self.planes(&self.finer.voxels, rows)?;
            let fine_width = self.finer.grid.size.x as usize;
            let rows: Vec<&[V]> =
                planes.iter().flat_map(|plane| plane.chunks_exact(fine_width)).collect();
            let counts = block.counts.get_mut(row * width..(row + 1) * width);
            sum_voxels(&rows, self.halved[0], sums, counts.unwrap_or_default());
        }
        Ok(())
    }

    /// Of `parts` sums per voxel.
    fn add_sums(
        &self,
        from: &Slices<f64>,
        parts: usize,
        first_row: usize,
        out: &mut [f64],
    ) -> io::Result<()> {
        for (row, out) in out.chunks_exact_mut(self.width * parts).enumerate() {
            let planes = self.planes(from, self.finer_rows(first_row + row))?;
            let fine_width = self.finer.grid.size.x as usize * parts;
            let rows: Vec<&[f64]> =
                planes.iter().flat_map(|plane| plane.chunks_exact(fine_width)).collect();
            sum_sums(&rows, parts, self.halved[0], out);
        }
        Ok(())
    }

    fn planes<'s, T: bytemuck::Pod>(
        &self,
        from: &'s Slices<T>,
        rows: Range<usize>,
    ) -> io::Result<Vec<std::borrow::Cow<'s, [T]>>> {
        self.slices.clone().map(|z| from.rows(z, rows.clone())).collect()
    }
}
