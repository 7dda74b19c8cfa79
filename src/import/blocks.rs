//! Boxes of voxels out of a stream whose axes come in any order.

use std::io::{self, Read};

use crate::error::{Error, Result};
use crate::import::sample::{Gather, Sample};
use crate::import::stream::Stream;
use crate::import::{CHANNELS_MAX, EDGE_VOXELS_MAX, RUN_BYTES_MAX, Run};
use crate::volume::{Size3, VoxelFormat};

/// What an axis of a file counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    X,
    Y,
    Z,
    Channel,
    Time,
}

/// How voxels lie in a stream: its axes, fastest first, each of another kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    pub axes: Vec<(Axis, u64)>,
    pub sample: Sample,
    pub big_endian: bool,
}

impl Layout {
    /// Elements along an axis: 1 where the file has no such axis.
    pub fn len(&self, axis: Axis) -> u64 {
        self.axes.iter().find(|(kind, _)| *kind == axis).map_or(1, |(_, len)| *len)
    }

    /// The size in voxels, once every axis is within what a volume may have.
    pub fn checked_size(&self) -> Result<Size3> {
        for &(axis, len) in &self.axes {
            let (name, len_max) = match axis {
                Axis::X | Axis::Y | Axis::Z => ("voxels along an axis", EDGE_VOXELS_MAX),
                Axis::Channel => ("channels", CHANNELS_MAX),
                Axis::Time => ("time steps", EDGE_VOXELS_MAX),
            };
            if len == 0 || len > len_max {
                return Err(Error::input(format!(
                    "header promises {len} {name}; 1 to {len_max} can be read"
                )));
            }
        }
        // The casts are lossless: every axis is at most 2^24 long.
        let edge = |axis| self.len(axis) as u32;
        Ok(Size3::new(edge(Axis::X), edge(Axis::Y), edge(Axis::Z)))
    }

    /// Bytes of all voxels of all channels and time steps.
    pub fn bytes(&self) -> u128 {
        let elements: u128 = self.axes.iter().map(|(_, len)| u128::from(*len)).product();
        elements * self.sample.bytes() as u128
    }
}

/// Where the boxes of a layout go in the volume.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The volume's voxel that is the layout's first.
    pub origin: [u32; 3],
    /// The volume's size: what lies beyond is left out (padding of tiles).
    pub clip: Size3,
    /// The volume's channel that is the layout's first.
    pub channel: u32,
    /// The time step to deliver.
    pub time: u32,
    /// The format to deliver.
    pub format: VoxelFormat,
}

/// Walks a layout block by block, each of about [`RUN_BYTES_MAX`] bytes at most.
pub struct Blocks {
    layout: Layout,
    target: Target,
    /// Axes before this one are whole in every block; this one is cut into pieces.
    split: usize,
    piece: u64,
    at: Vec<u64>,
    done: bool,
    bytes_done: u64,
    buffer: Vec<u8>,
}

impl Blocks {
    /// From the first byte on. The layout's axes must have been checked.
    pub fn new(layout: Layout, target: Target) -> Blocks {
        let mut room = (RUN_BYTES_MAX / layout.sample.bytes()) as u64;
        let mut split = 0;
        while split + 1 < layout.axes.len() && layout.axes[split].1 <= room {
            room /= layout.axes[split].1;
            split += 1;
        }
        let at = vec![0; layout.axes.len()];
        let piece = layout.axes[split].1.min(room).max(1);
        Blocks { layout, target, split, piece, at, done: false, bytes_done: 0, buffer: Vec::new() }
    }

    /// Bytes of the stream that were read or left out.
    pub fn bytes_done(&self) -> u64 {
        self.bytes_done
    }

    /// The runs of the next block, none of them for another time step; `None` after the last.
    pub fn next(&mut self, stream: &mut Stream) -> io::Result<Option<Vec<Run>>> {
        if self.done || self.only_later_times_left() {
            return Ok(None);
        }
        let counts = self.counts();
        let bytes = counts.iter().product::<u64>() * self.layout.sample.bytes() as u64;
        let runs = if self.wanted(&counts) {
            self.buffer.resize(bytes as usize, 0);
            stream.read_exact(&mut self.buffer)?;
            self.runs(&counts)
        } else {
            stream.skip(bytes)?;
            Vec::new()
        };
        self.bytes_done += bytes;
        self.advance(&counts);
        Ok(Some(runs))
    }

    /// Elements of the block along each axis.
    fn counts(&self) -> Vec<u64> {
        let count = |(index, &(_, len)): (usize, &(Axis, u64))| match index {
            _ if index < self.split => len,
            _ if index == self.split => self.piece.min(len - self.at[index]),
            _ => 1,
        };
        self.layout.axes.iter().enumerate().map(count).collect()
    }

    fn wanted(&self, counts: &[u64]) -> bool {
        let time = u64::from(self.target.time);
        self.layout.axes.iter().zip(&self.at).zip(counts).all(|(((axis, _), at), count)| {
            *axis != Axis::Time || (*at..at + count).contains(&time)
        })
    }

    fn only_later_times_left(&self) -> bool {
        let slowest = self.layout.axes.iter().rposition(|(_, len)| *len > 1);
        slowest.is_some_and(|slowest| {
            self.layout.axes[slowest].0 == Axis::Time
                && self.at[slowest] > u64::from(self.target.time)
        })
    }

    fn advance(&mut self, counts: &[u64]) {
        let axes = self.at.iter_mut().zip(counts).zip(&self.layout.axes);
        for ((at, count), (_, len)) in axes.skip(self.split) {
            *at += count;
            if *at < *len {
                return;
            }
            *at = 0;
        }
        self.done = true;
    }

    fn runs(&self, counts: &[u64]) -> Vec<Run> {
        // Start, count and stride in the block, per kind of axis.
        let mut axes = [(0u64, 1u64, 0usize); 5];
        let mut stride = 1;
        for (index, (axis, _)) in self.layout.axes.iter().enumerate() {
            axes[*axis as usize] = (self.at[index], counts[index], stride);
            stride *= counts[index] as usize;
        }
        let clip = self.target.clip.to_array();
        let start: [u64; 3] =
            std::array::from_fn(|axis| axes[axis].0 + u64::from(self.target.origin[axis]));
        let size: [u32; 3] = std::array::from_fn(|axis| {
            u64::from(clip[axis]).saturating_sub(start[axis]).min(axes[axis].1) as u32
        });
        if size.contains(&0) {
            return Vec::new();
        }
        let (first, channels, channel_stride) = axes[Axis::Channel as usize];
        let (time, _, time_stride) = axes[Axis::Time as usize];
        let time_base = (u64::from(self.target.time).saturating_sub(time)) as usize * time_stride;
        (0..channels)
            .map(|channel| {
                let at = Gather {
                    base: time_base + channel as usize * channel_stride,
                    stride: std::array::from_fn(|axis| axes[axis].2),
                    size: size.map(|edge| edge as usize),
                };
                Run {
                    channel: self.target.channel + (first + channel) as u32,
                    start: start.map(|edge| edge as u32),
                    size: Size3::from_array(size),
                    voxels: self.layout.sample.voxels(
                        &self.buffer,
                        self.layout.big_endian,
                        &at,
                        self.target.format,
                    ),
                }
            })
            .collect()
    }
}
