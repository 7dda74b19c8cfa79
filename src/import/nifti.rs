//! NIfTI-1 and NIfTI-2: .nii, .nii.gz and pairs of .hdr and .img, both byte orders.
//!
//! The sform is preferred to the qform, as the standard says; header extensions are passed over.
//! Not supported: complex, 128-bit and single-bit voxels, dimensions beyond x, y, z, time and channel.
//!
//! Source: <https://nifti.nimh.nih.gov/nifti-1>, <https://nifti.nimh.nih.gov/nifti-2>

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream, head};
use crate::import::{Input, Options};
use crate::volume::WorldFromVoxel;

const HEADER_BYTES_V1: usize = 348;
const HEADER_BYTES_V2: usize = 540;

/// Whether a file that starts so is a NIfTI file that is not compressed.
pub fn is_header(head: &[u8]) -> bool {
    Fields::new(head).is_ok()
}

/// Opens a NIfTI file; compression is seen by content.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let coding = Coding::by_magic(&head(path, 4)?);
    let mut stream = Stream::new(Section::of_file(path)?, coding)?;
    let mut bytes = vec![0; HEADER_BYTES_V1];
    let short =
        |why: std::io::Error| Error::input(format!("the NIfTI header cannot be read: {why}"));
    stream.read_exact(&mut bytes).map_err(short)?;
    if matches!(bytes[..4], [0x1c, 2, 0, 0] | [0, 0, 2, 0x1c]) {
        bytes.resize(HEADER_BYTES_V2, 0);
        stream.read_exact(&mut bytes[HEADER_BYTES_V1..]).map_err(short)?;
    }
    let fields = Fields::new(&bytes)?;
    let offset = fields.voxel_offset()?;
    if fields.is_pair() {
        stream = image_of(path)?;
        skip(&mut stream, offset)?;
    } else {
        let skipped = offset.checked_sub(bytes.len() as u64).ok_or_else(|| {
            Error::input(format!("header promises voxels at byte {offset}, inside the header"))
        })?;
        skip(&mut stream, skipped)?;
    }
    let layout = fields.layout()?;
    let mut notes = Vec::new();
    let details = Details {
        format_name: if fields.v2 { "NIfTI-2" } else { "NIfTI-1" },
        world_from_voxel: fields.world_from_voxel(&mut notes)?,
        scaling: fields.scaling(&mut notes),
        unit: fields.unit(),
        notes,
    };
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}

fn skip(stream: &mut Stream, bytes: u64) -> Result<()> {
    stream.skip(bytes).map_err(|why| {
        Error::input(format!("the header is followed by {bytes} bytes before the voxels: {why}"))
    })
}

/// The .img of a .hdr.
fn image_of(path: &Path) -> Result<Stream> {
    let image = ["img", "img.gz"].map(|end| path.with_extension(end));
    let found = image.iter().find(|image| image.is_file()).ok_or_else(|| {
        Error::input(format!("its voxels are in {}, which is missing", image[0].display()))
    })?;
    Stream::new(Section::of_file(found)?, Coding::by_magic(&head(found, 4)?))
}

/// The header's bytes and how to read them.
struct Fields<'a> {
    bytes: &'a [u8],
    big_endian: bool,
    v2: bool,
}

