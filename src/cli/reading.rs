//! What the command line says about a file that does not say it itself.

use clap::{Args, ValueEnum};

use crate::import::{Options, SegyFields};
use crate::volume::{RawLayout, Size3, VoxelFormat};

/// What the command line says about an input; shared by `import`, `info` and `render`.
#[derive(Args)]
pub struct Reading {
    /// A raw file's voxels along x (fastest), y and z, as in 512x512x512.
    #[arg(long, value_name = "XxYxZ", value_parser = parse_size, requires = "raw_type")]
    raw_size: Option<Size3>,
    /// A raw file's voxel type: u8, u16, i16, f32 or rgba8.
    #[arg(long, value_name = "TYPE", value_parser = parse_type, requires = "raw_size")]
    raw_type: Option<VoxelFormat>,
    /// A raw file's byte order.
    #[arg(long, value_enum, default_value = "little", value_name = "ORDER")]
    raw_endian: Endian,
    /// World length of a voxel along x, y and z; wins over what the file says.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_spacing)]
    spacing: Option<[f64; 3]>,
    /// Which time step of a series, from 0.
    #[arg(long, default_value_t = 0, value_name = "STEP")]
    time: u32,
    /// SEG-Y: first byte of the inline number in a trace header, counted from 1.
    #[arg(long, default_value_t = 189, value_name = "BYTE")]
    segy_inline_byte: u16,
    /// SEG-Y: first byte of the crossline number in a trace header, counted from 1.
    #[arg(long, default_value_t = 193, value_name = "BYTE")]
    segy_crossline_byte: u16,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Endian {
    Little,
    Big,
}

impl Reading {
    /// As readers take it.
    pub fn options(&self) -> Options {
        let raw = self.raw_size.zip(self.raw_type).map(|(size, format)| RawLayout {
            size,
            format,
            big_endian: self.raw_endian == Endian::Big,
        });
        let segy = SegyFields {
            inline_byte: self.segy_inline_byte,
            crossline_byte: self.segy_crossline_byte,
        };
        Options { raw, spacing: self.spacing, time: self.time, segy }
    }
}

/// Numbers between separators.
pub fn parse_numbers<T: std::str::FromStr>(text: &str, separator: char) -> Option<Vec<T>> {
    text.split(separator).map(|part| part.trim().parse().ok()).collect()
}

fn parse_size(text: &str) -> std::result::Result<Size3, String> {
    match parse_numbers::<u32>(text, 'x').as_deref() {
        Some(&[x, y, z]) if x > 0 && y > 0 && z > 0 => Ok(Size3::new(x, y, z)),
        _ => Err("wanted three numbers above 0, as in 512x512x256".to_owned()),
    }
}

fn parse_type(text: &str) -> std::result::Result<VoxelFormat, String> {
    VoxelFormat::from_name(text).ok_or_else(|| "wanted u8, u16, i16, f32 or rgba8".to_owned())
}

fn parse_spacing(text: &str) -> std::result::Result<[f64; 3], String> {
    match parse_numbers::<f64>(text, ',').as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|edge| edge.is_finite() && *edge > 0.0) => {
            Ok([x, y, z])
        }
        _ => Err("wanted three positive numbers, as in 0.5,0.5,2".to_owned()),
    }
}
