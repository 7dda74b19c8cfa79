//! MetaImage: .mha with its voxels inside, .mhd with them in another file; plain and zlib.
//!
//! The affine is the one ITK reads: TransformMatrix's rows are the axes' directions, Offset is the
//! first voxel's centre. Not supported: voxels as text, and voxels in many files.
//!
//! Source: <https://itk.org/Wiki/ITK/MetaIO/Documentation>

use std::collections::HashMap;
use std::path::Path;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream, head};
use crate::import::text::{Lines, number, numbers, shown};
use crate::import::{Input, Options};
use crate::volume::WorldFromVoxel;

/// Whether a file that starts so is a MetaImage: its first field is one that only they have.
pub fn is_header(head: &[u8]) -> bool {
    let end = head.iter().position(|byte| *byte == b'=').unwrap_or(0);
    [&b"ObjectType"[..], b"NDims", b"Comment", b"ObjectSubType"].contains(&head[..end].trim_ascii())
}

/// Opens a .mha or .mhd file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let file = Section::of_file(path)?;
    let mut lines = Lines::of(&file)?;
    let header = Fields::parse(&mut lines)?;
    let layout = header.layout()?;
    let data = header.need(&["ElementDataFile"])?;
    let (section, start) = match data {
        "LOCAL" | "Local" | "local" => (file.from(lines.offset()), Vec::new()),
        name if name.starts_with("LIST") || name.contains('%') => {
            return Err(Error::input(
                "voxels in many files are not supported: write them into one .mha file",
            ));
        }
        name => {
            let other = path.parent().unwrap_or(Path::new("")).join(name);
            let placed = |why: Error| why.at(format!("data file {}", shown(name)));
            (Section::of_file(&other).map_err(placed)?, head(&other, 2).map_err(placed)?)
        }
    };
    let section = header.skipped(section, &layout)?;
    let coding = match (header.flag(&["CompressedData"])?, &start[..]) {
        (false, _) => Coding::None,
        (true, [0x1f, 0x8b]) => Coding::Gzip,
        (true, _) => Coding::Zlib,
    };
    let mut notes = Vec::new();
    if layout.axes.iter().any(|(axis, len)| *axis == Axis::Time && *len > 1) {
        notes.push("the fourth axis is read as time".to_owned());
    }
    let details = Details {
        format_name: "MetaImage",
        world_from_voxel: header.world_from_voxel()?,
        scaling: (1.0, 0.0),
        unit: header.get(&["DistanceUnits"]).filter(|unit| *unit != "?").map(str::to_owned),
        notes,
    };
    let stream = Stream::new(section, coding)?;
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}

struct Fields(HashMap<String, String>);