impl Fields<'_> {
    fn new(bytes: &[u8]) -> Result<Fields<'_>> {
        let no = || Error::input("is not a NIfTI file: its header does not start with its size");
        let first: [u8; 4] = bytes.get(..4).and_then(|b| b.try_into().ok()).ok_or_else(no)?;
        let (big_endian, v2) = match (u32::from_le_bytes(first), u32::from_be_bytes(first)) {
            (348, _) => (false, false),
            (_, 348) => (true, false),
            (540, _) => (false, true),
            (_, 540) => (true, true),
            _ => return Err(no()),
        };
        let magic = if v2 { bytes.get(4..8) } else { bytes.get(344..348) };
        match magic {
            Some(b"n+1\0" | b"ni1\0") if !v2 => {}
            Some(b"n+2\0" | b"ni2\0") if v2 => {}
            _ => {
                return Err(Error::input(
                    "is not a NIfTI file: its magic is missing (ANALYZE 7.5 is not supported)",
                ));
            }
        }
        Ok(Fields { bytes, big_endian, v2 })
    }

    fn is_pair(&self) -> bool {
        self.bytes[if self.v2 { 5 } else { 345 }] == b'i'
    }

    fn at<const BYTES: usize>(&self, offset: usize) -> [u8; BYTES] {
        let mut bytes: [u8; BYTES] = std::array::from_fn(|index| {
            // Only a peek at the first bytes of a file can be shorter than its header.
            self.bytes.get(offset + index).copied().unwrap_or(0)
        });
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    /// A real number: f32 at `v1` or f64 at `v2`.
    fn real(&self, v1: usize, v2: usize, index: usize) -> f64 {
        if self.v2 {
            f64::from_le_bytes(self.at(v2 + 8 * index))
        } else {
            f64::from(f32::from_le_bytes(self.at(v1 + 4 * index)))
        }
    }

    fn voxel_offset(&self) -> Result<u64> {
        let offset = if self.v2 { self.i64(168) as f64 } else { self.real(108, 0, 0) };
        if !(0.0..9e15).contains(&offset) || offset.fract() != 0.0 {
            return Err(Error::input(format!("header promises voxels at byte {offset}")));
        }
        Ok(offset as u64)
    }

    fn layout(&self) -> Result<Layout> {
        let dim = |index| {
            if self.v2 { self.i64(16 + 8 * index) } else { i64::from(self.i16(40 + 2 * index)) }
        };
        let dims = dim(0);
        if !(1..=7).contains(&dims) {
            return Err(Error::input(format!("header has {dims} dimensions; 1 to 7 are possible")));
        }
        let mut axes = Vec::new();
        for index in 1..=dims as usize {
            let len = u64::try_from(dim(index))
                .ok()
                .filter(|len| *len > 0)
                .ok_or_else(|| Error::input(format!("dim[{index}] is {}", dim(index))))?;
            match [Axis::X, Axis::Y, Axis::Z, Axis::Time, Axis::Channel].get(index - 1) {
                Some(axis) => axes.push((*axis, len)),
                None if len == 1 => {}
                None => {
                    return Err(Error::input(format!(
                        "dim[{index}] is {len}; dimensions beyond the fifth are not supported"
                    )));
                }
            }
        }
        let code = self.i16(if self.v2 { 12 } else { 70 });
        let sample = match code {
            2 => Sample::U8,
            4 => Sample::I16,
            8 => Sample::I32,
            16 => Sample::F32,
            64 => Sample::F64,
            // Three channels, interleaved.
            128 => Sample::U8,
            256 => Sample::I8,
            512 => Sample::U16,
            768 => Sample::U32,
            1024 => Sample::I64,
            1280 => Sample::U64,
            2304 => Sample::Rgba8,
            _ => {
                return Err(Error::input(format!(
                    "datatype {code} is not supported: integers to 64 bits, f32, f64 and colours are"
                )));
            }
        };
        if code == 128 {
            if axes.iter().any(|(axis, len)| *axis == Axis::Channel && *len > 1) {
                return Err(Error::input("colours in several channels are not supported"));
            }
            axes.retain(|(axis, _)| *axis != Axis::Channel);
            axes.insert(0, (Axis::Channel, 3));
        }
        Ok(Layout { axes, sample, big_endian: self.big_endian })
    }

    fn scaling(&self, notes: &mut Vec<String>) -> (f64, f64) {
        let (slope, intercept) = (self.real(112, 176, 0), self.real(116, 184, 0));
        if slope == 0.0 {
            return (1.0, 0.0);
        }
        if !slope.is_finite() || !intercept.is_finite() {
            notes.push(format!("slope {slope} and intercept {intercept} are ignored"));
            return (1.0, 0.0);
        }
        (slope, intercept)
    }

    fn unit(&self) -> Option<String> {
        let code = if self.v2 { self.i32(500) as u8 } else { self.at::<1>(123)[0] };
        match code & 7 {
            1 => Some("m".to_owned()),
            2 => Some("mm".to_owned()),
            3 => Some("um".to_owned()),
            _ => None,
        }
    }

    fn world_from_voxel(&self, notes: &mut Vec<String>) -> Result<WorldFromVoxel> {
        let code = |v1, v2| if self.v2 { self.i32(v2) } else { i32::from(self.i16(v1)) };
        let (qform, sform) = (code(252, 344), code(254, 348));
        if sform > 0 {
            let rows = std::array::from_fn(|row| {
                std::array::from_fn(|column| self.real(280 + 16 * row, 400 + 32 * row, column))
            });
            match WorldFromVoxel::from_centre_rows(rows) {
                Ok(map) => return Ok(map),
                Err(why) => notes.push(format!("the sform is ignored: {why}")),
            }
        }
        if qform > 0 {
            match WorldFromVoxel::from_centre_rows(self.qform_rows()) {
                Ok(map) => return Ok(map),
                Err(why) => notes.push(format!("the qform is ignored: {why}")),
            }
        }
        notes.push("no usable sform or qform: spacing only, first voxel's centre at 0".to_owned());
        let mut rows = [[0.0; 4]; 3];
        for (axis, row) in rows.iter_mut().enumerate() {
            let spacing = self.real(76, 104, axis + 1).abs();
            row[axis] = if spacing.is_finite() && spacing > 0.0 { spacing } else { 1.0 };
        }
        WorldFromVoxel::from_centre_rows(rows)
    }

    /// Method 2 of the standard: a rotation as a unit quaternion, qfac, spacing and offset.
    fn qform_rows(&self) -> [[f64; 4]; 3] {
        let [b, c, d] = std::array::from_fn(|index| self.real(256, 352, index));
        let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
        let rotation = [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
            [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
            [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ];
        let pixdim = |index| self.real(76, 104, index);
        let qfac = if pixdim(0) < 0.0 { -1.0 } else { 1.0 };
        let spacing = [pixdim(1), pixdim(2), pixdim(3) * qfac];
        std::array::from_fn(|row| {
            std::array::from_fn(|column| match column {
                3 => self.real(268, 376, row),
                _ => rotation[row][column] * spacing[column],
            })
        })
    }
}
