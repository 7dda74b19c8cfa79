//! NumPy arrays: .npy, and the first array of .npz archives; C and Fortran order, both byte orders.
//!
//! The last axis is x. Of four axes the first is channels, of five the first two are time and
//! channels. Not supported: complex numbers, records, text, encrypted archives.
//!
//! Source: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream};
use crate::import::text::{numbers, shown};
use crate::import::{Input, Options, zip};
use crate::volume::WorldFromVoxel;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Headers are refused beyond this: real ones have about a hundred bytes.
const HEADER_BYTES_MAX: usize = 1 << 16;

/// Whether a file that starts so is an array.
pub fn is_array(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// Opens a .npy file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let stream = Stream::new(Section::of_file(path)?, Coding::None)?;
    array(stream, "NumPy array", Vec::new(), options)
}

/// Opens the first array of a .npz file.
pub fn open_archive(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let members = zip::members(&Section::of_file(path)?)?;
    let arrays: Vec<_> = members.iter().filter(|member| member.name.ends_with(".npy")).collect();
    let first = arrays.first().ok_or_else(|| Error::input("is an archive with no .npy array"))?;
    let mut notes = Vec::new();
    if arrays.len() > 1 {
        notes.push(format!(
            "only the first of {} arrays is read, {}",
            arrays.len(),
            shown(&first.name)
        ));
    }
    array(first.stream()?, "NumPy archive", notes, options)
        .map_err(|why| why.at(shown(&first.name)))
}

fn array(
    mut stream: Stream,
    format_name: &'static str,
    mut notes: Vec<String>,
    options: &Options,
) -> Result<Box<dyn Input>> {
    let header = header_text(&mut stream)?;
    let (sample, big_endian) = type_of(field(&header, "descr")?)?;
    let fortran = match field(&header, "fortran_order")? {
        "True" => true,
        "False" => false,
        other => {
            return Err(Error::input(format!(
                "fortran_order is \"{}\", not a truth",
                shown(other)
            )));
        }
    };
    let shape: Vec<u64> = numbers("shape", field(&header, "shape")?)?;
    let kinds: &[Axis] = match shape.len() {
        1..=3 => &[Axis::Z, Axis::Y, Axis::X],
        4 => &[Axis::Channel, Axis::Z, Axis::Y, Axis::X],
        5 => &[Axis::Time, Axis::Channel, Axis::Z, Axis::Y, Axis::X],
        other => {
            return Err(Error::input(format!("the array has {other} axes; 1 to 5 can be read")));
        }
    };
    notes.push(
        match shape.len() {
            4 => "axes are read as channel, z, y, x",
            5 => "axes are read as time, channel, z, y, x",
            _ => "the last axis is read as x",
        }
        .to_owned(),
    );
    let kinds = &kinds[kinds.len() - shape.len()..];
    let mut axes: Vec<(Axis, u64)> = kinds.iter().copied().zip(shape).collect();
    if !fortran {
        axes.reverse();
    }
    let details = Details {
        format_name,
        world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3])?,
        scaling: (1.0, 0.0),
        unit: None,
        notes,
    };
    let layout = Layout { axes, sample, big_endian };
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}

fn header_text(stream: &mut Stream) -> Result<String> {
    let short =
        |why: std::io::Error| Error::input(format!("the array's header cannot be read: {why}"));
    let mut start = [0; 8];
    stream.read_exact(&mut start).map_err(short)?;
    if !start.starts_with(MAGIC) {
        return Err(Error::input("is not a NumPy array: its first bytes are wrong"));
    }
    let bytes = match start[6] {
        1 => {
            let mut bytes = [0; 2];
            stream.read_exact(&mut bytes).map_err(short)?;
            usize::from(u16::from_le_bytes(bytes))
        }
        2 | 3 => {
            let mut bytes = [0; 4];
            stream.read_exact(&mut bytes).map_err(short)?;
            u32::from_le_bytes(bytes) as usize
        }
        version => {
            return Err(Error::input(format!("version {version} of NumPy arrays is not known")));
        }
    };
    if bytes > HEADER_BYTES_MAX {
        return Err(Error::input(format!(
            "promises a header of {bytes} bytes; {HEADER_BYTES_MAX} can be read"
        )));
    }
    let mut header = vec![0; bytes];
    stream.read_exact(&mut header).map_err(short)?;
    Ok(String::from_utf8_lossy(&header).into_owned())
}

/// The value of a key of the header's dictionary, without quotes or parentheses.
fn field<'a>(header: &'a str, name: &str) -> Result<&'a str> {
    let missing = || Error::input(format!("the array's header has no \"{name}\""));
    let after = header
        .split_once(&format!("'{name}'"))
        .or_else(|| header.split_once(&format!("\"{name}\"")))
        .and_then(|(_, after)| after.trim_start().strip_prefix(':'))
        .ok_or_else(missing)?
        .trim_start();
    let (open, close) = match after.chars().next() {
        Some('(') => (1, ')'),
        Some(quote @ ('\'' | '"')) => (1, quote),
        Some('[') => return Err(Error::input("an array of records is not supported")),
        _ => (0, ','),
    };
    let value = &after[open..];
    let end = value.find(close).or_else(|| value.find('}')).ok_or_else(missing)?;
    Ok(value[..end].trim())
}

fn type_of(descr: &str) -> Result<(Sample, bool)> {
    let no = || Error::input(format!("arrays of type \"{}\" are not supported", shown(descr)));
    let (big_endian, kind) = match descr.as_bytes() {
        [b'<' | b'|' | b'=', ..] => (false, &descr[1..]),
        [b'>', ..] => (true, &descr[1..]),
        _ => return Err(no()),
    };
    let sample = match kind {
        "u1" | "b1" => Sample::U8,
        "i1" => Sample::I8,
        "u2" => Sample::U16,
        "i2" => Sample::I16,
        "u4" => Sample::U32,
        "i4" => Sample::I32,
        "u8" => Sample::U64,
        "i8" => Sample::I64,
        "f2" => Sample::F16,
        "f4" => Sample::F32,
        "f8" => Sample::F64,
        _ => return Err(no()),
    };
    Ok((sample, big_endian))
}
