//! VTK ImageData (.vti): inline base64 and appended data, raw or base64; none, zlib and LZ4.
//!
//! The active scalars are read, else the first array; components are channels. Points are voxel
//! centres, cells are voxels. Not supported: several pieces, voxels as text, LZMA.
//!
//! Source: VTK XML file formats, <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>

mod packed;

use std::io::{BufReader, Read};
use std::path::Path;

use crate::error::{Error, Result};
use crate::import::base64::Base64;
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream};
use crate::import::text::{number, numbers, shown};
use crate::import::xml::{Tag, Tags};
use crate::import::{Input, Options};
use crate::volume::WorldFromVoxel;
use packed::{Compressor, Numbers};

/// Arrays that are looked at before giving up.
const ARRAYS_MAX: usize = 1 << 12;

/// Whether a file that starts so is one of VTK's.
pub fn is_header(head: &[u8]) -> bool {
    head.windows(8).any(|eight| eight == b"<VTKFile")
}

/// Opens a .vti file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let file = Section::of_file(path)?;
    let header = Found::scan(&file)?;
    let array = header.chosen()?;
    let layout = header.layout(array)?;
    let mut notes = Vec::new();
    if header.arrays.len() > 1 {
        notes.push(format!(
            "only the array \"{}\" is read",
            shown(array.tag.get("Name").unwrap_or(""))
        ));
    }
    if array.of_cells {
        notes.push("cells are read as voxels".to_owned());
    }
    let details = Details {
        format_name: "VTK ImageData",
        world_from_voxel: header.world_from_voxel(array)?,
        scaling: (1.0, 0.0),
        unit: None,
        notes,
    };
    layout.checked_size()?;
    let stream = header.stream(&file, array, layout.bytes())?;
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}

/// What the tags said.
#[derive(Default)]
struct Found {
    file: Option<Tag>,
    image: Option<Tag>,
    piece: Option<Tag>,
    /// The names of the active scalars of points and of cells.
    scalars: [Option<String>; 2],
    arrays: Vec<Array>,
    /// Encoding of the appended data, and where they begin.
    appended: Option<(String, u64)>,
}

struct Array {
    tag: Tag,
    of_cells: bool,
    /// Where its text begins.
    text: u64,
}

impl Found {
    fn scan(file: &Section) -> Result<Found> {
        let mut tags = Tags::new(BufReader::with_capacity(64 << 10, file.clone()));
        let mut found = Found::default();
        let mut inside = None;
        while let Some(tag) = tags.next()? {
            match tag.name.as_str() {
                "VTKFile" => found.file = Some(tag),
                "ImageData" => found.image = Some(tag),
                "Piece" if found.piece.is_some() => {
                    return Err(Error::input("several pieces are not supported: write one piece"));
                }
                "Piece" => found.piece = Some(tag),
                "PointData" | "CellData" => {
                    let of_cells = tag.name == "CellData";
                    inside = Some(of_cells);
                    found.scalars[usize::from(of_cells)] = tag.get("Scalars").map(str::to_owned);
                }
                "/PointData" | "/CellData" => inside = None,
                "DataArray" => {
                    let Some(of_cells) = inside else { continue };
                    if found.arrays.len() == ARRAYS_MAX {
                        return Err(Error::input(format!("has more than {ARRAYS_MAX} arrays")));
                    }
                    let is_inline = tag.get("format") != Some("appended");
                    let is_active = !of_cells
                        && found.scalars[0]
                            .as_deref()
                            .is_none_or(|name| tag.get("Name") == Some(name));
                    found.arrays.push(Array { tag, of_cells, text: tags.offset() });
                    // Nothing behind the active scalars' text is of interest.
                    if is_inline && is_active {
                        break;
                    }
                }
                "AppendedData" => {
                    let encoding = tag.get("encoding").unwrap_or("raw").to_owned();
                    found.appended = Some((encoding, after_underscore(file, tags.offset())?));
                    break;
                }
                _ => {}
            }
        }
        Ok(found)
    }

    fn chosen(&self) -> Result<&Array> {
        let of = |cells: bool| self.arrays.iter().filter(move |array| array.of_cells == cells);
        for (cells, scalars) in [false, true].into_iter().zip(&self.scalars) {
            let named = of(cells).find(|array| array.tag.get("Name") == scalars.as_deref());
            if let Some(array) = named.or_else(|| of(cells).next()) {
                return Ok(array);
            }
        }
        Err(Error::input("has no array of points or cells"))
    }

