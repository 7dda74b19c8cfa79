//! Bricks: boxes of voxels of one level and channel.

use std::fmt;

use crate::volume::Size3;

/// Payload voxels per axis, unless said otherwise.
pub const BRICK_PAYLOAD_DEFAULT: u32 = 32;
/// Neighbour voxels kept on every side of a brick, so that trilinear filtering stays inside it.
pub const BRICK_APRON: u32 = 1;

/// Names one brick of all the bricks of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BrickId {
    /// Index of the volume in the scene.
    pub volume: u16,
    /// Index of the channel in the volume.
    pub channel: u16,
    /// Level, 0 finest.
    pub level: u8,
    /// Brick coordinates at that level.
    pub x: u32,
    /// See `x`.
    pub y: u32,
    /// See `x`.
    pub z: u32,
}

impl fmt::Display for BrickId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let BrickId { channel, level, x, y, z, .. } = self;
        write!(f, "brick (channel {channel}, level {level}, x {x}, y {y}, z {z})")
    }
}

/// How a level's voxels are cut into bricks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickGrid {
    /// Voxels of the level.
    pub size: Size3,
    /// Payload voxels per axis of one brick.
    pub payload: Size3,
}

/// A half-open box of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickBox {
    /// First voxel along each axis.
    pub start: [u32; 3],
    /// One past the last voxel along each axis.
    pub end: [u32; 3],
}

impl BrickGrid {
    /// Bricks along each axis.
    pub fn bricks(&self) -> Size3 {
        Size3::new(
            self.size.x.div_ceil(self.payload.x),
            self.size.y.div_ceil(self.payload.y),
            self.size.z.div_ceil(self.payload.z),
        )
    }

    /// The payload voxels of brick (x, y, z): fewer than the payload at the far edges.
    pub fn payload_box(&self, brick: [u32; 3]) -> BrickBox {
        let payload = self.payload.to_array();
        let size = self.size.to_array();
        let start: [u32; 3] = std::array::from_fn(|axis| brick[axis] * payload[axis]);
        let end =
            std::array::from_fn(|axis| start[axis].saturating_add(payload[axis]).min(size[axis]));
        BrickBox { start, end }
    }

    /// Voxels along each axis that are kept of brick (x, y, z): its payload box and the apron.
    pub fn stored_size(&self, brick: [u32; 3]) -> Size3 {
        let payload = self.payload_box(brick).size();
        let apron = 2 * BRICK_APRON;
        Size3::new(payload.x + apron, payload.y + apron, payload.z + apron)
    }
}

impl BrickBox {
    /// Voxels along each axis.
    pub fn size(&self) -> Size3 {
        Size3::new(
            self.end[0] - self.start[0],
            self.end[1] - self.start[1],
            self.end[2] - self.start[2],
        )
    }
}
