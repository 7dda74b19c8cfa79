//! A whole volume in memory.

use crate::volume::{Size3, Voxels, WorldFromVoxel};

/// One channel's voxels and what their numbers mean.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelVoxels {
    /// As stored.
    pub voxels: Voxels,
    /// Scaled value = slope * stored value + intercept; windows are stated in scaled values.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
}

/// The shown channels of a volume, each at full resolution.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeVoxels {
    /// Voxels along each axis; every channel has as many.
    pub size: Size3,
    /// Voxel (corner origin) to world.
    pub world_from_voxel: WorldFromVoxel,
    /// In the order in which the scene shows them.
    pub channels: Vec<ChannelVoxels>,
}
