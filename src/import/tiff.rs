//! TIFF and BigTIFF: stacks of pages, ImageJ hyperstacks, OME-TIFF.
//!
//! Strips and tiles of any size, in one plane or one per channel; none, LZW, deflate, PackBits and
//! zstd; integers and floats of 8 to 64 bits. Not supported: JPEG, palettes' colours (their indices
//! are read), samples of 1 to 7 or 12 bits, stacks over several files.
//!
//! Source: TIFF revision 6.0, 1992; OME data model, 2016-06.

mod decode;
mod ifd;
mod page;
mod stack;

use std::collections::VecDeque;
use std::io;
use std::path::Path;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Blocks, Layout, Target};
use crate::import::linear::check_time;
use crate::import::stream::{Section, Stream};
use crate::import::{CHANNELS_MAX, Header, Input, Options, Run};
use crate::volume::{Size3, VoxelFormat, WorldFromVoxel};
use decode::{Compression, Pieces, Predictor, Rows};
use ifd::File;
use page::{Page, Shape, is_reduced};
use stack::Stack;

/// Rows with a predictor are undone whole.
const ROW_BYTES_MAX: usize = 256 << 20;

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
        .map(|(plane, page)| Plane {
            page,
            slice: ((plane - first_plane) / u64::from(stack.channels)) as u32,
            channel: (plane % u64::from(stack.channels)) as u32 * page_channels(&stack, &header),
        })
        .collect();
    waiting.sort_by_key(|plane| plane.page);
    Ok(Box::new(TiffInput {
        header,
        shape: page.shape,
        time: 0,
        contiguous: (offsets.len() == 1 && stack.pages.count() > 1).then_some(page),
        file,
        offsets,
        waiting: waiting.into(),
        current: None,
        part: None,
        pending: VecDeque::new(),
    }))
}

