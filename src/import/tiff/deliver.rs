//! Pages to runs, strip by strip and tile by tile.

use std::collections::VecDeque;
use std::io;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Blocks, Layout, Target};
use crate::import::stream::Stream;
use crate::import::tiff::decode::{Compression, Pieces, Predictor, Rows};
use crate::import::tiff::ifd::File;
use crate::import::tiff::page::{Page, Shape};
use crate::import::{Header, Input, Run};
use crate::volume::VoxelFormat;

/// Rows with a predictor are undone whole.
const ROW_BYTES_MAX: usize = 256 << 20;

/// A page to deliver, and where it goes.
pub struct Plane {
    pub page: usize,
    pub slice: u32,
    /// The page's first channel.
    pub channel: u32,
}

/// Strips of one layer, or one tile.
struct Part {
    stream: Stream,
    blocks: Blocks,
}

/// The pages of one time step.
pub struct TiffInput {
    header: Header,
    shape: Shape,
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
    /// Of planes, whose pages are those at `offsets`, all like `first`; or, where they are
    /// `contiguous`, lie one after another behind it.
    pub fn new(
        file: File,
        header: Header,
        first: Page,
        offsets: Vec<u64>,
        contiguous: bool,
        planes: Vec<Plane>,
    ) -> TiffInput {
        TiffInput {
            header,
            file,
            offsets,
            shape: first.shape,
            contiguous: contiguous.then_some(first),
            waiting: planes.into(),
            current: None,
            part: None,
            pending: VecDeque::new(),
        }
    }

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
            // Pages are of the wanted time step already.
            time: 0,
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
