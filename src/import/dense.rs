//! A whole volume in memory as bricks: the same bricks, entries and description, to the last bit, that
//! a store of the same voxels has.
//!
//! Level 0 is the caller's own voxels, not a copy. Coarser levels are made by import's own reduction,
//! one channel at a time, when one of their bricks is first asked for; together they take about a
//! seventh of level 0. What a brick's entry says is found when it is asked for, and remembered.
//!
//! Invariant: f32 voxels are as a store keeps them, with one NaN and no infinities. Voxels that are
//! not are changed before anything is cut, which copies them when someone else holds them.

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::Result;
use crate::import::convert::{Counts, clean, is_clean};
use crate::import::dense_channel::{DenseChannel, DenseChannelOf};
use crate::source::{BrickEntry, BrickSource, ChannelDescription, Description, no_such_brick};
use crate::volume::{
    BrickId, Levels, Size3, ValueRange, VolumeVoxels, Voxel, Voxels, with_voxel_type,
};

/// Voxels that one task looks at.
const TASK_VOXELS: usize = 1 << 18;

/// See the module.
pub struct DenseVolume {
    description: Description,
    voxels: Arc<VolumeVoxels>,
    channels: Vec<Box<dyn DenseChannel>>,
}

impl DenseVolume {
    /// Cuts `voxels` into bricks of `payload`. Reads them once, for ranges and counts; levels follow
    /// their transform. Voxels that a file lacks are NaN here, and counted so.
    ///
    /// # Panics
    /// When there is no voxel, no channel, or a channel of another length: our own bug.
    pub fn new(name: &str, mut voxels: Arc<VolumeVoxels>, payload: Size3) -> DenseVolume {
        let size = voxels.size;
        assert!(!voxels.channels.is_empty(), "at least one channel");
        for channel in &voxels.channels {
            assert_eq!(channel.voxels.len() as u128, size.voxel_count(), "voxels of {size}");
        }
        let counts: Vec<Counts> =
            (0..voxels.channels.len()).map(|channel| kept(&mut voxels, channel)).collect();
        let world_from_voxel = voxels.world_from_voxel;
        let described =
            voxels.channels.iter().zip(counts).map(|(channel, counts)| ChannelDescription {
                format: channel.voxels.format(),
                slope: channel.slope,
                intercept: channel.intercept,
                nan_voxels: counts.nan,
                infinite_voxels: counts.infinite,
                absent_voxels: 0,
                range: range(&channel.voxels),
            });
        let description = Description {
            name: name.to_owned(),
            payload,
            levels: Levels::of(size, world_from_voxel.spacing().to_array(), payload),
            world_from_voxel,
            unit: None,
            provenance: format!("in memory: {name}, {size}\n"),
            channels: described.collect(),
        };
        let channel = |number: usize| -> Box<dyn DenseChannel> {
            with_voxel_type!(description.channels[number].format, V => {
                Box::new(DenseChannelOf::<V>::new(&description, voxels.clone(), number))
            })
        };
        let channels = (0..description.channels.len()).map(channel).collect();
        DenseVolume { description, voxels, channels }
    }

    /// Level 0: the voxels given, unless some of them had to be changed.
    pub fn voxels(&self) -> &Arc<VolumeVoxels> {
        &self.voxels
    }

    fn channel(&self, id: BrickId) -> Result<&dyn DenseChannel> {
        if !self.description.has(id) {
            return Err(no_such_brick(&self.description, id));
        }
        Ok(&*self.channels[usize::from(id.channel)])
    }
}

impl BrickSource for DenseVolume {
    fn description(&self) -> &Description {
        &self.description
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.channel(id)?.entry(&self.description, id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.channel(id)?.read(&self.description, id, bytes)
    }
}

/// Brings a channel into the form that stores keep, and says what it held before.
fn kept(voxels: &mut Arc<VolumeVoxels>, channel: usize) -> Counts {
    let Voxels::F32(values) = &voxels.channels[channel].voxels else { return Counts::default() };
    if values.par_chunks(TASK_VOXELS).all(is_clean) {
        let nan = |values: &[f32]| values.iter().filter(|value| value.is_nan()).count() as u64;
        return Counts { nan: values.par_chunks(TASK_VOXELS).map(nan).sum(), infinite: 0 };
    }
    match &mut Arc::make_mut(voxels).channels[channel].voxels {
        Voxels::F32(values) => clean(values),
        _ => Counts::default(),
    }
}

fn range(voxels: &Voxels) -> ValueRange {
    with_voxel_type!(voxels.format(), V => {
        let voxels = V::of(voxels).expect("its own format");
        let ranges = voxels.par_chunks(TASK_VOXELS).map(V::range);
        ranges.reduce(|| ValueRange::EMPTY, ValueRange::union)
    })
}
