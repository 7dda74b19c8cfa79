//! A buffer that the host writes batch by batch while the device still reads earlier batches: each goes
//! behind the last, and the host waits only for readers of what it overwrites.
//!
//! Apart from [`Buffer`], whose writes wait for every use of it, whatever bytes that use is of.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::misuse::misuse;
use crate::gpu::record::HostEvent;
use crate::gpu::resources::{Buffer, BufferSpec};
use crate::gpu::roles::TimePoint;

/// See the module.
pub struct Ring {
    gpu: Arc<Gpu>,
    buffer: Buffer,
    /// The last batch's end.
    end: u64,
    /// Written, and not said yet until when it is read.
    unread: Option<Range<u64>>,
    /// Batches that the device may still read, oldest first, and until when.
    read: VecDeque<(Range<u64>, TimePoint)>,
}

impl Ring {
    /// Makes its buffer.
    ///
    /// # Errors
    /// Exit code 4 when the device has no memory left.
    pub fn new(gpu: &Arc<Gpu>, spec: &BufferSpec) -> Result<Ring> {
        let buffer = Buffer::new(gpu, spec)?;
        Ok(Ring { gpu: gpu.clone(), buffer, end: 0, unread: None, read: VecDeque::new() })
    }

    /// For passes to read.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Writes a batch and gives the bytes that it has taken, and what the host did for the record of the
    /// submit that reads it, of which [`Ring::read_until`] is to be told before the next batch.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn write(&mut self, batch: &[u8]) -> Result<(Range<u64>, Vec<HostEvent>)> {
        let bytes = batch.len() as u64;
        let fits = self.end.checked_add(bytes).is_some_and(|end| end <= self.buffer.bytes());
        let start = if fits { self.end } else { 0 };
        let range = start..start + bytes;
        let mut host = Vec::new();
        // Oldest first: whoever waits for a batch has waited for those before it.
        while self.read.iter().any(|(of, _)| of.start < range.end && range.start < of.end) {
            let Some((_, point)) = self.read.pop_front() else { break };
            self.gpu.wait(point)?;
            host.push(HostEvent::Waited(point));
        }
        self.buffer.write_apart(range.start, batch);
        host.push(HostEvent::Wrote { buffer: self.buffer.name(), range: range.clone() });
        self.end = range.end;
        self.unread = Some(range.clone());
        Ok((range, host))
    }

    /// The last batch is read until then.
    pub fn read_until(&mut self, point: TimePoint) {
        let Some(range) = self.unread.take() else {
            misuse(format_args!("no batch in {} to be read", self.buffer.name()))
        };
        self.read.push_back((range, point));
    }
}
