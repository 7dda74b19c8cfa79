//! One level of a channel while it is made: the slices it keeps, and the bricks cut out of them.

use std::io;
use std::path::Path;

use rayon::prelude::*;

use crate::import::cut::{Window, loss, stored_planes};
use crate::import::reduce::Summed;
use crate::import::slices::{Budget, Slices};
use crate::source::Description;
use crate::store::{Compression, Encoded, encode};
use crate::volume::{BRICK_APRON, BrickBox, BrickGrid, BrickId, Level};

/// Voxel bytes that one task cuts and packs: enough to outweigh handing it over.
pub const TASK_BYTES: usize = 256 << 10;

/// Where finished bricks go, in an order that never depends on threads.
pub type Take<'a> = dyn FnMut(BrickId, Encoded) -> io::Result<()> + 'a;

/// How a chain of levels works.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Of the bricks.
    pub compression: Compression,
    /// Tasks whose results are in memory at once.
    pub tasks: usize,
    /// Keep all of level 0, so that runs may come in any order.
    pub any_order: bool,
    /// Whether some voxels will not come: they are set to the absent value first.
    pub some_absent: bool,
}

/// The last slices of one level.
pub struct LevelSlices<V> {
    /// Its number, 0 finest.
    pub number: u8,
    /// Size and scale.
    pub level: Level,
    /// Its bricks.
    pub grid: BrickGrid,
    /// Axes that the next level halves; nothing in the last.
    pub halved: Option<[bool; 3]>,
    /// As many as a layer of bricks needs.
    pub voxels: Slices<V>,
    /// Sums per component of the last two slices, in all levels that are summed but level 0.
    pub sums: Option<Slices<f64>>,
    /// What was summed, where NaN is left out.
    pub counts: Option<Slices<f64>>,
    /// Slices below it never change again.
    pub complete: u32,
    /// The layer of bricks to be cut next.
    pub next_layer: u32,
}

impl<V: Summed> LevelSlices<V> {
    /// All levels of a channel, finest first; the coarser ones take from `budget` first.
    ///
    /// # Errors
    /// When a file beside `target` cannot be made.
    pub fn all(
        description: &Description,
        plan: Plan,
        budget: &mut Budget,
        target: &Path,
    ) -> io::Result<Vec<LevelSlices<V>>> {
        let of_level = |number: u8| {
            let [x, y, z] = description.levels.get(number).expect("in range").size.to_array();
            let kept = match (number, plan.any_order) {
                (0, true) => z,
                _ => z.min(description.payload.z + 2 * BRICK_APRON),
            };
            LevelSlices::new(description, number, budget, target, |budget| {
                Slices::new([x as usize, y as usize], kept, budget, target)
            })
        };
        let numbers = (0..description.levels.count() as u8).rev();
        let mut levels: Vec<_> = numbers.map(of_level).collect::<io::Result<_>>()?;
        levels.reverse();
        Ok(levels)
    }

    /// One level, with the sums it needs, whose slices `voxels` makes after them.
    ///
    /// # Errors
    /// When a file beside `target` cannot be made.
    pub fn new(
        description: &Description,
        number: u8,
        budget: &mut Budget,
        target: &Path,
        voxels: impl FnOnce(&mut Budget) -> io::Result<Slices<V>>,
    ) -> io::Result<LevelSlices<V>> {
        let level = description.levels.get(number).expect("the caller's own level");
        let next = description.levels.get(number + 1);
        let [x, y, z] = level.size.to_array();
        let summed = number > 0 && next.is_some();
        let mut items = |parts: usize, wanted: bool| {
            let size = [x as usize * parts, y as usize];
            wanted.then(|| Slices::new(size, 2.min(z), budget, target)).transpose()
        };
        let sums = items(V::PARTS, summed)?;
        let counts = items(1, summed && V::COUNTED)?;
        Ok(LevelSlices {
            number,
            level,
            grid: BrickGrid { size: level.size, payload: description.payload },
            halved: next
                .map(|next| std::array::from_fn(|axis| next.scale[axis] != level.scale[axis])),
            voxels: voxels(budget)?,
            sums,
            counts,
            complete: 0,
            next_layer: 0,
        })
    }

