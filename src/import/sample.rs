//! How one voxel lies in other people's files, and how it is delivered.

use half::f16;

use crate::volume::{VoxelFormat, Voxels};

/// The type of a voxel in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
    /// IBM System/360 single precision: base 16, 24 bits of fraction.
    Ibm32,
    Rgba8,
}

/// Which elements of a block make a box: element `base + x * stride[0] + y * stride[1] + z * stride[2]`.
#[derive(Clone, Copy, Debug)]
pub struct Gather {
    /// The element of the box's first voxel.
    pub base: usize,
    /// Elements from one voxel to the next along each axis.
    pub stride: [usize; 3],
    /// Voxels along each axis.
    pub size: [usize; 3],
}

impl Sample {
    /// Bytes of one voxel in the file.
    pub fn bytes(self) -> usize {
        match self {
            Sample::U8 | Sample::I8 => 1,
            Sample::U16 | Sample::I16 | Sample::F16 => 2,
            Sample::U32 | Sample::I32 | Sample::F32 | Sample::Ibm32 | Sample::Rgba8 => 4,
            Sample::U64 | Sample::I64 | Sample::F64 => 8,
        }
    }

    /// The name used in messages.
    pub fn name(self) -> &'static str {
        match self {
            Sample::U8 => "u8",
            Sample::I8 => "i8",
            Sample::U16 => "u16",
            Sample::I16 => "i16",
            Sample::U32 => "u32",
            Sample::I32 => "i32",
            Sample::U64 => "u64",
            Sample::I64 => "i64",
            Sample::F16 => "f16",
            Sample::F32 => "f32",
            Sample::F64 => "f64",
            Sample::Ibm32 => "IBM float",
            Sample::Rgba8 => "rgba8",
        }
    }

    /// The narrowest format that holds the samples, exactly where there is one.
    pub fn delivered(self) -> VoxelFormat {
        match self {
            Sample::U8 => VoxelFormat::U8,
            Sample::U16 => VoxelFormat::U16,
            Sample::I8 | Sample::I16 => VoxelFormat::I16,
            Sample::Rgba8 => VoxelFormat::Rgba8,
            _ => VoxelFormat::F32,
        }
    }

    /// What delivering costs, if anything is changed.
    pub fn note(self) -> Option<String> {
        let name = self.name();
        match self {
            Sample::I8 => Some("i8 voxels are delivered as i16, exactly".to_owned()),
            Sample::F16 => Some("f16 voxels are delivered as f32, exactly".to_owned()),
            Sample::U32 | Sample::I32 | Sample::U64 | Sample::I64 => Some(format!(
                "{name} voxels are delivered as f32: whole numbers beyond 16777216 are rounded to 24 bits"
            )),
            Sample::F64 => Some(
                "f64 voxels are delivered as f32: rounded to 24 bits, infinite beyond 3.4e38"
                    .to_owned(),
            ),
            Sample::Ibm32 => Some(
                "IBM floats are delivered as f32: exact from 1.2e-38 to 3.4e38, infinite beyond"
                    .to_owned(),
            ),
            _ => None,
        }
    }

    /// The voxels of a box, as `format`, which is [`Sample::delivered`] or, where the file lacks
    /// voxels, f32.
    pub fn voxels(
        self,
        bytes: &[u8],
        big_endian: bool,
        at: &Gather,
        format: VoxelFormat,
    ) -> Voxels {
        let big = big_endian;
        match (self, format) {
            (Sample::U8, VoxelFormat::U8) => Voxels::U8(read(bytes, big, at, |[b]| b)),
            (Sample::I8, VoxelFormat::I16) => {
                Voxels::I16(read(bytes, big, at, |b| i16::from(i8::from_le_bytes(b))))
            }
            (Sample::U16, VoxelFormat::U16) => {
                Voxels::U16(read(bytes, big, at, u16::from_le_bytes))
            }
            (Sample::I16, VoxelFormat::I16) => {
                Voxels::I16(read(bytes, big, at, i16::from_le_bytes))
            }
            (Sample::Rgba8, _) => Voxels::Rgba8(read(bytes, false, at, |b| b)),
            _ => Voxels::F32(self.floats(bytes, big, at)),
        }
    }

    fn floats(self, bytes: &[u8], big: bool, at: &Gather) -> Vec<f32> {
        match self {
            Sample::U8 => read(bytes, big, at, |[b]| f32::from(b)),
            Sample::I8 => read(bytes, big, at, |b| f32::from(i8::from_le_bytes(b))),
            Sample::U16 => read(bytes, big, at, |b| f32::from(u16::from_le_bytes(b))),
            Sample::I16 => read(bytes, big, at, |b| f32::from(i16::from_le_bytes(b))),
            Sample::U32 => read(bytes, big, at, |b| u32::from_le_bytes(b) as f32),
            Sample::I32 => read(bytes, big, at, |b| i32::from_le_bytes(b) as f32),
            Sample::U64 => read(bytes, big, at, |b| u64::from_le_bytes(b) as f32),
            Sample::I64 => read(bytes, big, at, |b| i64::from_le_bytes(b) as f32),
            Sample::F16 => read(bytes, big, at, |b| f16::from_le_bytes(b).to_f32()),
            Sample::F32 => read(bytes, big, at, f32::from_le_bytes),
            Sample::F64 => read(bytes, big, at, |b| f64::from_le_bytes(b) as f32),
            Sample::Ibm32 => read(bytes, big, at, |b| f32_from_ibm(u32::from_le_bytes(b))),
            // Formats with colour refuse to lack voxels, so no one asks for colour as a number.
            Sample::Rgba8 => read(bytes, false, at, |b: [u8; 4]| f32::from(b[3])),
        }
    }
}

