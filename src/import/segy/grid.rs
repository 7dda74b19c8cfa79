//! The grid of a survey: which lines there are, and which cells have a trace.

use crate::error::{Error, Result};
use crate::import::bytes::u16_at;
use crate::import::segy::Traces;
use crate::import::{EDGE_VOXELS_MAX, SegyFields};

/// Cells of the grid for each trace: sparser grids are line numbers that are read wrongly.
const CELLS_PER_TRACE_MAX: u64 = 64;

impl Traces {
    /// Reads every trace's header: the grid, and that no cell has two traces.
    pub(super) fn survey(&self) -> Result<(Grid, Vec<String>)> {
        let mut inlines = LineRange::default();
        let mut crosslines = LineRange::default();
        let mut other_length = false;
        for trace in 0..self.count {
            let header = self.header(trace)?;
            let [inline, crossline] = self.lines(&header);
            inlines.add(inline);
            crosslines.add(crossline);
            let samples = u32::from(u16_at(&header, 114, self.big_endian));
            other_length |= samples != 0 && samples != self.samples;
        }
        let (inlines, crosslines) = (inlines.lines("inlines")?, crosslines.lines("crosslines")?);
        let mut grid = Grid { inlines, crosslines, live: 0 };
        let SegyFields { inline_byte, crossline_byte } = self.fields;
        let remedy = format!(
            "check the byte positions of inline ({inline_byte}) and crossline ({crossline_byte}) numbers"
        );
        if grid.cells() / CELLS_PER_TRACE_MAX > self.count {
            return Err(Error::input(format!(
                "its {} traces are spread over a grid of {} inlines by {} crosslines; {remedy}",
                self.count, inlines.count, crosslines.count
            )));
        }
        let mut seen = vec![0u8; (grid.cells() / 8 + 1) as usize];
        for trace in 0..self.count {
            let header = self.header(trace)?;
            let lines = self.lines(&header);
            let [y, z] = grid.place(lines);
            let cell = u64::from(z) * u64::from(crosslines.count) + u64::from(y);
            let (byte, bit) = ((cell / 8) as usize, 1 << (cell % 8));
            if seen[byte] & bit != 0 {
                return Err(Error::input(format!(
                    "two traces have inline {} and crossline {}; {remedy} (prestack data are not supported)",
                    lines[0], lines[1]
                )));
            }
            seen[byte] |= bit;
            grid.live += u64::from(!self.is_dead(&header));
        }
        let mut notes = vec![format!(
            "inlines {} to {} by {}, crosslines {} to {} by {}, samples {} ms (or metres) apart; \
             the world is the grid, coordinates are not used",
            inlines.first,
            inlines.last(),
            inlines.step,
            crosslines.first,
            crosslines.last(),
            crosslines.step,
            f64::from(self.interval) / 1000.0
        )];
        if other_length {
            notes.push(format!(
                "trace headers promise other lengths; the file header's {} samples fit the file",
                self.samples
            ));
        }
        Ok((grid, notes))
    }
}

/// Least and greatest line number, and the step that reaches them all.
#[derive(Default)]
struct LineRange {
    first: Option<i32>,
    least: i64,
    greatest: i64,
    step: u64,
}

impl LineRange {
    fn add(&mut self, line: i32) {
        let first = *self.first.get_or_insert(line);
        let offset = i64::from(line) - i64::from(first);
        self.least = self.least.min(offset);
        self.greatest = self.greatest.max(offset);
        let (mut a, mut b) = (self.step, offset.unsigned_abs());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        self.step = a;
    }

    fn lines(&self, name: &str) -> Result<Lines> {
        let first = i64::from(self.first.unwrap_or(0)) + self.least;
        let step = self.step.max(1);
        let count = (self.greatest - self.least) as u64 / step + 1;
        if count > EDGE_VOXELS_MAX {
            return Err(Error::input(format!(
                "has {count} {name}; {EDGE_VOXELS_MAX} can be read: check the byte positions of line numbers"
            )));
        }
        Ok(Lines { first, step: step as i64, count: count as u32 })
    }
}

/// Line numbers first, first + step, ...
#[derive(Clone, Copy)]
pub struct Lines {
    first: i64,
    step: i64,
    pub count: u32,
}

impl Lines {
    fn last(self) -> i64 {
        self.first + self.step * i64::from(self.count - 1)
    }
}

/// All cells, with a trace or without.
pub struct Grid {
    pub inlines: Lines,
    pub crosslines: Lines,
    /// Traces that are there and not dead.
    pub live: u64,
}

impl Grid {
    /// Inlines times crosslines.
    pub fn cells(&self) -> u64 {
        u64::from(self.inlines.count) * u64::from(self.crosslines.count)
    }

    /// y and z of a trace.
    pub fn place(&self, [inline, crossline]: [i32; 2]) -> [u32; 2] {
        let index = |line: i32, lines: Lines| ((i64::from(line) - lines.first) / lines.step) as u32;
        [index(crossline, self.crosslines), index(inline, self.inlines)]
    }
}
