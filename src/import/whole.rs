//! A whole input in memory.

use crate::error::{Error, Result};
use crate::import::{Input, Run};
use crate::volume::{ChannelVoxels, Size3, VolumeVoxels, VoxelFormat, Voxels};

/// Collects the wanted channels, in the order asked for. Absent voxels are NaN.
///
/// # Errors
/// When a channel is not there, when the voxels need more than `bytes_max` bytes (exit code 4), or
/// as [`Input::next_run`].
pub fn read_whole(input: &mut dyn Input, channels: &[u32], bytes_max: u64) -> Result<VolumeVoxels> {
    let header = input.header().clone();
    if let Some(channel) = channels.iter().find(|channel| **channel >= header.channels) {
        return Err(Error::input(format!(
            "channel {channel} is asked for, but there are {}, counted from 0",
            header.channels
        ))
        .at(header.path.display()));
    }
    let bytes = header.size.voxel_count() * header.format.bytes() as u128 * channels.len() as u128;
    let len = header.size.len().filter(|_| bytes <= u128::from(bytes_max)).ok_or_else(|| {
        Error::machine(format!(
            "{} voxels of {} in {} channels need {bytes} bytes of memory, but {bytes_max} are allowed: \
             import it to a store first",
            header.size,
            header.format,
            channels.len()
        ))
        .at(header.path.display())
    })?;
    let mut whole: Vec<Voxels> = channels.iter().map(|_| blank(header.format, len)).collect();
    let mut delivered = 0u128;
    while let Some(run) = input.next_run()? {
        delivered += run.size.voxel_count();
        for (voxels, _) in
            whole.iter_mut().zip(channels).filter(|(_, channel)| **channel == run.channel)
        {
            place(voxels, header.size, &run);
        }
    }
    let promised = header.size.voxel_count() * u128::from(header.channels);
    assert_eq!(
        delivered + u128::from(header.absent_voxels),
        promised,
        "{} did not deliver each voxel once",
        header.format_name
    );
    let channels = whole.into_iter().zip(channels).map(|(voxels, channel)| {
        let (slope, intercept) = header.scaling[*channel as usize];
        ChannelVoxels { voxels, slope, intercept }
    });
    Ok(VolumeVoxels {
        size: header.size,
        world_from_voxel: header.world_from_voxel,
        channels: channels.collect(),
    })
}

fn blank(format: VoxelFormat, len: usize) -> Voxels {
    match format {
        VoxelFormat::U8 => Voxels::U8(vec![0; len]),
        VoxelFormat::U16 => Voxels::U16(vec![0; len]),
        VoxelFormat::I16 => Voxels::I16(vec![0; len]),
        VoxelFormat::F32 => Voxels::F32(vec![f32::NAN; len]),
        VoxelFormat::Rgba8 => Voxels::Rgba8(vec![[0; 4]; len]),
    }
}

fn place(whole: &mut Voxels, size: Size3, run: &Run) {
    match (whole, &run.voxels) {
        (Voxels::U8(to), Voxels::U8(from)) => copy_box(to, size, from, run),
        (Voxels::U16(to), Voxels::U16(from)) => copy_box(to, size, from, run),
        (Voxels::I16(to), Voxels::I16(from)) => copy_box(to, size, from, run),
        (Voxels::F32(to), Voxels::F32(from)) => copy_box(to, size, from, run),
        (Voxels::Rgba8(to), Voxels::Rgba8(from)) => copy_box(to, size, from, run),
        (to, from) => panic!("a run of {} in an input of {}", from.format(), to.format()),
    }
}

fn copy_box<T: Copy>(to: &mut [T], size: Size3, from: &[T], run: &Run) {
    let [x, y, z] = run.start;
    let width = run.size.x as usize;
    for (row, voxels) in from.chunks_exact(width).enumerate() {
        let (row_y, row_z) = (row as u32 % run.size.y, row as u32 / run.size.y);
        let first = size.index(x, y + row_y, z + row_z);
        to[first..first + width].copy_from_slice(voxels);
    }
}
