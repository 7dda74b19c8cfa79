//! A volume of a scene as bricks, and whole where something needs all of it at once.

use std::sync::{Arc, Mutex, OnceLock};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene;
use crate::source::{BrickSource, ChannelDescription, read_checked};
use crate::volume::{
    BRICK_APRON, BrickBox, BrickId, ChannelVoxels, Macrocells, Size3, ValueRange, VolumeVoxels,
    Voxel, VoxelFormat, Voxels, WorldFromVoxel, with_voxel_type,
};

/// Where a volume's bricks come from, and which channels of it are shown. Cheap to clone.
#[derive(Clone)]
pub struct VolumeData {
    /// Bricks of every level. The channel of a brick is the source's, not the scene's.
    pub source: Arc<dyn BrickSource>,
    /// For each channel of the scene's volume, that of the source.
    pub channels: Vec<u16>,
    world_from_voxel: WorldFromVoxel,
    whole: OnceLock<Arc<VolumeVoxels>>,
    macrocells: OnceLock<Arc<Vec<Macrocells<ValueRange>>>>,
}

impl VolumeData {
    /// Bricks of `source`, of which nothing is read yet.
    ///
    /// # Panics
    /// When the source has no such channel: our own bug, checked on input.
    pub fn new(source: Arc<dyn BrickSource>, channels: Vec<u16>) -> VolumeData {
        let description = source.description();
        let there = description.channels.len();
        assert!(
            channels.iter().all(|channel| usize::from(*channel) < there),
            "channels that exist"
        );
        let world_from_voxel = description.world_from_voxel;
        VolumeData {
            source,
            channels,
            world_from_voxel,
            whole: OnceLock::new(),
            macrocells: OnceLock::new(),
        }
    }

    /// Bricks of `source` that were cut out of `voxels`, all of whose channels are shown in order.
    ///
    /// # Panics
    /// When they do not belong together: our own bug.
    pub fn of_whole(source: Arc<dyn BrickSource>, voxels: Arc<VolumeVoxels>) -> VolumeData {
        let description = source.description();
        assert_eq!(description.size(), voxels.size, "bricks of these voxels");
        assert_eq!(description.world_from_voxel, voxels.world_from_voxel, "at their place");
        assert_eq!(description.channels.len(), voxels.channels.len(), "with their channels");
        let channels = (0..description.channels.len() as u16).collect();
        let data = VolumeData::new(source, channels);
        VolumeData { whole: OnceLock::from(voxels), ..data }
    }

    /// At the place that the scene states, if it states one.
    ///
    /// # Panics
    /// When whole voxels are there already and say another place: our own bug.
    pub(super) fn placed(mut self, volume: &scene::Volume) -> VolumeData {
        if let Some(stated) = volume.world_from_voxel {
            let agrees = |voxels: &Arc<VolumeVoxels>| voxels.world_from_voxel == stated;
            assert!(self.whole.get().is_none_or(agrees), "whole voxels at the scene's place");
            self.world_from_voxel = stated;
        }
        self
    }

    /// Voxel (corner origin) of level 0 to world: the scene's, else the source's own.
    pub fn world_from_voxel(&self) -> WorldFromVoxel {
        self.world_from_voxel
    }

    /// What the source says of each shown channel, in the scene's order.
    pub fn shown(&self) -> impl Iterator<Item = &ChannelDescription> {
        let channels = &self.source.description().channels;
        self.channels.iter().map(|channel| &channels[usize::from(*channel)])
    }

    /// Refuses what [`VolumeData::whole`] would have to gather in more than `ram_mib`. Voxels that are
    /// whole already need nothing more. `remedy` ends the sentence.
    ///
    /// # Errors
    /// One sentence without a place, exit code 3.
    pub fn check_memory(&self, ram_mib: u64, remedy: &str) -> Result<()> {
        if self.whole.get().is_some() {
            return Ok(());
        }
        let size = self.source.description().size();
        let formats: Vec<VoxelFormat> = self.shown().map(|channel| channel.format).collect();
        check_memory(size, &formats, ram_mib, remedy)
    }

    /// Level 0 of the shown channels: the voxels that the bricks were cut out of, else gathered from
    /// all bricks on first use. [`VolumeData::check_memory`] says whether that is allowed.
    ///
    /// # Errors
    /// When a brick cannot be read (exit code 3) or memory does not hold all (4).
    pub fn whole(&self) -> Result<Arc<VolumeVoxels>> {
        if let Some(whole) = self.whole.get() {
            return Ok(whole.clone());
        }
        // Not within the lock: a thread of rayon's that waits here may take up a task that asks too.
        let whole = Arc::new(self.gathered(0)?);
        Ok(self.whole.get_or_init(|| whole).clone())
    }

    /// Ranges of the macrocells of level 0, by shown channel; found on first use.
    ///
    /// # Errors
    /// As [`VolumeData::whole`].
    pub fn macrocells(&self) -> Result<Arc<Vec<Macrocells<ValueRange>>>> {
        if let Some(macrocells) = self.macrocells.get() {
            return Ok(macrocells.clone());
        }
        let whole = self.whole()?;
        let of = |channel: &ChannelVoxels| Macrocells::ranges(&channel.voxels, whole.size);
        let macrocells = Arc::new(whole.channels.iter().map(of).collect());
        Ok(self.macrocells.get_or_init(|| macrocells).clone())
    }

