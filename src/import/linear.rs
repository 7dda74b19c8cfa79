//! Inputs whose voxels lie one after another in one stream: most formats, once their header is read.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::import::blocks::{Axis, Blocks, Layout, Target};
use crate::import::stream::Stream;
use crate::import::{Header, Input, Options, Run};
use crate::volume::WorldFromVoxel;

/// What a header says beside the layout.
pub struct Details {
    pub format_name: &'static str,
    pub world_from_voxel: WorldFromVoxel,
    /// Slope and intercept of every channel.
    pub scaling: (f64, f64),
    pub unit: Option<String>,
    pub notes: Vec<String>,
}

/// One stream of voxels in a regular order.
pub struct Linear {
    header: Header,
    blocks: Blocks,
    stream: Stream,
    bytes: u64,
    pending: VecDeque<Run>,
    finished: bool,
}

impl Linear {
    /// Checks the layout against what the stream, which stands at its first voxel, can hold.
    pub fn new(
        layout: Layout,
        stream: Stream,
        mut details: Details,
        options: &Options,
    ) -> Result<Linear> {
        let size = layout.checked_size()?;
        let (channels, times) = (layout.len(Axis::Channel) as u32, layout.len(Axis::Time) as u32);
        let bytes = fitting(&layout, &stream)?;
        check_time(options.time, times)?;
        let format = layout.sample.delivered();
        details.notes.extend(layout.sample.note());
        let header = Header {
            // Known to whoever opened the file.
            path: PathBuf::new(),
            size,
            channels,
            times,
            format,
            world_from_voxel: details.world_from_voxel,
            scaling: vec![details.scaling; channels as usize],
            unit: details.unit,
            format_name: details.format_name,
            notes: details.notes,
            absent_voxels: 0,
        };
        let target = Target { origin: [0; 3], clip: size, channel: 0, time: options.time, format };
        let blocks = Blocks::new(layout, target);
        Ok(Linear { header, blocks, stream, bytes, pending: VecDeque::new(), finished: false })
    }

    fn failed(&self, why: &io::Error) -> Error {
        let (done, bytes, coding) = (self.blocks.bytes_done(), self.bytes, self.stream.coding());
        Error::input(if why.kind() == io::ErrorKind::UnexpectedEof {
            format!(
                "the {coding} voxels are truncated: they end after byte {done} of {bytes} or little later; \
                 get the whole file"
            )
        } else {
            format!("the {coding} voxels are damaged after byte {done} of {bytes}: {why}")
        })
    }

    /// After the last voxel: checksums are met, and nothing follows.
    fn finish(&mut self) -> Result<()> {
        self.finished = true;
        // Later time steps were not read, so there is no end to look at.
        if self.stream.is_plain() || self.blocks.bytes_done() < self.bytes {
            return Ok(());
        }
        match self.stream.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(Error::input(format!(
                "the {} voxels go on after the {} bytes that its size and type need; check size and type",
                self.stream.coding(),
                self.bytes
            ))),
            Err(why) => Err(self.failed(&why)),
        }
    }
}

impl Input for Linear {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        while self.pending.is_empty() && !self.finished {
            match self.blocks.next(&mut self.stream) {
                Ok(Some(runs)) => self.pending.extend(runs),
                Ok(None) => self.finish()?,
                Err(why) => {
                    self.finished = true;
                    return Err(self.failed(&why));
                }
            }
        }
        Ok(self.pending.pop_front())
    }
}

/// Refuses a time step that is not there.
pub fn check_time(time: u32, times: u32) -> Result<()> {
    if time < times {
        return Ok(());
    }
    Err(Error::input(format!(
        "time step {time} is asked for, but there are {times}, counted from 0"
    )))
}

/// The bytes of the layout, once the stream can hold them.
fn fitting(layout: &Layout, stream: &Stream) -> Result<u64> {
    let (need, had) = (layout.bytes(), stream.bytes_max());
    if u128::from(had) == need || (!stream.is_plain() && u128::from(had) > need) {
        return Ok(need as u64);
    }
    let what = describe(layout)?;
    Err(Error::input(if stream.is_plain() {
        format!("holds {had} bytes of voxels, but {what} need {need}; check size and type")
    } else {
        format!(
            "its {} bytes decode to {had} at most, but {what} need {need}; check size and type",
            stream.coding()
        )
    }))
}

fn describe(layout: &Layout) -> Result<String> {
    let size = layout.checked_size()?;
    let mut what = format!("{size} voxels of {}", layout.sample.name());
    for (axis, name) in [(Axis::Channel, "channels"), (Axis::Time, "time steps")] {
        let len = layout.len(axis);
        if len > 1 {
            what += &format!(" in {len} {name}");
        }
    }
    Ok(what)
}
