//! How one voxel is stored.

use std::fmt;

use crate::volume::Size3;

/// The type of a stored voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum VoxelFormat {
    /// Unsigned 8 bit.
    U8,
    /// Unsigned 16 bit.
    U16,
    /// Signed 16 bit.
    I16,
    /// IEEE 754 single precision.
    F32,
    /// Red, green, blue and alpha, unsigned 8 bit each.
    Rgba8,
}

impl VoxelFormat {
    /// Every format. A brick store names a format by its place here, so new ones go to the end.
    pub const ALL: [VoxelFormat; 5] =
        [VoxelFormat::U8, VoxelFormat::U16, VoxelFormat::I16, VoxelFormat::F32, VoxelFormat::Rgba8];

    /// Bytes of one voxel.
    pub const fn bytes(self) -> usize {
        match self {
            VoxelFormat::U8 => 1,
            VoxelFormat::U16 | VoxelFormat::I16 => 2,
            VoxelFormat::F32 | VoxelFormat::Rgba8 => 4,
        }
    }

    /// The name used in scenes, flags and messages.
    pub const fn name(self) -> &'static str {
        match self {
            VoxelFormat::U8 => "u8",
            VoxelFormat::U16 => "u16",
            VoxelFormat::I16 => "i16",
            VoxelFormat::F32 => "f32",
            VoxelFormat::Rgba8 => "rgba8",
        }
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Option<VoxelFormat> {
        VoxelFormat::ALL.into_iter().find(|format| format.name() == name)
    }
}

impl fmt::Display for VoxelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How voxels lie in a raw file, which does not say it itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Voxels along each axis, x fastest.
    pub size: Size3,
    /// Type of a voxel.
    pub format: VoxelFormat,
    /// Whether the first byte is the most significant.
    pub big_endian: bool,
}
