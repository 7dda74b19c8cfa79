//! The voxels of one channel in memory, x fastest, then y, then z.

use crate::volume::{ValueRange, Voxel, VoxelFormat, with_voxel_type};

/// Voxels as stored: no slope, intercept or window applied.
#[derive(Clone, Debug, PartialEq)]
pub enum Voxels {
    /// Unsigned 8 bit.
    U8(Vec<u8>),
    /// Unsigned 16 bit.
    U16(Vec<u16>),
    /// Signed 16 bit.
    I16(Vec<i16>),
    /// Single precision. NaN means "nothing here".
    F32(Vec<f32>),
    /// Red, green, blue, alpha.
    Rgba8(Vec<[u8; 4]>),
}

impl Voxels {
    /// How one voxel is stored.
    pub fn format(&self) -> VoxelFormat {
        match self {
            Voxels::U8(_) => VoxelFormat::U8,
            Voxels::U16(_) => VoxelFormat::U16,
            Voxels::I16(_) => VoxelFormat::I16,
            Voxels::F32(_) => VoxelFormat::F32,
            Voxels::Rgba8(_) => VoxelFormat::Rgba8,
        }
    }

    /// How many voxels there are.
    pub fn len(&self) -> usize {
        match self {
            Voxels::U8(v) => v.len(),
            Voxels::U16(v) => v.len(),
            Voxels::I16(v) => v.len(),
            Voxels::F32(v) => v.len(),
            Voxels::Rgba8(v) => v.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The stored value at `index` (of an RGBA voxel: its alpha), exactly.
    pub fn value(&self, index: usize) -> f32 {
        match self {
            Voxels::U8(v) => f32::from(v[index]),
            Voxels::U16(v) => f32::from(v[index]),
            Voxels::I16(v) => f32::from(v[index]),
            Voxels::F32(v) => v[index],
            Voxels::Rgba8(v) => f32::from(v[index][3]),
        }
    }

    /// Least and greatest stored value, NaN left out (of RGBA voxels: of their alpha).
    pub fn range(&self) -> ValueRange {
        fn integers<T: Copy + Ord + Into<f32>>(values: &[T]) -> ValueRange {
            match (values.iter().min(), values.iter().max()) {
                (Some(&least), Some(&greatest)) => {
                    ValueRange { least: least.into(), greatest: greatest.into() }
                }
                _ => ValueRange::EMPTY,
            }
        }
        match self {
            Voxels::U8(v) => integers(v),
            Voxels::U16(v) => integers(v),
            Voxels::I16(v) => integers(v),
            Voxels::F32(v) => ValueRange::over(v.iter().copied()),
            Voxels::Rgba8(v) => ValueRange::over(v.iter().map(|rgba| f32::from(rgba[3]))),
        }
    }

    /// As bytes, each voxel little endian.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Voxels::U8(v) => v,
            Voxels::U16(v) => bytemuck::cast_slice(v),
            Voxels::I16(v) => bytemuck::cast_slice(v),
            Voxels::F32(v) => bytemuck::cast_slice(v),
            Voxels::Rgba8(v) => bytemuck::cast_slice(v),
        }
    }

    /// From such bytes; a rest shorter than a voxel is left out.
    pub fn from_bytes(format: VoxelFormat, bytes: &[u8]) -> Voxels {
        with_voxel_type!(format, V => {
            let size = format.bytes();
            let whole = &bytes[..bytes.len() / size * size];
            let mut voxels: Vec<V> = vec![bytemuck::Zeroable::zeroed(); whole.len() / size];
            bytemuck::cast_slice_mut(&mut voxels).copy_from_slice(whole);
            V::wrap(voxels)
        })
    }

    /// How many voxels are NaN.
    pub fn nan_count(&self) -> usize {
        match self {
            Voxels::F32(v) => v.iter().filter(|value| value.is_nan()).count(),
            _ => 0,
        }
    }
}

/// A voxel value as it is drawn: infinities become the largest finite value of their sign.
pub fn sanitized(value: f32) -> f32 {
    if value.is_infinite() { f32::MAX.copysign(value) } else { value }
}
