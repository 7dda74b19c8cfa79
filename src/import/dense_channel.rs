//! One channel of a volume in memory: its levels, and bricks cut out of them.
//!
//! # Source
//! Levels are made slice by slice with the sums of `coarsen`, as in a chain of an import, so that
//! their voxels have the same bits; all slices are kept, since any brick may be asked for at any time.

use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use crate::error::{Error, Result};
use crate::import::coarsen::coarsen_newest;
use crate::import::cut::stored_planes;
use crate::import::level_slices::LevelSlices;
use crate::import::reduce::Summed;
use crate::import::slices::{Budget, Slices};
use crate::source::{BrickEntry, Description};
use crate::store::entry_of;
use crate::volume::{BrickGrid, BrickId, VolumeVoxels};

/// A channel, whatever its voxel type. Ids have been checked.
pub trait DenseChannel: Send + Sync {
    /// As `BrickSource::entry`.
    fn entry(&self, description: &Description, id: BrickId) -> Result<BrickEntry>;
    /// As `BrickSource::read`.
    fn read(&self, description: &Description, id: BrickId, bytes: &mut Vec<u8>) -> Result<()>;
}

/// A channel of voxel type `V`.
pub struct DenseChannelOf<V> {
    voxels: Arc<VolumeVoxels>,
    channel: usize,
    /// Level 0 alone, for bricks that need no other.
    finest: LevelSlices<V>,
    /// All levels, once one above 0 was wanted.
    levels: OnceLock<Result<Vec<LevelSlices<V>>>>,
    /// Of every level: what is known of its bricks, x fastest.
    entries: Vec<Box<[OnceLock<BrickEntry>]>>,
}

impl<V: Summed> DenseChannelOf<V> {
    /// Costs nothing per voxel.
    pub fn new(description: &Description, voxels: Arc<VolumeVoxels>, channel: usize) -> Self {
        let bricks = |level: u8| grid(description, level).bricks().voxel_count();
        let unknown = |level: u8| (0..bricks(level)).map(|_| OnceLock::new()).collect();
        DenseChannelOf {
            finest: finest(description, &voxels, channel),
            entries: (0..description.levels.count() as u8).map(unknown).collect(),
            levels: OnceLock::new(),
            voxels,
            channel,
        }
    }

    fn level(&self, description: &Description, level: u8) -> Result<&LevelSlices<V>> {
        if level == 0 {
            return Ok(&self.finest);
        }
        let made = self.levels.get_or_init(|| self.make_levels(description));
        made.as_ref().map(|levels| &levels[usize::from(level)]).map_err(Clone::clone)
    }

    fn make_levels(&self, description: &Description) -> Result<Vec<LevelSlices<V>>> {
        let refuse = |why: &dyn std::fmt::Display| {
            let name = &description.name;
            Error::machine(format!("volume \"{name}\": cannot make its coarser levels ({why})"))
        };
        // Threads of their own: a worker of the caller's pool that waits here for tasks would take up
        // others of its pool, which may wait for these very levels.
        std::thread::scope(|scope| {
            let making = scope.spawn(|| {
                let pool = rayon::ThreadPoolBuilder::new().build().map_err(|why| refuse(&why))?;
                let make = || levels(description, &self.voxels, self.channel);
                pool.install(make).map_err(|why| refuse(&why))
            });
            making.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    fn cut(&self, description: &Description, id: BrickId) -> Result<(&LevelSlices<V>, Vec<V>)> {
        let level = self.level(description, id.level)?;
        let payload = level.grid.payload_box([id.x, id.y, id.z]);
        let zs: Vec<u32> =
            stored_planes(payload.start[2], payload.end[2], level.grid.size.z).collect();
        let mut voxels = Vec::new();
        level.window(&zs).expect("every slice is in memory").cut(level.grid, payload, &mut voxels);
        Ok((level, voxels))
    }
}

impl<V: Summed> DenseChannel for DenseChannelOf<V> {
    fn entry(&self, description: &Description, id: BrickId) -> Result<BrickEntry> {
        let bricks = grid(description, id.level).bricks();
        let entry = &self.entries[usize::from(id.level)][bricks.index(id.x, id.y, id.z)];
        if let Some(known) = entry.get() {
            return Ok(*known);
        }
        let (level, voxels) = self.cut(description, id)?;
        let payload = level.grid.payload_box([id.x, id.y, id.z]);
        let found = entry_of(&voxels, || level.loss(&voxels, payload));
        Ok(*entry.get_or_init(|| found))
    }

    fn read(&self, description: &Description, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        let (_, voxels) = self.cut(description, id)?;
        bytes.clear();
        bytes.extend_from_slice(bytemuck::cast_slice(&voxels));
        Ok(())
    }
}

/// The voxels of one channel.
struct OfChannel(Arc<VolumeVoxels>, usize);

impl<V: Summed> AsRef<[V]> for OfChannel {
    fn as_ref(&self) -> &[V] {
        V::of(&self.0.channels[self.1].voxels).expect("the channel's own format")
    }
}

fn grid(description: &Description, level: u8) -> BrickGrid {
    description.grid(level).expect("the id was checked")
}

/// More than any memory: every slice stays there.
fn budget() -> Budget {
    Budget::new(u64::MAX)
}

/// With an endless budget no file is ever made, so there is no folder to make it in.
const NOWHERE: &str = "";

fn finest<V: Summed>(
    description: &Description,
    voxels: &Arc<VolumeVoxels>,
    channel: usize,
) -> LevelSlices<V> {
    let items = Arc::new(OfChannel(voxels.clone(), channel));
    let [x, y, z] = description.size().to_array();
    LevelSlices::new(description, 0, &mut budget(), Path::new(NOWHERE), |_| {
        Ok(Slices::shared([x as usize, y as usize], z, items))
    })
    .expect("level 0 has no sums, so nothing is made")
}

fn levels<V: Summed>(
    description: &Description,
    voxels: &Arc<VolumeVoxels>,
    channel: usize,
) -> io::Result<Vec<LevelSlices<V>>> {
    let (mut budget, nowhere) = (budget(), Path::new(NOWHERE));
    let mut levels = vec![finest(description, voxels, channel)];
    for (number, level) in description.levels.iter().enumerate().skip(1) {
        let [x, y, z] = level.size.to_array();
        let slices =
            |budget: &mut Budget| Slices::new([x as usize, y as usize], z, budget, nowhere);
        levels.push(LevelSlices::new(description, number as u8, &mut budget, nowhere, slices)?);
    }
    let tasks = rayon::current_num_threads();
    for _ in 0..description.size().z {
        levels[0].complete += 1;
        let mut number = 0;
        while coarsen_newest(&mut levels, number, tasks)? {
            number += 1;
        }
    }
    for level in &mut levels {
        (level.sums, level.counts) = (None, None);
    }
    Ok(levels)
}
