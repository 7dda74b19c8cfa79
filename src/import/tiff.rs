//! TIFF and BigTIFF: stacks of pages, ImageJ hyperstacks, OME-TIFF.
//!
//! Strips and tiles of any size, in one plane or one per channel; none, LZW, deflate, PackBits and
//! zstd; integers and floats of 8 to 64 bits. Not supported: JPEG, palettes' colours (their indices
//! are read), samples of 1 to 7 or 12 bits, stacks over several files.
//!
//! Source: TIFF revision 6.0, 1992; OME data model, 2016-06.

mod decode;
mod deliver;
mod ifd;
mod page;
mod stack;

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::import::linear::check_time;
use crate::import::stream::Section;
use crate::import::{CHANNELS_MAX, Header, Input, Options};
use crate::volume::{Size3, VoxelFormat, WorldFromVoxel};
use deliver::{Plane, TiffInput};
use ifd::File;
use page::{Page, Shape, is_reduced};
use stack::Stack;

const DESCRIPTION: u16 = 270;
const RESOLUTION_X: u16 = 282;
const RESOLUTION_Y: u16 = 283;

/// Whether a file that starts so is a TIFF file.
pub fn is_header(head: &[u8]) -> bool {
    matches!(head, [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..])
}

/// Opens a TIFF file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let file = File::open(Section::of_file(path)?)?;
    let mut offsets = Vec::new();
    for offset in file.directories()? {
        if !is_reduced(&file, &file.directory(offset)?)? {
            offsets.push(offset);
        }
    }
    let first = offsets.first().ok_or_else(|| Error::input("has only reduced pages"))?;
    let first = file.directory(*first)?;
    let page = Page::of(&file, &first)?;
    let description = file.text(&first, DESCRIPTION)?.unwrap_or_default();
    let samples = if page.shape.sample.delivered() == VoxelFormat::Rgba8 {
        4
    } else {
        u64::from(page.shape.channels)
    };
    let mut stack = if description.starts_with("ImageJ=") {
        let mut stack = Stack::imagej(&description, offsets.len())?;
        if stack.unit.is_some() {
            for (axis, tag) in [RESOLUTION_X, RESOLUTION_Y].into_iter().enumerate() {
                stack.spacing[axis] = file.fraction(&first, tag)?.map(|per_unit| 1.0 / per_unit);
            }
        }
        stack
    } else if description.contains("<OME") {
        Stack::ome(&description, offsets.len(), samples)?
    } else {
        Stack::plain(offsets.len())?
    };
    check_time(options.time, stack.times)?;
    check_promise(&file, &page, &stack)?;
    let header = header(&page.shape, &mut stack, options.time)?;
    let planes = u64::from(stack.slices) * u64::from(stack.channels);
    let first_plane = planes * u64::from(options.time);
    let planes = stack.pages.within(first_plane..first_plane + planes);
    let mut waiting: Vec<Plane> = planes
        .into_iter()
        .map(|(plane, index)| Plane {
            page: index,
            slice: ((plane - first_plane) / u64::from(stack.channels)) as u32,
            channel: (plane % u64::from(stack.channels)) as u32 * page.shape.channels,
        })
        .collect();
    waiting.sort_by_key(|plane| plane.page);
    let contiguous = offsets.len() == 1 && stack.pages.count() > 1;
    Ok(Box::new(TiffInput::new(file, header, page, offsets, contiguous, waiting)))
}

/// Refuses more voxels than the file can hold, whatever its compression.
fn check_promise(file: &File, page: &Page, stack: &Stack) -> Result<()> {
    let bytes = page.shape.bytes() * u128::from(stack.pages.count());
    let bytes_max = u128::from(file.bytes.left()) * u128::from(page.compression.expansion_max());
    if bytes > bytes_max {
        return Err(Error::input(format!(
            "promises {} pages of {} x {} pixels, {bytes} bytes, but its {} {} bytes hold {bytes_max} at most",
            stack.pages.count(),
            page.shape.width,
            page.shape.height,
            file.bytes.left(),
            page.compression.name()
        )));
    }
    Ok(())
}

fn header(shape: &Shape, stack: &mut Stack, time: u32) -> Result<Header> {
    let size = Size3::new(shape.width, shape.height, stack.slices);
    let channels = u64::from(stack.channels) * u64::from(shape.channels);
    if channels > CHANNELS_MAX {
        return Err(Error::input(format!("has {channels} channels; {CHANNELS_MAX} can be read")));
    }
    let planes = u64::from(stack.slices) * u64::from(stack.channels);
    let first = u64::from(time) * planes;
    let present = stack.pages.count_within(first..first + planes);
    let absent = (planes - present)
        .checked_mul(u64::from(shape.width) * u64::from(shape.height))
        .and_then(|voxels| voxels.checked_mul(u64::from(shape.channels)))
        .ok_or_else(|| Error::input(format!("lacks {} of its planes", planes - present)))?;
    let mut notes = std::mem::take(&mut stack.notes);
    notes.extend(shape.sample.note());
    let mut format = shape.sample.delivered();
    if absent > 0 {
        notes.push(format!(
            "{} of {planes} planes are missing: their voxels are absent",
            planes - present
        ));
        if format == VoxelFormat::Rgba8 {
            return Err(Error::input("planes of colour are missing, which is not supported"));
        }
        if format != VoxelFormat::F32 {
            notes.push(format!(
                "{format} voxels are delivered as f32, exactly, since some are absent"
            ));
            format = VoxelFormat::F32;
        }
    }
    match shape.photometric {
        0 => notes.push("zero is white in this file; its numbers are kept".to_owned()),
        3 => notes.push("the palette is ignored: voxels are its indices".to_owned()),
        _ => {}
    }
    let spacing = stack.spacing.map(|spacing| spacing.unwrap_or(1.0));
    Ok(Header {
        // Known to whoever opened the file.
        path: PathBuf::new(),
        size,
        channels: channels as u32,
        times: stack.times,
        format,
        world_from_voxel: WorldFromVoxel::from_spacing(spacing)?,
        scaling: vec![(1.0, 0.0); channels as usize],
        unit: stack.unit.take(),
        format_name: stack.format_name,
        notes,
        absent_voxels: absent,
    })
}