    fn attribute<'a>(tag: &'a Option<Tag>, name: &str) -> Option<&'a str> {
        tag.as_ref().and_then(|tag| tag.get(name))
    }

    /// First and last point along each axis.
    fn extent(&self) -> Result<[[i64; 2]; 3]> {
        let text = Found::attribute(&self.piece, "Extent")
            .or_else(|| Found::attribute(&self.image, "WholeExtent"))
            .ok_or_else(|| Error::input("has no Extent"))?;
        let extent: Vec<i64> = numbers("Extent", text)?;
        match extent[..] {
            [x0, x1, y0, y1, z0, z1] => Ok([[x0, x1], [y0, y1], [z0, z1]]),
            _ => Err(Error::input(format!("Extent \"{}\" is not six numbers", shown(text)))),
        }
    }

    fn layout(&self, array: &Array) -> Result<Layout> {
        if Found::attribute(&self.file, "type") != Some("ImageData") {
            return Err(Error::input("is a VTK file, but not one of ImageData"));
        }
        let name = array.tag.get("type").unwrap_or("");
        let sample = match name {
            "UInt8" => Sample::U8,
            "Int8" => Sample::I8,
            "UInt16" => Sample::U16,
            "Int16" => Sample::I16,
            "UInt32" => Sample::U32,
            "Int32" => Sample::I32,
            "UInt64" => Sample::U64,
            "Int64" => Sample::I64,
            "Float32" => Sample::F32,
            "Float64" => Sample::F64,
            _ => {
                return Err(Error::input(format!("type \"{}\" is not supported", shown(name))));
            }
        };
        let components = match array.tag.get("NumberOfComponents") {
            Some(components) => number("NumberOfComponents", components)?,
            None => 1,
        };
        let mut axes = vec![(Axis::Channel, components)];
        for (axis, [first, last]) in [Axis::X, Axis::Y, Axis::Z].into_iter().zip(self.extent()?) {
            let points = last.saturating_sub(first).saturating_add(1);
            // A flat image has one layer of cells.
            let len = if array.of_cells { points.saturating_sub(1).max(1) } else { points };
            axes.push((axis, u64::try_from(len).unwrap_or(0)));
        }
        let big_endian = self.big_endian()?;
        Ok(Layout { axes, sample, big_endian })
    }

    fn big_endian(&self) -> Result<bool> {
        match Found::attribute(&self.file, "byte_order") {
            Some("LittleEndian") => Ok(false),
            Some("BigEndian") => Ok(true),
            other => Err(Error::input(format!(
                "byte_order must be LittleEndian or BigEndian, got \"{}\"",
                shown(other.unwrap_or(""))
            ))),
        }
    }

    fn world_from_voxel(&self, array: &Array) -> Result<WorldFromVoxel> {
        let three = |name: &str, default: f64| -> Result<[f64; 3]> {
            let Some(text) = Found::attribute(&self.image, name) else { return Ok([default; 3]) };
            let values: Vec<f64> = numbers(name, text)?;
            values.try_into().map_err(|_| Error::input(format!("{name} is not three numbers")))
        };
        let (origin, spacing) = (three("Origin", 0.0)?, three("Spacing", 1.0)?);
        let direction: Vec<f64> = match Found::attribute(&self.image, "Direction") {
            Some(text) => numbers("Direction", text)?,
            None => vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        };
        if direction.len() != 9 {
            return Err(Error::input("Direction is not nine numbers"));
        }
        let extent = self.extent()?;
        let mut rows = [[0.0; 4]; 3];
        for (row, entries) in rows.iter_mut().enumerate() {
            entries[3] = origin[row];
            for axis in 0..3 {
                entries[axis] = direction[3 * row + axis] * spacing[axis];
                // Points count from the whole image's origin, wherever this extent begins.
                entries[3] += entries[axis] * extent[axis][0] as f64;
            }
        }
        if array.of_cells {
            WorldFromVoxel::from_rows(rows)
        } else {
            WorldFromVoxel::from_centre_rows(rows)
        }
    }

    /// The array's voxels, which need `bytes` bytes.
    fn stream(&self, file: &Section, array: &Array, bytes: u128) -> Result<Stream> {
        let compressor = Compressor::of(Found::attribute(&self.file, "compressor"))?;
        let section = match array.tag.get("format") {
            Some("appended") => {
                let offset: u64 = number("offset", array.tag.get("offset").unwrap_or(""))?;
                let (_, start) = self
                    .appended
                    .as_ref()
                    .ok_or_else(|| Error::input("its AppendedData are missing"))?;
                file.from(start.saturating_add(offset))
            }
            Some("binary") => file.from(array.text),
            other => {
                return Err(Error::input(format!(
                    "voxels in format \"{}\" are not supported: write them binary or appended",
                    shown(other.unwrap_or("ascii"))
                )));
            }
        };
        let is_raw = array.tag.get("format") == Some("appended")
            && self.appended.as_ref().is_some_and(|(encoding, _)| encoding == "raw");
        let file_bytes = section.left();
        let feed = BufReader::with_capacity(64 << 10, section.clone());
        let mut reader: Box<dyn Read + Send> =
            if is_raw { Box::new(feed) } else { Box::new(Base64::new(feed)) };
        let wide = match Found::attribute(&self.file, "header_type") {
            None | Some("UInt32") => false,
            Some("UInt64") => true,
            Some(other) => {
                return Err(Error::input(format!(
                    "header_type \"{}\" is not known: UInt32 and UInt64 are",
                    shown(other)
                )));
            }
        };
        let numbers = Numbers { wide, big_endian: self.big_endian()? };
        let Some(compressor) = compressor else {
            let promised = numbers.read(&mut reader)?;
            if u128::from(promised) != bytes {
                return Err(Error::input(format!(
                    "its array has {promised} bytes, but its size and type need {bytes}"
                )));
            }
            if is_raw {
                return Stream::new(section.part(numbers.bytes(), promised), Coding::None);
            }
            // What follows in base64 belongs to other arrays.
            let bytes_max = (file_bytes / 4 + 1).saturating_mul(3).min(promised);
            return Ok(Stream::from_decoder(Box::new(reader.take(promised)), "base64", bytes_max));
        };
        packed::stream(reader, compressor, numbers, file_bytes, bytes)
    }
}

/// Where appended data begin: behind an underscore.
fn after_underscore(file: &Section, offset: u64) -> Result<u64> {
    let mut start = Vec::new();
    file.part(offset, 256)
        .read_to_end(&mut start)
        .map_err(|why| Error::input(format!("cannot be read: {why}")))?;
    match start.iter().position(|byte| !byte.is_ascii_whitespace()) {
        Some(at) if start[at] == b'_' => Ok(offset + at as u64 + 1),
        _ => Err(Error::input("its AppendedData do not begin with an underscore")),
    }
}