    /// Whether all slices are there that the next layer of bricks needs, its apron included.
    pub fn layer_is_ready(&self) -> bool {
        let size_z = self.grid.size.z;
        let start = self.next_layer.saturating_mul(self.grid.payload.z);
        let end = start.saturating_add(self.grid.payload.z).min(size_z);
        start < size_z && self.complete >= (end + BRICK_APRON).min(size_z)
    }

    /// Cuts the next layer of bricks and gives them away, row by row.
    ///
    /// # Errors
    /// When slices on disk cannot be read, or `take` says so.
    pub fn cut_layer(&mut self, channel: u16, plan: Plan, take: &mut Take) -> io::Result<()> {
        let z = self.next_layer;
        let bricks = self.grid.bricks();
        let stored = self.grid.stored_size([0, 0, z]).len().expect("a brick fits memory");
        let per_task = (TASK_BYTES / (stored * size_of::<V>())).clamp(1, bricks.x as usize);
        let tasks: Vec<[u32; 2]> = (0..bricks.y)
            .flat_map(|y| (0..bricks.x).step_by(per_task).map(move |x| [x, y]))
            .collect();
        let cut = |&[x, y]: &[u32; 2]| -> io::Result<(BrickId, Encoded)> {
            let end = (x + per_task as u32).min(bricks.x);
            let id = BrickId { volume: 0, channel, level: self.number, x, y, z };
            Ok((id, self.cut_bricks(id, end, plan.compression)?))
        };
        for batch in tasks.chunks(plan.tasks) {
            let done: Vec<_> = batch.par_iter().map(cut).collect();
            for bricks in done {
                let (first, encoded) = bricks?;
                take(first, encoded)?;
            }
        }
        self.next_layer += 1;
        Ok(())
    }

    /// Bricks from `first` to before x = `end_x`.
    fn cut_bricks(
        &self,
        BrickId { x, y, z, .. }: BrickId,
        end_x: u32,
        compression: Compression,
    ) -> io::Result<Encoded> {
        let grid = self.grid;
        let [first, last] = [[x, y, z], [end_x - 1, y, z]].map(|brick| grid.payload_box(brick));
        let size = grid.size.to_array();
        let around = |axis: usize| {
            let start = first.start[axis].saturating_sub(BRICK_APRON);
            start..(last.end[axis] + BRICK_APRON).min(size[axis])
        };
        let zs: Vec<u32> = stored_planes(first.start[2], first.end[2], size[2]).collect();
        let mut copies = Vec::new();
        let window = if let Some(window) = self.window(&zs) {
            window
        } else {
            let [xs, ys, copied_zs] = [around(0), around(1), around(2)];
            for z in copied_zs.clone() {
                let [y, x] = [&ys, &xs].map(|range| range.start as usize..range.end as usize);
                copies.push(self.voxels.copy_box(z, y, x)?);
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
            let lost = || self.loss(&voxels, payload);
            encode(&voxels, grid.stored_size([x, y, z]), compression, lost, &mut encoded);
        }
        Ok(encoded)
    }

    /// Those slices, if they are in memory.
    pub fn window(&self, zs: &[u32]) -> Option<Window<'_, V>> {
        let planes = zs.iter().map(|&z| self.voxels.slice(z)).collect::<Option<_>>()?;
        Some(Window { planes, pitch: self.grid.size.x as usize, origin: [0, 0] })
    }

    /// What the next level cannot show of a brick with these stored voxels.
    pub fn loss(&self, stored: &[V], payload: BrickBox) -> f32 {
        self.halved.map_or(0.0, |halved| loss(stored, payload, self.grid.size, halved))
    }

    /// Gives its memory back.
    pub fn release(self, budget: &mut Budget) {
        self.voxels.release(budget);
        for kept in [self.sums, self.counts].into_iter().flatten() {
            kept.release(budget);
        }
    }
}
