//! What every reader of a format gives: a header, then the voxels once, in the file's own order.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::volume::{RawLayout, Size3, VoxelFormat, Voxels, WorldFromVoxel};

/// An opened input: the header is known, the voxels come once, as runs in the file's own order.
pub trait Input: Send {
    /// What the file says of itself.
    fn header(&self) -> &Header;
    /// The next voxels, or nothing at the end.
    ///
    /// # Errors
    /// When the file is cut or damaged.
    fn next_run(&mut self) -> Result<Option<Run>>;
}

/// A box of voxels of one channel, x fastest; at most about 4 MiB.
pub struct Run {
    /// Which channel, from 0.
    pub channel: u32,
    /// First voxel along each axis.
    pub start: [u32; 3],
    /// Voxels along each axis.
    pub size: Size3,
    /// As many as the box has.
    pub voxels: Voxels,
}

/// What a file says of itself.
pub struct Header {
    /// Voxels along each axis.
    pub size: Size3,
    /// At least 1.
    pub channels: u32,
    /// Time steps in the file; one of them is read.
    pub times: u32,
    /// Of every channel.
    pub format: VoxelFormat,
    /// Voxel (corner origin) to world.
    pub world_from_voxel: WorldFromVoxel,
    /// Slope and intercept per channel; empty when all are 1 and 0.
    pub scaling: Vec<(f64, f64)>,
    /// Of world lengths.
    pub unit: Option<String>,
    /// As users know it.
    pub format_name: &'static str,
    /// What a user should know about how the file was understood.
    pub notes: Vec<String>,
    /// Voxels of all channels that the file does not have.
    pub absent_voxels: u64,
}

/// What the command line says about an input.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// How a raw file is laid out.
    pub raw: Option<RawLayout>,
    /// World length of a voxel along each axis; wins over the file's.
    pub spacing: Option<[f64; 3]>,
    /// Which time step.
    pub time: u32,
}

/// Opens a raw file.
///
/// # Errors
/// When it cannot be read or its length is not what the layout says.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let place = path.display();
    let Some(layout) = options.raw else {
        return Err(Error::input(format!("{place}: is in no known format; say --raw-size")));
    };
    let file =
        File::open(path).map_err(|why| Error::input(format!("{place}: cannot be read ({why})")))?;
    let len = file.metadata().map_or(0, |metadata| metadata.len());
    let wanted = layout.size.voxel_count() * layout.format.bytes() as u128;
    if u128::from(len) != wanted {
        return Err(Error::input(format!("{place}: has {len} bytes where {wanted} belong")));
    }
    let header = Header {
        size: layout.size,
        channels: 1,
        times: 1,
        format: layout.format,
        world_from_voxel: WorldFromVoxel::from_spacing(options.spacing.unwrap_or([1.0; 3]))?,
        scaling: Vec::new(),
        unit: None,
        format_name: "raw",
        notes: Vec::new(),
        absent_voxels: 0,
    };
    Ok(Box::new(Raw { file, header, next: [0; 2], layout }))
}

struct Raw {
    file: File,
    header: Header,
    /// Row and slice.
    next: [u32; 2],
    layout: RawLayout,
}

impl Input for Raw {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        let size = self.header.size;
        let [y, z] = self.next;
        if z == size.z {
            return Ok(None);
        }
        let row = size.x as u64 * self.layout.format.bytes() as u64;
        let rows = ((4 << 20) / row).clamp(1, u64::from(u32::MAX)) as u32;
        let run = if y == 0 && rows >= size.y {
            let slices = (rows / size.y).min(size.z - z);
            self.next = [0, z + slices];
            Size3::new(size.x, size.y, slices)
        } else {
            let rows = rows.min(size.y - y);
            self.next = if y + rows == size.y { [0, z + 1] } else { [y + rows, z] };
            Size3::new(size.x, rows, 1)
        };
        let mut bytes = vec![0; run.len().expect("runs are small") * self.layout.format.bytes()];
        self.file.read_exact(&mut bytes).map_err(|why| Error::input(format!("{why}")))?;
        if self.layout.big_endian {
            bytes.chunks_exact_mut(self.layout.format.bytes()).for_each(|voxel| voxel.reverse());
        }
        let voxels = match self.layout.format {
            VoxelFormat::U8 => Voxels::U8(bytes),
            format => Voxels::from_bytes(format, &bytes),
        };
        Ok(Some(Run { channel: 0, start: [0, y, z], size: run, voxels }))
    }
}
