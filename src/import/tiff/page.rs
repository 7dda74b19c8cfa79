//! What one page holds and where its strips or tiles are.

use crate::error::{Error, Result};
use crate::import::EDGE_VOXELS_MAX;
use crate::import::sample::Sample;
use crate::import::tiff::decode::{Compression, Predictor};
use crate::import::tiff::ifd::{Directory, File};

mod tag {
    pub const KIND: u16 = 254;
    pub const WIDTH: u16 = 256;
    pub const HEIGHT: u16 = 257;
    pub const BITS: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC: u16 = 262;
    pub const FILL_ORDER: u16 = 266;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES: u16 = 277;
    pub const STRIP_ROWS: u16 = 278;
    pub const STRIP_BYTES: u16 = 279;
    pub const PLANAR: u16 = 284;
    pub const PREDICTOR: u16 = 317;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_HEIGHT: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTES: u16 = 325;
    pub const SAMPLE_FORMAT: u16 = 339;
}

/// Samples of one pixel.
const SAMPLES_MAX: u64 = 1 << 12;

/// What all pages of a stack share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    pub width: u32,
    pub height: u32,
    /// Type of a sample, or of a whole pixel of colour with alpha.
    pub sample: Sample,
    /// Channels of a page.
    pub channels: u32,
    /// Whether each channel has strips or tiles of its own.
    pub planar: bool,
    /// 0 where zero is white.
    pub photometric: u64,
}

/// One page, ready to be decoded.
pub struct Page {
    pub shape: Shape,
    pub compression: Compression,
    pub predictor: Predictor,
    /// Width and height of a tile, or of a strip.
    pub piece: [u32; 2],
    pub tiled: bool,
    /// Offset and length in the file of every strip or tile.
    pub pieces: Vec<(u64, u64)>,
}

/// Whether the page is a smaller copy of another.
pub fn is_reduced(file: &File, page: &Directory) -> Result<bool> {
    Ok(file.one(page, tag::KIND)?.unwrap_or(0) & 1 == 1)
}

impl Shape {
    /// Reads and checks it.
    pub fn of(file: &File, page: &Directory) -> Result<Shape> {
        let one = |tag, default| Ok::<u64, Error>(file.one(page, tag)?.unwrap_or(default));
        let edge = |tag| {
            let edge = one(tag, 0)?;
            if edge == 0 || edge > EDGE_VOXELS_MAX {
                return Err(Error::input(format!(
                    "a page promises {edge} pixels along an axis; 1 to {EDGE_VOXELS_MAX} can be read"
                )));
            }
            Ok(edge as u32)
        };
        let samples = one(tag::SAMPLES, 1)?;
        if !(1..=SAMPLES_MAX).contains(&samples) {
            return Err(Error::input(format!("a pixel of {samples} samples is not supported")));
        }
        let all = |tag, default: u64| {
            let values = file.unsigned(page, tag, samples)?.unwrap_or(vec![default]);
            if values.iter().any(|value| *value != values[0]) {
                return Err(Error::input(
                    "samples of different types in one pixel are not supported",
                ));
            }
            Ok(values[0])
        };
        let (bits, format) = (all(tag::BITS, 1)?, all(tag::SAMPLE_FORMAT, 1)?);
        let mut sample = match (format, bits) {
            (1 | 4, 8) => Sample::U8,
            (1 | 4, 16) => Sample::U16,
            (1 | 4, 32) => Sample::U32,
            (1 | 4, 64) => Sample::U64,
            (2, 8) => Sample::I8,
            (2, 16) => Sample::I16,
            (2, 32) => Sample::I32,
            (2, 64) => Sample::I64,
            (3, 16) => Sample::F16,
            (3, 32) => Sample::F32,
            (3, 64) => Sample::F64,
            _ => {
                return Err(Error::input(format!(
                    "samples of {bits} bits in format {format} are not supported: 8 to 64 bits are"
                )));
            }
        };
        if one(tag::FILL_ORDER, 1)? != 1 {
            return Err(Error::input("bits in reversed order (fill order 2) are not supported"));
        }
        let photometric = one(tag::PHOTOMETRIC, 1)?;
        if !matches!(photometric, 0..=5 | 32803 | 34892) {
            return Err(Error::input(format!(
                "pixels of photometric interpretation {photometric} are not supported"
            )));
        }
        let planar = match one(tag::PLANAR, 1)? {
            1 => false,
            2 => samples > 1,
            other => {
                return Err(Error::input(format!("planar configuration {other} is not known")));
            }
        };
        let mut channels = samples as u32;
        if photometric == 2 && samples == 4 && sample == Sample::U8 && !planar {
            (sample, channels) = (Sample::Rgba8, 1);
        }
        let (width, height) = (edge(tag::WIDTH)?, edge(tag::HEIGHT)?);
        Ok(Shape { width, height, sample, channels, planar, photometric })
    }