    /// All voxels of a level of the shown channels, level 0 as [`VolumeData::whole`]. A coarser level
    /// takes less memory, and is gathered each time.
    ///
    /// # Errors
    /// As [`VolumeData::whole`].
    ///
    /// # Panics
    /// When there is no such level: our own bug.
    pub fn level(&self, level: u8) -> Result<Arc<VolumeVoxels>> {
        if level == 0 { self.whole() } else { self.gathered(level).map(Arc::new) }
    }

    /// Where the volume ends, in voxels of a level: the outermost of them may reach beyond.
    ///
    /// # Panics
    /// When there is no such level: our own bug.
    pub fn extent_voxel(&self, level: u8) -> [f64; 3] {
        let description = self.source.description();
        let scale = description.levels.get(level).expect("a level that exists").scale;
        let size = description.size().to_array();
        std::array::from_fn(|axis| f64::from(size[axis]) / f64::from(scale[axis]))
    }

    fn gathered(&self, level: u8) -> Result<VolumeVoxels> {
        let there = self.source.description().levels.get(level).expect("a level that exists");
        let channel = |(&number, channel): (&u16, &ChannelDescription)| -> Result<ChannelVoxels> {
            let source = &*self.source;
            let voxels = with_voxel_type!(channel.format, V => gather::<V>(source, number, level))?;
            Ok(ChannelVoxels { voxels, slope: channel.slope, intercept: channel.intercept })
        };
        let channels =
            self.channels.iter().zip(self.shown()).map(channel).collect::<Result<_>>()?;
        let rows = self.world_from_voxel.rows().map(|row| {
            let scaled =
                |axis: usize| row[axis] * there.scale.get(axis).map_or(1.0, |s| f64::from(*s));
            std::array::from_fn(scaled)
        });
        let world_from_voxel =
            if level == 0 { self.world_from_voxel } else { WorldFromVoxel::from_rows(rows)? };
        Ok(VolumeVoxels { size: there.size, world_from_voxel, channels })
    }
}

/// Refuses voxels of these channels that `ram_mib` does not allow; `remedy` ends the sentence.
///
/// # Errors
/// That sentence, without a place; exit code 3.
pub fn check_memory(
    size: Size3,
    formats: &[VoxelFormat],
    ram_mib: u64,
    remedy: &str,
) -> Result<()> {
    let of_voxel: usize = formats.iter().map(|format| format.bytes()).sum();
    let bytes = size.voxel_count() * of_voxel as u128;
    if bytes <= u128::from(ram_mib) << 20 {
        return Ok(());
    }
    let mut names: Vec<&str> = formats.iter().map(|format| format.name()).collect();
    names.dedup();
    Err(Error::input(format!(
        "{size} voxels of {} take {} MiB of memory, but ram_mib is {ram_mib}: {remedy}",
        names.join(", "),
        bytes.div_ceil(1 << 20),
    )))
}

/// A level of one channel out of its bricks. Reading and unpacking is shared among threads.
fn gather<V: Voxel>(source: &dyn BrickSource, channel: u16, level: u8) -> Result<Voxels> {
    let description = source.description();
    let grid = description.grid(level).expect("a level that exists");
    let size = grid.size;
    let refuse = || {
        let (name, bytes) = (&description.name, size.voxel_count() * size_of::<V>() as u128);
        Error::machine(format!(
            "volume \"{name}\" of {size} voxels needs {bytes} bytes of memory at once, which this \
             machine does not give: lower size"
        ))
    };
    let len = size.len().ok_or_else(refuse)?;
    let mut whole: Vec<V> = Vec::new();
    whole.try_reserve_exact(len).map_err(|_| refuse())?;
    whole.resize(len, V::zeroed());
    let shared = Mutex::new(&mut whole);
    let bricks = grid.bricks();
    (0..bricks.y as usize * bricks.z as usize).into_par_iter().try_for_each(|row| {
        let (y, z) = ((row % bricks.y as usize) as u32, (row / bricks.y as usize) as u32);
        let mut bytes = Vec::new();
        (0..bricks.x).try_for_each(|x| {
            let id = BrickId { volume: 0, channel, level, x, y, z };
            read_checked(source, id, &mut bytes)?;
            let (payload, stored) = description.brick(id);
            let mut whole = shared.lock().expect("placing does not panic");
            let whole: &mut [u8] = bytemuck::cast_slice_mut(&mut whole);
            place(whole, size, size_of::<V>(), payload, stored, &bytes);
            Ok(())
        })
    })?;
    Ok(V::wrap(whole))
}

/// Copies a brick's payload, rows of voxels of `width` bytes, to where it belongs.
fn place(
    whole: &mut [u8],
    size: Size3,
    width: usize,
    payload: BrickBox,
    stored: Size3,
    bytes: &[u8],
) {
    let [start_x, start_y, start_z] = payload.start;
    let Size3 { x, y, z } = payload.size();
    let row_bytes = x as usize * width;
    for k in 0..z {
        for j in 0..y {
            let to = size.index(start_x, start_y + j, start_z + k) * width;
            let apron = BRICK_APRON;
            let from = stored.index(apron, j + apron, k + apron) * width;
            whole[to..to + row_bytes].copy_from_slice(&bytes[from..from + row_bytes]);
        }
    }
}
