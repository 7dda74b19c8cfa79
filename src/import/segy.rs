//! SEG-Y, stacked and on a grid: IBM and IEEE floats, integers, both byte orders, revisions 0 to 2.
//!
//! x is the sample, y the crossline, z the inline, ascending. Cells of the grid without a trace, and
//! traces flagged as dead, are absent. Not supported: prestack data (several traces in a cell), traces
//! of varying length, 24-bit and fixed-point samples. The world is the grid: lines and samples are
//! one unit apart, and coordinates are not used.
//!
//! Source: SEG technical standards, SEG-Y revisions 1 (2002) and 2.0 (2017)

mod grid;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::import::bytes::{exactly, u16_at, u32_at};
use crate::import::linear::check_time;
use crate::import::sample::{Gather, Sample};
use crate::import::stream::Section;
use crate::import::{EDGE_VOXELS_MAX, Header, Input, Options, RUN_BYTES_MAX, Run, SegyFields};
use crate::volume::{Size3, VoxelFormat, WorldFromVoxel};
use grid::Grid;

/// The text header, and the file header behind it.
const TEXT_BYTES: u64 = 3200;
const FILE_HEADER_BYTES: u64 = 400;
const TRACE_HEADER_BYTES: usize = 240;
const DEAD_TRACE: u16 = 2;

/// Opens a .sgy or .segy file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    check_time(options.time, 1)?;
    let file = Section::of_file(path)?;
    let layout = Traces::of(&file, options.segy)?;
    let (grid, mut notes) = layout.survey()?;
    let size = Size3::new(layout.samples, grid.crosslines.count, grid.inlines.count);
    let absent = grid.cells() - grid.live;
    let mut format = layout.sample.delivered();
    notes.extend(layout.sample.note());
    if absent > 0 {
        notes.push(format!("{absent} of {} traces are missing or dead: absent", grid.cells()));
        if format != VoxelFormat::F32 {
            notes.push(format!(
                "{format} voxels are delivered as f32, exactly, since some are absent"
            ));
            format = VoxelFormat::F32;
        }
    }
    let header = Header {
        // Known to whoever opened the file.
        path: PathBuf::new(),
        size,
        channels: 1,
        times: 1,
        format,
        world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3])?,
        scaling: vec![(1.0, 0.0)],
        unit: None,
        format_name: "SEG-Y",
        notes,
        absent_voxels: absent * u64::from(layout.samples),
    };
    Ok(Box::new(SegyInput { header, layout, grid, next: 0, pending: VecDeque::new() }))
}

/// Where traces are and what they hold.
struct Traces {
    /// All traces.
    section: Section,
    count: u64,
    bytes: u64,
    samples: u32,
    sample: Sample,
    big_endian: bool,
    fields: SegyFields,
    interval: u16,
}

impl Traces {
    fn of(file: &Section, fields: SegyFields) -> Result<Traces> {
        for byte in [fields.inline_byte, fields.crossline_byte] {
            if !(1..=TRACE_HEADER_BYTES as u16 - 3).contains(&byte) {
                return Err(Error::input(format!(
                    "line numbers at byte {byte}: a trace header has bytes 1 to {TRACE_HEADER_BYTES}"
                )));
            }
        }
        let header = exactly(file, TEXT_BYTES, FILE_HEADER_BYTES)
            .map_err(|why| Error::input(format!("its file header cannot be read: {why}")))?;
        // The format of samples is a small number in one byte order alone.
        let code = [u16_at(&header, 24, true), u16_at(&header, 24, false)];
        let big_endian = match code {
            [1..=16, _] => true,
            [_, 1..=16] => false,
            [big, _] => {
                return Err(Error::input(format!(
                    "is not SEG-Y: sample format {big} is not known in either byte order"
                )));
            }
        };
        let number = |at| u16_at(&header, at, big_endian);
        let code = number(24);
        let sample = match code {
            1 => Sample::Ibm32,
            2 => Sample::I32,
            3 => Sample::I16,
            5 => Sample::F32,
            6 => Sample::F64,
            8 => Sample::I8,
            9 => Sample::I64,
            10 => Sample::U32,
            11 => Sample::U16,
            12 => Sample::U64,
            16 => Sample::U8,
            _ => {
                return Err(Error::input(format!("sample format {code} is not supported")));
            }
        };
        let revision = number(300) >> 8;
        let samples = match u32_at(&header, 68, big_endian) {
            wide @ 1.. if revision >= 2 => wide,
            _ => u32::from(number(20)),
        };
        if samples == 0 || u64::from(samples) > EDGE_VOXELS_MAX {
            return Err(Error::input(format!(
                "promises traces of {samples} samples; 1 to {EDGE_VOXELS_MAX} can be read"
            )));
        }
        let texts = if revision >= 1 { number(304) as i16 } else { 0 };
        let texts = u64::try_from(texts)
            .map_err(|_| Error::input("a varying number of text headers is not supported"))?;
        let section = file.from(TEXT_BYTES + FILE_HEADER_BYTES + texts * TEXT_BYTES);
        let bytes = TRACE_HEADER_BYTES as u64 + u64::from(samples) * sample.bytes() as u64;
        let (count, rest) = (section.left() / bytes, section.left() % bytes);
        if count == 0 || rest != 0 {
            return Err(Error::input(format!(
                "holds {} bytes of traces, which are not whole traces of {samples} samples of {} \
                 ({bytes} bytes each): it is truncated, or its traces vary in length",
                section.left(),
                sample.name()
            )));
        }
        let interval = number(16);
        Ok(Traces { section, count, bytes, samples, sample, big_endian, fields, interval })
    }

