//! Bricks loaded over bricks needed, in lockstep: about one, whatever the atlas, and always an end.

use std::sync::Arc;

use ashfall::cli::load_scene;
use ashfall::import::DenseVolume;
use ashfall::render::SceneData;
use ashfall::scene::Overrides;
use ashfall::source::computed;
use ashfall::volume::{Size3, VolumeVoxels, VoxelFormat, WorldFromVoxel};

use crate::common::drawing::Device;
use crate::common::shared_data;
use crate::worlds::{
    Look, at_level_0, bricks, bytes_volume, channel, finished, fog, hill, other_hill, scene, slots,
    volume, waves,
};

/// One channel, at every size.
const FACTOR_MAX_ONE: f64 = 1.02;
/// Several, from [`SLOTS_ENOUGH`] on.
const FACTOR_MAX_SEVERAL: f64 = 1.05;
const SLOTS_ENOUGH: u32 = 64;

/// Draws through atlases of these sizes and prints a row for each.
fn measure(device: &Device, what: &str, data: &SceneData, sizes: &[u32], least_needed: u64) {
    let several = data.volumes[0].channels.len() > 1;
    let mut too_many = Vec::new();
    for count in sizes {
        let statistics = finished(device, data, &slots(*count)).statistics;
        let (needed, loaded) = (statistics.bricks_needed, statistics.bricks_uploaded);
        // Counted by loaders, not by rays: the RAM cache holds all, so that each is read once.
        let read = statistics.loading.expect("bricks were loaded").reads;
        let factor = loaded as f64 / needed.min(read) as f64;
        println!(
            "| {what:<34} | {count:>5} | {needed:>6} | {:>6} | {factor:.3} |",
            statistics.rounds
        );
        assert!(needed >= least_needed, "{what}: only {needed} bricks are needed");
        assert!(loaded >= needed, "{what}: {loaded} loaded of {needed} needed");
        let most = if several { FACTOR_MAX_SEVERAL } else { FACTOR_MAX_ONE };
        if factor > most && (!several || *count >= SLOTS_ENOUGH) {
            too_many.push(format!("{what}, {count} slots: {factor:.3}, at most {most}"));
        }
    }
    assert!(too_many.is_empty(), "{too_many:#?}");
}

fn with_levels() -> Overrides {
    Overrides { size: Some([48, 48]), step: Some(0.5), ..Overrides::default() }
}

/// The same formulas as the reference's own scenes, moved apart, in bricks of 16.
fn four_channels(edge: u32) -> Arc<DenseVolume> {
    let size = Size3::cube(edge);
    let unit = WorldFromVoxel::from_spacing([1.0 / f64::from(edge); 3]).expect("a spacing");
    let computed_channel = |kind| {
        let whole = computed(kind, size).and_then(|field| field.whole(unit));
        whole.unwrap_or_else(|why| panic!("{why}")).channels.remove(0)
    };
    let cube = [edge; 3];
    let channels = vec![
        computed_channel("hydrogen"),
        channel(cube, VoxelFormat::U8, waves),
        channel(cube, VoxelFormat::U8, other_hill),
        computed_channel("shells"),
    ];
    bricks(VolumeVoxels { size, world_from_voxel: unit, channels }, 16)
}

#[test]
fn one_channel_is_loaded_once() {
    let Some(device) = Device::open() else { return };
    let sizes = [8, 16, 64, 256];
    for (what, field) in [("hill", hill as fn(_) -> _), ("waves", waves), ("fog", fog)] {
        let data = scene(bytes_volume(128, field), Look::Corner, &at_level_0());
        measure(&device, &format!("{what}, outside"), &data, &sizes, 50);
    }
    let data = scene(bytes_volume(160, fog), Look::Inside, &with_levels());
    measure(&device, "fog, inside, levels by distance", &data, &sizes, 50);
    let data = scene(bytes_volume(128, fog), Look::Parallel, &at_level_0());
    measure(&device, "fog, parallel rays", &data, &sizes, 50);
    device.finish();
}

#[test]
fn several_channels_are_loaded_about_once() {
    let Some(device) = Device::open() else { return };
    let sizes = [8, 16, 64, 256];
    let dense = four_channels(96);
    let data = scene(dense.clone(), Look::Corner, &at_level_0());
    measure(&device, "four channels, outside", &data, &sizes, 200);
    let data = scene(dense, Look::Inside, &with_levels());
    measure(&device, "four channels, inside, levels", &data, &sizes, 60);
    let size = [96; 3];
    let mixed = vec![
        channel(size, VoxelFormat::U8, fog),
        channel(size, VoxelFormat::U16, waves),
        channel(size, VoxelFormat::U8, other_hill),
    ];
    let data = scene(bricks(volume(size, mixed), 16), Look::Corner, &at_level_0());
    measure(&device, "three channels, two atlases", &data, &sizes, 200);
    device.finish();
}

fn real(scene: &str, size: u32, sizes: &[u32]) {
    let Some(folder) = shared_data() else { return };
    let Some(device) = Device::open() else { return };
    let overrides = Overrides { size: Some([size; 2]), level_max: Some(0), ..Overrides::default() };
    let data = load_scene(&folder.join(scene), &overrides).unwrap_or_else(|why| panic!("{why}"));
    measure(&device, scene, &data, sizes, 10);
    device.finish();
}

#[test]
fn real_scenes_are_loaded_about_once() {
    real("scenes/bonsai.toml", 128, &[8, 64]);
    real("scenes/dna_2_channels.toml", 96, &[8, 64]);
}

#[test]
#[ignore = "minutes: larger volumes and pictures"]
fn larger_scenes_are_loaded_about_once() {
    let sizes = [8, 16, 64, 256, 1024];
    for scene in ["bonsai", "aneurism", "engine", "mni152", "stent", "dna_2_channels"] {
        real(&format!("scenes/{scene}.toml"), 256, &sizes);
    }
    let Some(device) = Device::open() else { return };
    let data = scene(four_channels(192), Look::Corner, &at_level_0());
    measure(&device, "four channels of 192, outside", &data, &sizes, 500);
    let data = scene(bytes_volume(256, fog), Look::Corner, &at_level_0());
    measure(&device, "fog of 256, outside", &data, &sizes, 500);
    device.finish();
}