impl Fields {
    fn parse(lines: &mut Lines) -> Result<Fields> {
        let mut fields = HashMap::new();
        while let Some(line) = lines.next()? {
            if line.trim().is_empty() {
                continue;
            }
            let Some((name, value)) = line.split_once('=') else {
                return Err(Error::input(format!(
                    "header line \"{}\" is not \"Field = value\"",
                    shown(&line)
                )));
            };
            let (name, value) = (name.trim().to_owned(), value.trim().to_owned());
            let is_last = name == "ElementDataFile";
            fields.insert(name, value);
            // Voxels follow right behind this field.
            if is_last {
                break;
            }
        }
        Ok(Fields(fields))
    }

    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.0.get(*name)).map(String::as_str)
    }

    fn need(&self, names: &[&str]) -> Result<&str> {
        self.get(names)
            .ok_or_else(|| Error::input(format!("header field \"{}\" is missing", names[0])))
    }

    fn flag(&self, names: &[&str]) -> Result<bool> {
        match self.get(names).map(str::to_ascii_lowercase).as_deref() {
            None | Some("false" | "0") => Ok(false),
            Some("true" | "1") => Ok(true),
            Some(other) => Err(Error::input(format!(
                "header field \"{}\" must be True or False, got \"{}\"",
                names[0],
                shown(other)
            ))),
        }
    }

    fn dimensions(&self) -> Result<usize> {
        let dimensions: usize = number("NDims", self.need(&["NDims"])?)?;
        if !(1..=4).contains(&dimensions) {
            return Err(Error::input(format!("has {dimensions} axes; 1 to 4 can be read")));
        }
        Ok(dimensions)
    }

    fn layout(&self) -> Result<Layout> {
        let sample = match self.need(&["ElementType"])? {
            "MET_UCHAR" => Sample::U8,
            "MET_CHAR" => Sample::I8,
            "MET_USHORT" => Sample::U16,
            "MET_SHORT" => Sample::I16,
            // Long is four bytes in this format, whatever the machine.
            "MET_UINT" | "MET_ULONG" => Sample::U32,
            "MET_INT" | "MET_LONG" => Sample::I32,
            "MET_ULONG_LONG" => Sample::U64,
            "MET_LONG_LONG" => Sample::I64,
            "MET_FLOAT" => Sample::F32,
            "MET_DOUBLE" => Sample::F64,
            other => {
                return Err(Error::input(format!(
                    "element type \"{}\" is not supported",
                    shown(other)
                )));
            }
        };
        if self.get(&["BinaryData"]).is_some() && !self.flag(&["BinaryData"])? {
            return Err(Error::input(
                "voxels as text are not supported: write them as binary data",
            ));
        }
        let sizes: Vec<u64> = numbers("DimSize", self.need(&["DimSize"])?)?;
        if sizes.len() != self.dimensions()? {
            return Err(Error::input(format!(
                "DimSize has {} numbers, NDims is {}",
                sizes.len(),
                self.dimensions()?
            )));
        }
        let channels = match self.get(&["ElementNumberOfChannels"]) {
            Some(channels) => number("ElementNumberOfChannels", channels)?,
            None => 1,
        };
        let mut axes = vec![(Axis::Channel, channels)];
        axes.extend([Axis::X, Axis::Y, Axis::Z, Axis::Time].into_iter().zip(sizes));
        let big_endian = self.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])?;
        Ok(Layout { axes, sample, big_endian })
    }

    /// The section without the header that HeaderSize says is before the voxels.
    fn skipped(&self, section: Section, layout: &Layout) -> Result<Section> {
        let bytes: i64 = match self.get(&["HeaderSize"]) {
            Some(bytes) => number("HeaderSize", bytes)?,
            None => 0,
        };
        if bytes < 0 {
            // The voxels are the file's last bytes.
            let voxels = u64::try_from(layout.bytes()).unwrap_or(u64::MAX);
            return Ok(section.from(section.left().saturating_sub(voxels)));
        }
        Ok(section.from(bytes as u64))
    }

    fn world_from_voxel(&self) -> Result<WorldFromVoxel> {
        let dimensions = self.dimensions()?;
        let values = |names: &[&str], count: usize| -> Result<Option<Vec<f64>>> {
            let Some(text) = self.get(names) else { return Ok(None) };
            let values = numbers(names[0], text)?;
            if values.len() != count {
                return Err(Error::input(format!(
                    "header field \"{}\" has {} numbers, not {count}",
                    names[0],
                    values.len()
                )));
            }
            Ok(Some(values))
        };
        let spacing = match values(&["ElementSpacing"], dimensions)? {
            Some(spacing) => Some(spacing),
            None => values(&["ElementSize"], dimensions)?,
        };
        let offset = values(&["Offset", "Position", "Origin"], dimensions)?;
        let matrix =
            values(&["TransformMatrix", "Rotation", "Orientation"], dimensions * dimensions)?;
        let mut rows = [[0.0; 4]; 3];
        for (row, entries) in rows.iter_mut().enumerate() {
            for (axis, entry) in entries[..3].iter_mut().enumerate() {
                let known = row < dimensions && axis < dimensions;
                let direction = match &matrix {
                    Some(matrix) if known => matrix[axis * dimensions + row],
                    _ => f64::from(row == axis),
                };
                let spacing = spacing.as_ref().and_then(|spacing| spacing.get(axis));
                *entry = direction * spacing.unwrap_or(&1.0);
            }
            entries[3] = *offset.as_ref().and_then(|offset| offset.get(row)).unwrap_or(&0.0);
        }
        WorldFromVoxel::from_centre_rows(rows)
    }
}