    fn lines(&self, header: &[u8]) -> [i32; 2] {
        [self.fields.inline_byte, self.fields.crossline_byte]
            .map(|byte| u32_at(header, usize::from(byte) - 1, self.big_endian) as i32)
    }

    fn is_dead(&self, header: &[u8]) -> bool {
        u16_at(header, 28, self.big_endian) == DEAD_TRACE
    }

    fn header(&self, trace: u64) -> Result<Vec<u8>> {
        exactly(&self.section, trace * self.bytes, TRACE_HEADER_BYTES as u64)
            .map_err(|why| Error::input(format!("trace {trace} cannot be read: {why}")))
    }
}

struct SegyInput {
    header: Header,
    layout: Traces,
    grid: Grid,
    next: u64,
    pending: VecDeque<Run>,
}

/// Traces of a batch that lie side by side along y or z.
#[derive(Clone, Copy)]
struct Row {
    first: usize,
    count: u32,
    start: [u32; 2],
    /// Along which of y and z, once there are two.
    along: Option<usize>,
}

impl Row {
    /// Whether the trace at a place is the next of this row.
    fn extends(&mut self, place: [u32; 2]) -> bool {
        let along = [0, 1].into_iter().find(|axis| {
            let mut next = self.start;
            next[*axis] = next[*axis].wrapping_add(self.count);
            next == place && self.along.is_none_or(|along| along == *axis)
        });
        self.along = along.or(self.along);
        self.count += u32::from(along.is_some());
        along.is_some()
    }
}

impl SegyInput {
    fn batch(&mut self) -> Result<()> {
        let layout = &self.layout;
        let count = (RUN_BYTES_MAX as u64 / layout.bytes).clamp(1, layout.count - self.next);
        let bytes = exactly(&layout.section, self.next * layout.bytes, count * layout.bytes)
            .map_err(|why| Error::input(format!("trace {} cannot be read: {why}", self.next)))?;
        let mut rows: Vec<Row> = Vec::new();
        for (index, trace) in bytes.chunks_exact(layout.bytes as usize).enumerate() {
            if layout.is_dead(trace) {
                continue;
            }
            let start = self.grid.place(layout.lines(trace));
            let is_next =
                |row: &mut Row| row.first + row.count as usize == index && row.extends(start);
            if !rows.last_mut().is_some_and(is_next) {
                rows.push(Row { first: index, count: 1, start, along: None });
            }
        }
        for row in rows {
            self.pending.push_back(self.run(&bytes, row));
        }
        self.next += count;
        Ok(())
    }

    fn run(&self, bytes: &[u8], row: Row) -> Run {
        let layout = &self.layout;
        // A trace header has a whole number of samples of any type.
        let sample_bytes = layout.sample.bytes();
        let per_trace = layout.bytes as usize / sample_bytes;
        let mut size = Size3::new(layout.samples, 1, 1);
        match row.along {
            Some(1) => size.z = row.count,
            _ => size.y = row.count,
        }
        let at = Gather {
            base: row.first * per_trace + TRACE_HEADER_BYTES / sample_bytes,
            stride: [1, per_trace, per_trace],
            size: size.to_array().map(|edge| edge as usize),
        };
        Run {
            channel: 0,
            start: [0, row.start[0], row.start[1]],
            size,
            voxels: layout.sample.voxels(bytes, layout.big_endian, &at, self.header.format),
        }
    }
}

impl Input for SegyInput {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        while self.pending.is_empty() && self.next < self.layout.count {
            self.batch()?;
        }
        Ok(self.pending.pop_front())
    }
}
