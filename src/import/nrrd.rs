//! NRRD: attached and detached headers, raw and gzip data.
//!
//! Not supported: the encodings bzip2, text and hex, bit and block types, and data in many files.
//!
//! Source: <https://teem.sourceforge.net/nrrd/format.html>

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream};
use crate::import::text::{Lines, number, numbers, shown};
use crate::import::{Input, Options};
use crate::volume::WorldFromVoxel;

/// Axes of the array: more than volumes with channels and time have need for.
const DIMENSION_MAX: usize = 8;

/// Opens a .nrrd or .nhdr file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let file = Section::of_file(path)?;
    let mut lines = Lines::of(&file)?;
    let header = Fields::parse(&mut lines)?;
    let (layout, spatial) = header.layout()?;
    let section = match header.get(&["data file", "datafile"]) {
        None => file.from(lines.offset()),
        Some(name) if name.starts_with("LIST") || name.contains('%') => {
            return Err(Error::input(
                "data in many files is not supported: join them into one NRRD file",
            ));
        }
        Some(name) => Section::of_file(&path.parent().unwrap_or(Path::new("")).join(name))
            .map_err(|why| why.at(format!("data file {}", shown(name))))?,
    };
    let stream = header.stream(section, &layout)?;
    let mut notes = Vec::new();
    let world_from_voxel = header.world_from_voxel(&spatial, &mut notes)?;
    if layout.axes.iter().any(|(axis, _)| *axis == Axis::Channel) {
        notes.push("the axis that is not space or time is read as channels".to_owned());
    }
    let details = Details {
        format_name: "NRRD",
        world_from_voxel,
        scaling: (1.0, 0.0),
        unit: header.unit(),
        notes,
    };
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}

struct Fields(HashMap<String, String>);

impl Fields {
    fn parse(lines: &mut Lines) -> Result<Fields> {
        lines.next()?;
        let mut fields = HashMap::new();
        while let Some(line) = lines.next()? {
            if line.is_empty() {
                break;
            }
            // Comments, and key:=value pairs, which mean nothing to the format.
            if line.starts_with('#') || line.contains(":=") {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(Error::input(format!(
                    "header line \"{}\" is not \"field: value\"; a header ends with an empty line",
                    shown(&line)
                )));
            };
            fields.insert(name.trim().to_ascii_lowercase(), value.trim().to_owned());
        }
        Ok(Fields(fields))
    }

    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.0.get(*name)).map(String::as_str)
    }

    fn need(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| Error::input(format!("header field \"{name}\" is missing")))
    }

    /// The layout, and for each spatial axis its index in the array.
    fn layout(&self) -> Result<(Layout, Vec<usize>)> {
        let sample = sample_of(self.need("type")?)?;
        let dimension: usize = number("dimension", self.need("dimension")?)?;
        let sizes: Vec<u64> = numbers("sizes", self.need("sizes")?)?;
        if sizes.len() != dimension || !(1..=DIMENSION_MAX).contains(&dimension) {
            return Err(Error::input(format!(
                "header has {} sizes and dimension {dimension}; 1 to {DIMENSION_MAX} axes can be read",
                sizes.len()
            )));
        }
        let kinds: Vec<&str> = self.get(&["kinds"]).unwrap_or("").split_whitespace().collect();
        let directions = self.get(&["space directions"]).map(vectors).transpose()?;
        let mut axes = Vec::new();
        let mut spatial = Vec::new();
        let mut sample = sample;
        for (index, &len) in sizes.iter().enumerate() {
            let kind = kinds.get(index).map(|kind| kind.to_ascii_lowercase());
            let is_space = match (&directions, kind.as_deref()) {
                (Some(directions), _) => directions.get(index).is_some_and(Option::is_some),
                (None, Some("domain" | "space" | "???" | "none")) => true,
                (None, Some(_)) => false,
                (None, None) => spatial.len() < 3,
            };
            let axis = match kind.as_deref() {
                _ if is_space => {
                    let Some(axis) = [Axis::X, Axis::Y, Axis::Z].get(spatial.len()) else {
                        return Err(Error::input(
                            "more than three axes of space: name the others in \"kinds\"",
                        ));
                    };
                    spatial.push(index);
                    *axis
                }
                Some("time") => Axis::Time,
                Some("rgba-color") if index == 0 && len == 4 && sample == Sample::U8 => {
                    sample = Sample::Rgba8;
                    continue;
                }
                _ => Axis::Channel,
            };
            if axes.iter().any(|(known, _)| *known == axis) {
                return Err(Error::input(
                    "two axes of the same kind beside space are not supported",
                ));
            }
            axes.push((axis, len));
        }
        if spatial.is_empty() {
            return Err(Error::input(
                "no axis is one of space: see \"kinds\", \"space directions\"",
            ));
        }
        let big_endian = match self.get(&["endian"]).map(str::to_ascii_lowercase).as_deref() {
            Some("little") => false,
            Some("big") => true,
            None if matches!(sample, Sample::U8 | Sample::I8 | Sample::Rgba8) => false,
            other => {
                return Err(Error::input(format!(
                    "header field \"endian\" must be little or big, got {}",
                    other.map_or("none".to_owned(), |other| format!("\"{}\"", shown(other)))
                )));
            }
        };
        Ok((Layout { axes, sample, big_endian }, spatial))
    }

    fn stream(&self, mut section: Section, layout: &Layout) -> Result<Stream> {
        let coding = match self.need("encoding")?.to_ascii_lowercase().as_str() {
            "raw" => Coding::None,
            "gzip" | "gz" => Coding::Gzip,
            other => {
                return Err(Error::input(format!(
                    "encoding \"{}\" is not supported: write it raw or gzip",
                    shown(other)
                )));
            }
        };
        let skip =
            |names: &[&str]| self.get(names).map_or(Ok(0), |value| number::<i64>(names[0], value));
        for _ in 0..skip(&["line skip", "lineskip"])? {
            skip_line(&mut section)?;
        }
        let byte_skip = skip(&["byte skip", "byteskip"])?;
        if byte_skip < 0 {
            if byte_skip != -1 || coding != Coding::None {
                return Err(Error::input("byte skip below 0 must be -1, with raw encoding"));
            }
            // The voxels are the file's last bytes.
            let left = section.left();
            let bytes = u64::try_from(layout.bytes()).unwrap_or(u64::MAX);
            section = section.from(left.saturating_sub(bytes));
        }
        let mut stream = Stream::new(section, coding)?;
        if let Ok(bytes @ 1..) = u64::try_from(byte_skip) {
            stream.skip(bytes).map_err(|_| {
                Error::input(format!("byte skip is {bytes}, but the data end before"))
            })?;
        }
        Ok(stream)
    }

    fn world_from_voxel(
        &self,
        spatial: &[usize],
        notes: &mut Vec<String>,
    ) -> Result<WorldFromVoxel> {
        if let Some(space) = self.get(&["space"]) {
            notes.push(format!("world is the header's own space, {}, not flipped", shown(space)));
        }
        if let Some(directions) = self.get(&["space directions"]) {
            let directions = vectors(directions)?;
            // Axes with a direction are those of space, so there is one for each.
            let columns = spatial.iter().filter_map(|index| directions[*index]);
            let [x, y, z] = completed(&columns.collect::<Vec<_>>());
            let origin = match self.get(&["space origin"]) {
                None => DVec3::ZERO,
                Some(origin) => vectors(origin)?.first().copied().flatten().unwrap_or(DVec3::ZERO),
            };
            let row = |r: usize| [x[r], y[r], z[r], origin[r]];
            return WorldFromVoxel::from_centre_rows([row(0), row(1), row(2)]);
        }
        if self.get(&["axis mins", "axismins"]).is_some() {
            notes
                .push("axis mins are ignored: the world starts at the first voxel's corner".into());
        }
        let mut spacing = [1.0; 3];
        if let Some(spacings) = self.get(&["spacings"]) {
            let spacings: Vec<f64> = numbers("spacings", spacings)?;
            for (axis, index) in spatial.iter().enumerate() {
                // NaN stands for "not known".
                spacing[axis] = match spacings.get(*index) {
                    Some(known) if !known.is_nan() => known.abs(),
                    _ => 1.0,
                };
            }
        }
        WorldFromVoxel::from_spacing(spacing)
    }

    fn unit(&self) -> Option<String> {
        let units = self.get(&["space units", "units"])?;
        let first = units.split('"').find(|word| !word.trim().is_empty())?;
        Some(first.trim().to_owned())
    }
}

