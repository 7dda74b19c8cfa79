//! Other people's formats to voxels, as a stream whose memory does not grow with the file, and such a
//! stream to a store, in one pass and bounded memory ([`import()`]).
//!
//! [`open`] reads the header and checks its promises against the file's length; the voxels then come
//! once, as [`Run`]s in the file's own order. Voxels stay as stored: slope and intercept are handed
//! on beside them. Types that a store cannot hold are widened exactly (i8), or become f32 with a note.
//!
//! # Errors
//! Every error is one sentence behind the file's path, exit code 3. No bytes lead to a panic, and
//! nothing larger than a run is allocated on a header's word.

mod base64;
mod blocks;
mod build;
mod bytes;
mod chain;
mod coarsen;
mod convert;
mod cut;
mod dense;
mod dense_channel;
mod level_slices;
mod linear;
mod metaimage;
mod nifti;
mod nrrd;
mod numpy;
mod pipeline;
mod raw;
mod reduce;
mod sample;
mod segy;
mod slices;
mod stored;
mod stream;
mod text;
mod tiff;
mod vti;
mod whole;
mod xml;
mod zip;

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::store::Store;
use crate::volume::{RawLayout, Size3, VoxelFormat, Voxels, WorldFromVoxel};

pub use dense::DenseVolume;
pub use pipeline::{Progress, Settings, Summary, import, import_from};
pub use whole::read_whole;

/// About the most bytes of voxels in one run.
pub const RUN_BYTES_MAX: usize = 4 << 20;
/// Voxels along one axis: as many as a scene allows.
pub const EDGE_VOXELS_MAX: u64 = 1 << 24;
/// Channels of one file: a brick's id has 16 bits for them.
pub const CHANNELS_MAX: u64 = 1 << 16;

/// An opened input: the header is known, the voxels come once, as runs in the file's own order.
pub trait Input: Send {
    /// What is known before the first voxel.
    fn header(&self) -> &Header;

    /// The next run, or `None` after the last. Every voxel of every channel of the chosen time step
    /// comes exactly once, apart from absent ones.
    ///
    /// # Errors
    /// When the file is truncated, damaged, or longer than its header promises.
    fn next_run(&mut self) -> Result<Option<Run>>;
}

/// A box of voxels of one channel, x fastest, of about [`RUN_BYTES_MAX`] bytes at most.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Index of the channel in the file.
    pub channel: u32,
    /// The first voxel along each axis.
    pub start: [u32; 3],
    /// Voxels along each axis.
    pub size: Size3,
    /// The voxels, in the header's format.
    pub voxels: Voxels,
}

/// What a file says about its voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// The file, for messages.
    pub path: PathBuf,
    /// Voxels along each axis.
    pub size: Size3,
    /// How many channels there are, at least 1.
    pub channels: u32,
    /// How many time steps there are, at least 1.
    pub times: u32,
    /// How the runs' voxels are stored.
    pub format: VoxelFormat,
    /// Voxel (corner origin) to world, in the file's own space and unit.
    pub world_from_voxel: WorldFromVoxel,
    /// Slope and intercept of each channel: scaled value = slope * voxel + intercept.
    pub scaling: Vec<(f64, f64)>,
    /// The length unit that the file states.
    pub unit: Option<String>,
    /// The format's name, for people.
    pub format_name: &'static str,
    /// What was converted, chosen or ignored, a sentence each.
    pub notes: Vec<String>,
    /// Voxels, over all channels, that the file lacks (dead traces, missing slices). They are never
    /// delivered; an input that has any delivers f32, exactly, so that NaN can stand for them.
    pub absent_voxels: u64,
}

/// What the user says about an input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// How a raw file's voxels lie. A file opened with it is read as raw, whatever it looks like.
    pub raw: Option<RawLayout>,
    /// World length of a voxel along each axis, instead of the file's own transform.
    pub spacing: Option<[f64; 3]>,
    /// The time step to read, from 0.
    pub time: u32,
    /// Where a SEG-Y trace header keeps its line numbers.
    pub segy: SegyFields,
}

/// Byte positions in a SEG-Y trace header, counted from 1 as its standard does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SegyFields {
    /// First of the four bytes of the inline number.
    pub inline_byte: u16,
    /// First of the four bytes of the crossline number.
    pub crossline_byte: u16,
}

impl Default for SegyFields {
    fn default() -> SegyFields {
        SegyFields { inline_byte: 189, crossline_byte: 193 }
    }
}

/// Opens a file of any known format, recognised by its first bytes, else by its name.
///
/// # Errors
/// When the file cannot be read, its format is unknown, or its header cannot be true.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    if Store::is_store(path) {
        return stored::open(path, options);
    }
    let placed = |why: Error| why.at(path.display());
    let input = recognise(path, options).map_err(placed)?;
    let mut header = Header { path: path.to_owned(), ..input.header().clone() };
    if let Some(spacing) = options.spacing {
        header.world_from_voxel = WorldFromVoxel::from_spacing(spacing).map_err(placed)?;
        if header.format_name != "raw" {
            header.notes.push("the spacing given replaces the file's own transform".to_owned());
        }
    }
    Ok(Box::new(Placed { header, input }))
}

/// An input whose errors name its file.
struct Placed {
    header: Header,
    input: Box<dyn Input>,
}

impl Input for Placed {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        self.input.next_run().map_err(|why| why.at(self.header.path.display()))
    }
}

fn recognise(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    if let Some(layout) = &options.raw {
        return raw::open(path, layout, options);
    }
    let head = stream::head(path, 512)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if head.starts_with(b"NRRD") {
        return nrrd::open(path, options);
    }
    if numpy::is_array(&head) {
        return numpy::open(path, options);
    }
    if head.starts_with(b"PK") {
        return numpy::open_archive(path, options);
    }
    if vti::is_header(&head) {
        return vti::open(path, options);
    }
    if metaimage::is_header(&head) || name.ends_with(".mhd") || name.ends_with(".mha") {
        return metaimage::open(path, options);
    }
    if name.ends_with(".sgy") || name.ends_with(".segy") {
        return segy::open(path, options);
    }
    if tiff::is_header(&head) {
        return tiff::open(path, options);
    }
    if nifti::is_header(&head) || name.ends_with(".nii.gz") || name.ends_with(".nii") {
        return nifti::open(path, options);
    }
    Err(Error::input(if [".raw", ".gz", ".zst", ".bin"].iter().any(|end| name.ends_with(end)) {
        "a raw file does not say how its voxels lie: give its size and type (--raw-size, --raw-type)"
    } else {
        "the format is not known: NRRD, NIfTI, MetaImage, TIFF, NumPy, VTK ImageData and SEG-Y are \
         read by content or name, raw files with a size and type (--raw-size, --raw-type)"
    }))
}
