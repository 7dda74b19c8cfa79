//! Raw files: voxels and nothing else, plain or in a .gz or .zst file.

use std::path::Path;

use crate::error::Result;
use crate::import::blocks::{Axis, Layout};
use crate::import::linear::{Details, Linear};
use crate::import::sample::Sample;
use crate::import::stream::{Coding, Section, Stream};
use crate::import::{Input, Options};
use crate::volume::{RawLayout, VoxelFormat, WorldFromVoxel};

/// Opens a raw file. Its name, not its bytes, says whether it is compressed: any bytes can be voxels.
pub fn open(path: &Path, raw: &RawLayout, options: &Options) -> Result<Box<dyn Input>> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let coding = match () {
        () if name.ends_with(".gz") => Coding::Gzip,
        () if name.ends_with(".zst") => Coding::Zstd,
        () => Coding::None,
    };
    let sample = match raw.format {
        VoxelFormat::U8 => Sample::U8,
        VoxelFormat::U16 => Sample::U16,
        VoxelFormat::I16 => Sample::I16,
        VoxelFormat::F32 => Sample::F32,
        VoxelFormat::Rgba8 => Sample::Rgba8,
    };
    let [x, y, z] = raw.size.to_array().map(u64::from);
    let layout = Layout {
        axes: vec![(Axis::X, x), (Axis::Y, y), (Axis::Z, z)],
        sample,
        big_endian: raw.big_endian,
    };
    let details = Details {
        format_name: "raw",
        world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3])?,
        scaling: (1.0, 0.0),
        unit: None,
        notes: Vec::new(),
    };
    let stream = Stream::new(Section::of_file(path)?, coding)?;
    Ok(Box::new(Linear::new(layout, stream, details, options)?))
}