fn sample_of(name: &str) -> Result<Sample> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Sample::U8,
        "signed char" | "int8" | "int8_t" => Sample::I8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Sample::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Sample::U16,
        "int" | "signed int" | "int32" | "int32_t" => Sample::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Sample::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Sample::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            Sample::U64
        }
        "float" => Sample::F32,
        "double" => Sample::F64,
        other => {
            return Err(Error::input(format!("type \"{}\" is not supported", shown(other))));
        }
    })
}

/// Vectors in parentheses, and "none"; two components have a third of 0.
fn vectors(text: &str) -> Result<Vec<Option<DVec3>>> {
    let mut rest = text.trim();
    let mut vectors = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let Some((vector, after)) = rest.strip_prefix('(').and_then(|rest| rest.split_once(')'))
        else {
            return Err(Error::input(format!("\"{}\" is not a vector like (1,0,0)", shown(rest))));
        };
        let components: Vec<f64> = numbers("space", vector)?;
        let [x, y, z] = match components[..] {
            [x, y, z] => [x, y, z],
            [x, y] => [x, y, 0.0],
            [x] => [x, 0.0, 0.0],
            _ => return Err(Error::input("space must have one to three dimensions")),
        };
        // All NaN stands for "none" in older files.
        let vector = DVec3::new(x, y, z);
        vectors.push(Some(vector).filter(|vector| !vector.is_nan()));
        rest = after.trim_start();
    }
    Ok(vectors)
}

/// Up to three columns, and unit vectors across them for those that are missing.
fn completed(columns: &[DVec3]) -> [DVec3; 3] {
    let x = columns.first().copied().unwrap_or(DVec3::X);
    let y = columns
        .get(1)
        .copied()
        .unwrap_or_else(|| x.try_normalize().map_or(DVec3::Y, |x| x.any_orthonormal_vector()));
    let z =
        columns.get(2).copied().unwrap_or_else(|| x.cross(y).try_normalize().unwrap_or(DVec3::Z));
    [x, y, z]
}

fn skip_line(section: &mut Section) -> Result<()> {
    let mut piece = [0; 4096];
    loop {
        let got = section
            .clone()
            .read(&mut piece)
            .map_err(|why| Error::input(format!("data cannot be read: {why}")))?;
        if got == 0 {
            return Err(Error::input("line skip goes beyond the end of the data"));
        }
        match piece[..got].iter().position(|byte| *byte == b'\n') {
            Some(end) => {
                *section = section.from(end as u64 + 1);
                return Ok(());
            }
            None => *section = section.from(got as u64),
        }
    }
}