    /// Bytes of a page, decoded.
    pub fn bytes(&self) -> u128 {
        u128::from(self.width)
            * u128::from(self.height)
            * u128::from(self.channels)
            * self.sample.bytes() as u128
    }

    /// Channels that lie side by side in a strip or tile.
    pub fn channels_together(&self) -> u32 {
        if self.planar { 1 } else { self.channels }
    }
}

impl Page {
    /// Reads and checks it, but for whether its pieces lie in the file.
    pub fn of(file: &File, page: &Directory) -> Result<Page> {
        let shape = Shape::of(file, page)?;
        let one = |tag, default| Ok::<u64, Error>(file.one(page, tag)?.unwrap_or(default));
        let compression = Compression::of(one(tag::COMPRESSION, 1)?)?;
        let predictor = Predictor::of(one(tag::PREDICTOR, 1)?, shape.sample)?;
        let tiled = file.one(page, tag::TILE_WIDTH)?.is_some();
        let piece = if tiled {
            [one(tag::TILE_WIDTH, 0)?, one(tag::TILE_HEIGHT, 0)?]
        } else {
            // "All rows in one strip" is written as 0, as a huge number, or not at all.
            let rows = match one(tag::STRIP_ROWS, u64::MAX)? {
                0 => u64::MAX,
                rows => rows,
            };
            [u64::from(shape.width), rows.min(u64::from(shape.height))]
        };
        if piece.iter().any(|edge| *edge == 0 || *edge > EDGE_VOXELS_MAX) {
            return Err(Error::input(format!(
                "a page promises tiles of {} x {} pixels",
                piece[0], piece[1]
            )));
        }
        let piece = piece.map(|edge| edge as u32);
        let across = u64::from(shape.width.div_ceil(piece[0]));
        let down = u64::from(shape.height.div_ceil(piece[1]));
        let layers = if shape.planar { u64::from(shape.channels) } else { 1 };
        let count = across * down * layers;
        let (offsets, bytes) = if tiled {
            (tag::TILE_OFFSETS, tag::TILE_BYTES)
        } else {
            (tag::STRIP_OFFSETS, tag::STRIP_BYTES)
        };
        let offsets = file
            .unsigned(page, offsets, count)?
            .ok_or_else(|| Error::input("a page does not say where its pixels are"))?;
        let bytes = match file.unsigned(page, bytes, count)? {
            Some(bytes) => bytes,
            // Old writers leave the length of a single strip out.
            None => vec![u64::MAX; offsets.len()],
        };
        if offsets.len() as u64 != count || bytes.len() as u64 != count {
            return Err(Error::input(format!(
                "a page of {count} strips or tiles has {} offsets and {} lengths",
                offsets.len(),
                bytes.len()
            )));
        }
        let pieces = offsets.into_iter().zip(bytes).collect();
        Ok(Page { shape, compression, predictor, piece, tiled, pieces })
    }

    /// Rows of strip `index` of its layer.
    pub fn strip_rows(&self, index: u32) -> u32 {
        self.piece[1].min(self.shape.height - index * self.piece[1])
    }
}
