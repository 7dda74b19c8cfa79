//! From a scene file to a scene with its voxels.

use std::path::Path;

use crate::error::{Error, Result};
use crate::import;
use crate::render::SceneData;
use crate::scene::{Overrides, Scene, Source, Volume};
use crate::source::computed;
use crate::volume::{Size3, VolumeVoxels, VoxelFormat, WorldFromVoxel};

/// Reads the scene and all voxels that it shows into memory.
///
/// # Errors
/// Exit code 3 for an unusable scene or file, 2 for a flag, each at its place.
pub fn load_scene(path: &Path, overrides: &Overrides) -> Result<SceneData> {
    let scene = Scene::load(path, overrides)?;
    SceneData::check_drawable(&scene)?;
    let voxels = load_voxels(&scene)?;
    SceneData::new(scene, voxels)
}

/// As [`load_scene`], for what the reference alone can draw: several volumes.
pub fn load_scene_for_reference(
    path: &Path,
    overrides: &Overrides,
) -> Result<(Scene, Vec<VolumeVoxels>)> {
    let scene = Scene::load(path, overrides)?;
    let voxels = load_voxels(&scene)?;
    Ok((scene, voxels))
}

fn load_voxels(scene: &Scene) -> Result<Vec<VolumeVoxels>> {
    scene.volumes.iter().map(|volume| load_volume(volume, scene)).collect()
}

fn load_volume(volume: &Volume, scene: &Scene) -> Result<VolumeVoxels> {
    let bytes_max = scene.memory.ram_mib << 20;
    let at_place = |why: Error| why.at(format!("{}: volume \"{}\"", volume.place, volume.name));
    match &volume.source {
        Source::File { path, raw } => {
            let options = import::Options { raw: *raw, ..import::Options::default() };
            let mut input = import::open(path, &options).map_err(at_place)?;
            let indices: Vec<u32> = volume.channels.iter().map(|channel| channel.index).collect();
            let in_file = input.header().channels;
            if let Some(beyond) = indices.iter().find(|index| **index >= in_file) {
                return Err(at_place(Error::input(format!(
                    "channel index {beyond} is not in the file, which has {in_file} channel(s), counted from 0"
                ))));
            }
            let (size, format) = (input.header().size, input.header().format);
            check_memory(size, format, indices.len(), scene).map_err(at_place)?;
            let mut voxels =
                import::read_whole(&mut *input, &indices, bytes_max).map_err(at_place)?;
            if let Some(world_from_voxel) = volume.world_from_voxel {
                voxels.world_from_voxel = world_from_voxel;
            }
            Ok(voxels)
        }
        Source::Computed { kind, size } => {
            let field = computed(kind, *size).map_err(at_place)?;
            check_memory(*size, field.format(), 1, scene).map_err(at_place)?;
            let unit = WorldFromVoxel::from_spacing([1.0; 3]).map_err(at_place)?;
            field.whole(volume.world_from_voxel.unwrap_or(unit)).map_err(at_place)
        }
    }
}

/// Refuses, before anything is allocated, voxels that `ram_mib` does not allow.
pub(super) fn check_memory(
    size: Size3,
    format: VoxelFormat,
    channels: usize,
    scene: &Scene,
) -> Result<()> {
    let bytes = size.voxel_count() * format.bytes() as u128 * channels as u128;
    if bytes <= u128::from(scene.memory.ram_mib) << 20 {
        return Ok(());
    }
    Err(Error::input(format!(
        "{size} voxels of {format} take {} MiB of memory, but ram_mib is {}: lower size or raise --ram-mib (paging is not built yet)",
        bytes.div_ceil(1 << 20),
        scene.memory.ram_mib
    )))
}