/// Decodes a box; `decode` is given each voxel's bytes, least significant first.
fn read<const BYTES: usize, T>(
    bytes: &[u8],
    big_endian: bool,
    at: &Gather,
    decode: impl Fn([u8; BYTES]) -> T,
) -> Vec<T> {
    if big_endian {
        gather(bytes, at, |mut one: [u8; BYTES]| {
            one.reverse();
            decode(one)
        })
    } else {
        gather(bytes, at, decode)
    }
}

fn gather<const BYTES: usize, T>(
    bytes: &[u8],
    at: &Gather,
    decode: impl Fn([u8; BYTES]) -> T,
) -> Vec<T> {
    let elements = bytes.as_chunks::<BYTES>().0;
    let [nx, ny, nz] = at.size;
    let mut out = Vec::with_capacity(nx * ny * nz);
    for z in 0..nz {
        for y in 0..ny {
            let first = at.base + y * at.stride[1] + z * at.stride[2];
            if at.stride[0] == 1 {
                out.extend(elements[first..first + nx].iter().map(|&one| decode(one)));
            } else {
                out.extend((0..nx).map(|x| decode(elements[first + x * at.stride[0]])));
            }
        }
    }
    out
}

/// Sign, exponent of 16 with a bias of 64, 24 bits of fraction; every normal f32 is met exactly.
fn f32_from_ibm(bits: u32) -> f32 {
    let fraction = f64::from(bits & 0x00ff_ffff) / f64::from(1u32 << 24);
    let exponent = ((bits >> 24) & 0x7f) as i32 - 64;
    let magnitude = fraction * 16f64.powi(exponent);
    (if bits >> 31 == 1 { -magnitude } else { magnitude }) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ibm_floats_by_the_book() {
        // The classic example, -118.625, and its neighbours' limits.
        assert_eq!(f32_from_ibm(0xC276_A000), -118.625);
        assert_eq!(f32_from_ibm(0x4110_0000), 1.0);
        assert_eq!(f32_from_ibm(0), 0.0);
        assert_eq!(f32_from_ibm(0x7fff_ffff), f32::INFINITY);
    }

    #[test]
    fn a_box_is_gathered_from_any_order() {
        // Two by three, the second axis fastest in the file.
        let at = Gather { base: 0, stride: [3, 1, 0], size: [2, 3, 1] };
        let bytes = [0, 0, 0, 1, 0, 2, 1, 0, 1, 1, 1, 2];
        let got = Sample::U16.voxels(&bytes, true, &at, VoxelFormat::U16);
        assert_eq!(got, Voxels::U16(vec![0, 0x100, 1, 0x101, 2, 0x102]));
    }
}
