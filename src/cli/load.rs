//! From a scene file to a scene with its volumes opened.
//!
//! A store and a computed volume are opened, and no brick of them is read. Any other file is read
//! whole, which `ram_mib` must allow; a store is the way to draw what it does not.

use std::path::Path;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::import::{self, DenseVolume, Options};
use crate::render::{SceneData, VolumeData, check_memory};
use crate::scene::{Overrides, Scene, Source, Volume};
use crate::source::{BrickSource, FieldSource, computed};
use crate::store::Store;
use crate::volume::{BRICK_PAYLOAD_DEFAULT, Size3, WorldFromVoxel};

/// Of volumes that are not cut into bricks yet.
const PAYLOAD: Size3 = Size3::cube(BRICK_PAYLOAD_DEFAULT);

/// Reads the scene and opens all volumes that it shows.
///
/// # Errors
/// Exit code 3 for an unusable scene or file, 2 for a flag, each at its place.
pub fn load_scene(path: &Path, overrides: &Overrides) -> Result<SceneData> {
    let scene = Scene::load(path, overrides)?;
    SceneData::check_drawable(&scene)?;
    let volumes = open_volumes(&scene)?;
    SceneData::new(scene, volumes)
}

/// As [`load_scene`], for what the reference alone can draw: several volumes.
///
/// # Errors
/// As [`load_scene`].
pub fn load_scene_for_reference(path: &Path, overrides: &Overrides) -> Result<SceneData> {
    let scene = Scene::load(path, overrides)?;
    let volumes = open_volumes(&scene)?;
    Ok(SceneData::joined(scene, volumes))
}

fn open_volumes(scene: &Scene) -> Result<Vec<VolumeData>> {
    let ram_mib = scene.memory.ram_mib;
    let open = |volume| open_volume(volume, ram_mib).map_err(|why| volume.at(why));
    scene.volumes.iter().map(open).collect()
}

fn open_volume(volume: &Volume, ram_mib: u64) -> Result<VolumeData> {
    let channels = volume.channels.iter().map(|channel| channel.index);
    match &volume.source {
        Source::File { path, raw } => {
            let options = Options { raw: *raw, ..Options::default() };
            let shown = Shown::These(channels.collect());
            let place = volume.world_from_voxel;
            open_file(path, &options, shown, place, ram_mib).map(|(data, _)| data)
        }
        Source::Computed { kind, size } => {
            let field = computed(kind, *size)?;
            let world_from_voxel = match volume.world_from_voxel {
                Some(stated) => stated,
                None => WorldFromVoxel::from_spacing([1.0; 3])?,
            };
            let source = FieldSource::new(kind, field, *size, PAYLOAD, world_from_voxel);
            Ok(VolumeData::new(Arc::new(source), vec![0]))
        }
    }
}

/// The channels of a file that are wanted.
pub(super) enum Shown {
    /// These, in this order.
    These(Vec<u32>),
    /// So many, or all if there are fewer.
    First(u32),
}

impl Shown {
    fn of(self, in_file: u32) -> Result<Vec<u32>> {
        let indices = match self {
            Shown::These(indices) => indices,
            Shown::First(most) => (0..in_file.min(most)).collect(),
        };
        if let Some(beyond) = indices.iter().find(|index| **index >= in_file) {
            return Err(Error::input(format!(
                "channel index {beyond} is not in the file, which has {in_file} channel(s), counted from 0"
            )));
        }
        Ok(indices)
    }
}

/// Opens a file, and says how many channels it has. `world_from_voxel` wins over the file's own; a
/// store's levels stay as they are cut.
///
/// # Errors
/// Exit code 3 for a file that cannot be used, or that must be read whole and does not fit `ram_mib`.
pub(super) fn open_file(
    path: &Path,
    options: &Options,
    shown: Shown,
    world_from_voxel: Option<WorldFromVoxel>,
    ram_mib: u64,
) -> Result<(VolumeData, u32)> {
    if Store::is_store(path) {
        let store = Store::open(path)?;
        // A store has at most 65535 channels.
        let in_file = store.description().channels.len() as u32;
        let channels = shown.of(in_file)?.into_iter().map(|index| index as u16).collect();
        return Ok((VolumeData::new(Arc::new(store), channels), in_file));
    }
    let mut input = import::open(path, options)?;
    let header = input.header();
    let (in_file, size, format) = (header.channels, header.size, header.format);
    let indices = shown.of(in_file)?;
    let file = path.display();
    let remedy =
        format!("import it first (`ashfall import {file} -o OUT.bricks`) or raise --ram-mib");
    check_memory(size, &vec![format; indices.len()], ram_mib, &remedy)
        .map_err(|why| why.at(&file))?;
    let mut voxels = import::read_whole(&mut *input, &indices, ram_mib << 20)?;
    if let Some(stated) = world_from_voxel {
        voxels.world_from_voxel = stated;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let dense = DenseVolume::new(&name, Arc::new(voxels), PAYLOAD);
    let whole = dense.voxels().clone();
    Ok((VolumeData::of_whole(Arc::new(dense), whole), in_file))
}