fn page_channels(stack: &Stack, header: &Header) -> u32 {
    header.channels / stack.channels
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

/// A page to deliver, and where it goes.
struct Plane {
    page: usize,
    slice: u32,
    channel: u32,
}

/// Strips of one layer, or one tile.
struct Part {
    stream: Stream,
    blocks: Blocks,
}

struct TiffInput {
    header: Header,
    shape: Shape,
    /// Pages are of the wanted time step already.
    time: u32,
    file: File,
    offsets: Vec<u64>,
    /// The one page behind which all images lie.
    contiguous: Option<Page>,
    waiting: VecDeque<Plane>,
    /// The page being delivered, and how many of its parts were begun.
    current: Option<(Page, Plane, usize)>,
    part: Option<Part>,
    pending: VecDeque<Run>,
}

impl TiffInput {
    fn page_of(&self, plane: &Plane) -> Result<Page> {
        let page = match &self.contiguous {
            Some(first) => contiguous(first, plane.page as u64)?,
            None => Page::of(&self.file, &self.file.directory(self.offsets[plane.page])?)?,
        };
        if page.shape != self.shape {
            return Err(Error::input(format!(
                "its pages differ: {} x {} pixels of {} samples of {} in the first, {} x {} of {} of {} here",
                self.shape.width,
                self.shape.height,
                self.shape.channels,
                self.shape.sample.name(),
                page.shape.width,
                page.shape.height,
                page.shape.channels,
                page.shape.sample.name()
            )));
        }
        Ok(page)
    }

    /// Part `index` of a page: the strips of a layer, or a tile; `None` after the last.
    fn part_of(&self, page: &Page, plane: &Plane, index: usize) -> Result<Option<Part>> {
        let [width, height] = page.piece;
        let shape = &page.shape;
        let down = shape.height.div_ceil(height) as usize;
        let row_bytes =
            u64::from(width) * u64::from(shape.channels_together()) * shape.sample.bytes() as u64;
        if page.tiled {
            let Some(&(offset, length)) = page.pieces.get(index) else { return Ok(None) };
            let across = shape.width.div_ceil(width) as usize;
            let (layer, index) = (index / (across * down), index % (across * down));
            let start = [(index % across) as u32 * width, (index / across) as u32 * height];
            let pieces = VecDeque::from([(offset, length, row_bytes * u64::from(height))]);
            return self.part(page, plane, layer as u32, start, page.piece, pieces).map(Some);
        }
        let Some(strips) = page.pieces.chunks_exact(down).nth(index) else { return Ok(None) };
        let strips = strips.iter().enumerate().map(|(strip, (offset, bytes))| {
            (*offset, *bytes, u64::from(page.strip_rows(strip as u32)) * row_bytes)
        });
        let size = [shape.width, shape.height];
        self.part(page, plane, index as u32, [0, 0], size, strips.collect()).map(Some)
    }

    /// What to say of pixels that cannot be decoded; nothing is delivered after it.
    fn damaged(&mut self, why: &io::Error) -> Error {
        let coding = self.part.take().map_or("", |part| part.stream.coding());
        let page = self.current.take().map_or(0, |(_, plane, _)| plane.page);
        self.waiting.clear();
        let what = match why.kind() {
            io::ErrorKind::UnexpectedEof => "end too early: the file is truncated".to_owned(),
            _ => format!("are damaged: {why}"),
        };
        Error::input(format!("page {page}: its {coding} pixels {what}"))
    }

    fn part(
        &self,
        page: &Page,
        plane: &Plane,
        layer: u32,
        start: [u32; 2],
        size: [u32; 2],
        pieces: VecDeque<(u64, u64, u64)>,
    ) -> Result<Part> {
        let together = page.shape.channels_together();
        let sample = page.shape.sample;
        let layout = Layout {
            axes: vec![
                (Axis::Channel, u64::from(together)),
                (Axis::X, u64::from(size[0])),
                (Axis::Y, u64::from(size[1])),
            ],
            sample,
            big_endian: self.file.big_endian,
        };
        let bytes = layout.bytes() as u64;
        let file_bytes = self.file.bytes.left();
        for (offset, length, decoded) in &pieces {
            let need = if page.compression == Compression::None { *decoded } else { 1 };
            if *offset >= file_bytes || need > (*length).min(file_bytes - offset) {
                return Err(Error::input(format!(
                    "a strip or tile at byte {offset} needs {need} bytes and has {length}, in a file of \
                     {file_bytes} bytes; get the whole file"
                )));
            }
        }
        let decoded = Pieces::new(self.file.bytes.clone(), page.compression, pieces);
        let rows = u64::from(size[1]);
        let reader: Box<dyn io::Read + Send> = if page.predictor == Predictor::None {
            Box::new(decoded)
        } else {
            let row_bytes = (bytes / rows) as usize;
            if row_bytes > ROW_BYTES_MAX {
                return Err(Error::input(format!(
                    "rows of {row_bytes} bytes with a predictor are not supported: {ROW_BYTES_MAX} are"
                )));
            }
            let (sample_bytes, together) = match sample.delivered() {
                VoxelFormat::Rgba8 => (1, 4),
                _ => (sample.bytes(), together as usize),
            };
            let sample = [sample_bytes, together];
            let big_endian = self.file.big_endian;
            Box::new(Rows::new(decoded, page.predictor, sample, big_endian, row_bytes, rows))
        };
        let target = Target {
            origin: [start[0], start[1], plane.slice],
            clip: self.header.size,
            channel: plane.channel + layer,
            time: self.time,
            format: self.header.format,
        };
        Ok(Part {
            stream: Stream::from_decoder(reader, page.compression.name(), bytes),
            blocks: Blocks::new(layout, target),
        })
    }
}

impl Input for TiffInput {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        while self.pending.is_empty() {
            if let Some(part) = &mut self.part {
                match part.blocks.next(&mut part.stream) {
                    Ok(Some(runs)) => self.pending.extend(runs),
                    Ok(None) => self.part = None,
                    Err(why) => return Err(self.damaged(&why)),
                }
            } else if let Some((page, plane, begun)) = &self.current {
                let placed = |why: Error| why.at(format!("page {}", plane.page));
                self.part = self.part_of(page, plane, *begun).map_err(placed)?;
                match &mut self.current {
                    Some((_, _, begun)) if self.part.is_some() => *begun += 1,
                    _ => self.current = None,
                }
            } else {
                let Some(plane) = self.waiting.pop_front() else { return Ok(None) };
                let placed = |why: Error| why.at(format!("page {}", plane.page));
                let page = self.page_of(&plane).map_err(placed)?;
                self.current = Some((page, plane, 0));
            }
        }
        Ok(self.pending.pop_front())
    }
}

/// Image `index` of ImageJ's stacks with one directory, whose images lie one after another.
fn contiguous(first: &Page, index: u64) -> Result<Page> {
    let mut end = first.pieces.first().map_or(0, |(offset, _)| *offset);
    let start = end;
    let mut strips = Vec::new();
    for (strip, (offset, _)) in first.pieces.iter().enumerate() {
        let row_bytes = first.shape.bytes() as u64 / u64::from(first.shape.height);
        let bytes = u64::from(first.strip_rows(strip as u32)) * row_bytes;
        if *offset != end || first.tiled || first.compression != Compression::None {
            return Err(Error::input(
                "its images do not lie one after another behind its only page",
            ));
        }
        strips.push((*offset, bytes));
        end = end.saturating_add(bytes);
    }
    let shift = index.saturating_mul(end - start);
    let pieces =
        strips.into_iter().map(|(offset, bytes)| (offset.saturating_add(shift), bytes)).collect();
    Ok(Page { pieces, ..*first })
}
