//! The voxel types as one trait, for code that is written once for all formats.

use crate::volume::{ValueRange, VoxelFormat, Voxels};

/// One voxel in memory. Sealed by [`VoxelFormat`]: exactly one type per format.
pub trait Voxel: bytemuck::Pod + PartialEq + Send + Sync {
    /// The format it is.
    const FORMAT: VoxelFormat;
    /// Components: 4 of RGBA, else 1.
    const PARTS: usize;
    /// What stands where the input has no voxel: NaN or transparent black. Integer formats have no
    /// such value and are imported as f32 when they need one.
    const ABSENT: Self;

    /// Takes voxels of this type apart from the others.
    fn of(voxels: &Voxels) -> Option<&[Self]>;
    /// Back into the sum of all types.
    fn wrap(voxels: Vec<Self>) -> Voxels;
    /// Component `part` in f64, exactly.
    fn part(self, part: usize) -> f64;
    /// The voxel whose components are nearest to `parts` (ties to even); `parts` has [`Voxel::PARTS`]
    /// values within the format's range.
    fn nearest(parts: &[f64]) -> Self;
    /// Least and greatest value, NaN left out; of RGBA, of its alpha.
    fn range(voxels: &[Self]) -> ValueRange;
}

/// Rounds to the nearest integer, ties to even: adding 1.5 * 2^52 leaves no bits for a fraction.
/// Exact for |x| < 2^51; plain `round_ties_even` is a function call on x86-64 without SSE 4.1.
fn round_ties_even(x: f64) -> f64 {
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    (x + SHIFT) - SHIFT
}

macro_rules! integer_voxel {
    ($type:ty, $variant:ident) => {
        impl Voxel for $type {
            const FORMAT: VoxelFormat = VoxelFormat::$variant;
            const PARTS: usize = 1;
            const ABSENT: $type = 0;

            fn of(voxels: &Voxels) -> Option<&[$type]> {
                if let Voxels::$variant(v) = voxels { Some(v) } else { None }
            }

            fn wrap(voxels: Vec<$type>) -> Voxels {
                Voxels::$variant(voxels)
            }

            fn part(self, _: usize) -> f64 {
                f64::from(self)
            }

            fn nearest(parts: &[f64]) -> $type {
                round_ties_even(parts[0]) as $type
            }

            fn range(voxels: &[$type]) -> ValueRange {
                let Some(&first) = voxels.first() else { return ValueRange::EMPTY };
                let (mut least, mut greatest) = (first, first);
                for &voxel in voxels {
                    least = least.min(voxel);
                    greatest = greatest.max(voxel);
                }
                ValueRange { least: least.into(), greatest: greatest.into() }
            }
        }
    };
}

integer_voxel!(u8, U8);
integer_voxel!(u16, U16);
integer_voxel!(i16, I16);

impl Voxel for f32 {
    const FORMAT: VoxelFormat = VoxelFormat::F32;
    const PARTS: usize = 1;
    const ABSENT: f32 = f32::NAN;

    fn of(voxels: &Voxels) -> Option<&[f32]> {
        if let Voxels::F32(v) = voxels { Some(v) } else { None }
    }

    fn wrap(voxels: Vec<f32>) -> Voxels {
        Voxels::F32(voxels)
    }

    fn part(self, _: usize) -> f64 {
        f64::from(self)
    }

    fn nearest(parts: &[f64]) -> f32 {
        parts[0] as f32
    }

    fn range(voxels: &[f32]) -> ValueRange {
        // Eight independent lanes; one running minimum would wait for itself.
        const LANES: usize = 8;
        let mut lanes = [ValueRange::EMPTY; LANES];
        let chunks = voxels.chunks_exact(LANES);
        let rest = chunks.remainder();
        for chunk in chunks {
            for (lane, &voxel) in lanes.iter_mut().zip(chunk) {
                *lane = lane.with(voxel);
            }
        }
        let tail = ValueRange::over(rest.iter().copied());
        lanes.into_iter().fold(tail, ValueRange::union)
    }
}

impl Voxel for [u8; 4] {
    const FORMAT: VoxelFormat = VoxelFormat::Rgba8;
    const PARTS: usize = 4;
    const ABSENT: [u8; 4] = [0; 4];

    fn of(voxels: &Voxels) -> Option<&[[u8; 4]]> {
        if let Voxels::Rgba8(v) = voxels { Some(v) } else { None }
    }

    fn wrap(voxels: Vec<[u8; 4]>) -> Voxels {
        Voxels::Rgba8(voxels)
    }

    fn part(self, part: usize) -> f64 {
        f64::from(self[part])
    }

    fn nearest(parts: &[f64]) -> [u8; 4] {
        std::array::from_fn(|part| round_ties_even(parts[part]) as u8)
    }

    fn range(voxels: &[[u8; 4]]) -> ValueRange {
        let alphas = voxels.iter().map(|rgba| rgba[3]);
        let Some((least, greatest)) = alphas.fold(None, |range, alpha| match range {
            None => Some((alpha, alpha)),
            Some((least, greatest)) => Some((alpha.min(least), alpha.max(greatest))),
        }) else {
            return ValueRange::EMPTY;
        };
        ValueRange { least: least.into(), greatest: greatest.into() }
    }
}

/// Calls `$body` with the type alias `$voxel` bound to the voxel type of `$format`.
macro_rules! with_voxel_type {
    ($format:expr, $voxel:ident => $body:expr) => {
        match $format {
            $crate::volume::VoxelFormat::U8 => {
                type $voxel = u8;
                $body
            }
            $crate::volume::VoxelFormat::U16 => {
                type $voxel = u16;
                $body
            }
            $crate::volume::VoxelFormat::I16 => {
                type $voxel = i16;
                $body
            }
            $crate::volume::VoxelFormat::F32 => {
                type $voxel = f32;
                $body
            }
            $crate::volume::VoxelFormat::Rgba8 => {
                type $voxel = [u8; 4];
                $body
            }
        }
    };
}

pub(crate) use with_voxel_type;
