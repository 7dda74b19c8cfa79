//! What is done to voxels on their way in: one NaN, no infinities, f32 where absence needs a value.

use crate::volume::{VoxelFormat, Voxels};

/// The format in which voxels are kept: integers have no value for "nothing here", so a channel with
/// absent voxels becomes f32, which holds every u8, u16 and i16 exactly.
pub fn kept_format(format: VoxelFormat, absent_voxels: u64) -> VoxelFormat {
    match format {
        VoxelFormat::U8 | VoxelFormat::U16 | VoxelFormat::I16 if absent_voxels > 0 => {
            VoxelFormat::F32
        }
        format => format,
    }
}

/// How many voxels were changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// NaN, made the one NaN 7FC00000.
    pub nan: u64,
    /// Infinities, made the largest finite value of their sign.
    pub infinite: u64,
}

/// Brings voxels into the kept format.
pub fn convert(voxels: Voxels, format: VoxelFormat) -> (Voxels, Counts) {
    let mut voxels = match (voxels, format) {
        (Voxels::U8(v), VoxelFormat::F32) => Voxels::F32(v.into_iter().map(f32::from).collect()),
        (Voxels::U16(v), VoxelFormat::F32) => Voxels::F32(v.into_iter().map(f32::from).collect()),
        (Voxels::I16(v), VoxelFormat::F32) => Voxels::F32(v.into_iter().map(f32::from).collect()),
        (voxels, _) => voxels,
    };
    assert_eq!(voxels.format(), format, "an input's runs have its header's format");
    let counts = match &mut voxels {
        Voxels::F32(values) => clean(values),
        _ => Counts::default(),
    };
    (voxels, counts)
}

/// Leaves one NaN and no infinities.
pub fn clean(values: &mut [f32]) -> Counts {
    let mut counts = Counts::default();
    for value in values.iter_mut().filter(|value| !value.is_finite()) {
        if value.is_nan() {
            counts.nan += 1;
            *value = f32::NAN;
        } else {
            counts.infinite += 1;
            *value = f32::MAX.copysign(*value);
        }
    }
    counts
}

/// Whether [`clean`] would change nothing.
pub fn is_clean(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite() || value.to_bits() == f32::NAN.to_bits())
}
