//! Volumes made for their corners: values, formats, sizes, levels. The same bytes through every atlas.

use std::sync::Arc;

use ashfall::render::paging::CopyPath;
use ashfall::render::{Addressing, SceneData, Settings, Statistics};
use ashfall::scene::Overrides;
use ashfall::source::{FieldSource, computed};
use ashfall::volume::{Size3, VoxelFormat, Voxels, WorldFromVoxel};

use crate::common::drawing::Device;
use crate::worlds::{
    Look, assert_same, at_level_0, bricks, bytes_volume, channel, covered, finished, hill,
    other_hill, paged, plateau, psnr_db, scene, scene_of_whole, slots, volume, waves,
};

/// Against drawing directly: bricks of one value are not interpolated, which saves a rounding or two.
const DIRECT_DB_MIN: f64 = 120.0;

/// Little room, more, all there is; each with other choices.
fn ways() -> [Settings; 5] {
    let crowded = paged(|paging| {
        paging.atlas_slots = Some(8);
        paging.staging_bricks = Some(1);
        paging.loaders = Some(8);
        paging.lockstep = false;
    });
    let placed = paged(|paging| {
        paging.atlas_slots = Some(12);
        paging.copy_path = Some(CopyPath::Placed);
    });
    let unskipped = paged(|paging| {
        paging.atlas_slots = Some(64);
        paging.loaders = Some(1);
    });
    let roomy = paged(|paging| paging.lockstep = false);
    [
        slots(8),
        Settings { steps_per_dispatch: 32, ..crowded },
        Settings { tile: [40, 24], ..placed },
        Settings { skipping: false, ..unskipped },
        roomy,
    ]
}

/// All ways give the same bytes, drawn directly too where that means the same; statistics of the first.
fn the_same_every_way(device: &Device, what: &str, data: &SceneData, direct: bool) -> Statistics {
    let [first, others @ ..] = ways();
    let least = 2 * data.volumes[0].channels.len() as u32;
    let first = finished(device, data, &Settings { paging: slots(8.max(least)).paging, ..first });
    let seen = covered(&first.picture);
    assert!(seen > 200, "{what}: {seen} pixels show something");
    for settings in others {
        let drawn = finished(device, data, &settings);
        assert_same(&drawn.picture, &first.picture, &format!("{what}, {settings:?}"));
    }
    if direct {
        let settings = Settings { addressing: Addressing::Direct, ..Settings::default() };
        let drawn = device.draw_with(data, 0, &settings);
        let (db, same) = (psnr_db(&drawn.picture, &first.picture), drawn.picture == first.picture);
        println!("{what}: direct {db:.1} dB, the same bytes: {same}");
        assert!(db >= DIRECT_DB_MIN, "{what}: {db:.1} dB against direct");
    }
    first.statistics
}

#[test]
fn bricks_of_one_value_are_drawn_and_never_travel() {
    let Some(device) = Device::open() else { return };
    let size = [80; 3];
    let dense = bricks(volume(size, vec![channel(size, VoxelFormat::U8, plateau)]), 16);
    let data = scene_of_whole(&dense, Look::Corner, &at_level_0());
    let statistics = the_same_every_way(&device, "plateau", &data, true);
    assert!(statistics.bricks_constant > 20, "{statistics:?}");
    assert!(statistics.bricks_hidden > 10, "{statistics:?}");
    assert!(statistics.bricks_uploaded < 125 / 2, "{statistics:?}");
    device.finish();
}

/// Sheets of 14 voxels that begin one voxel behind the border of every other brick of 16.
fn sheets([x, _, _]: [f64; 3]) -> f64 {
    let voxel = (x * 64.0) as u32 % 32;
    if (17..31).contains(&voxel) { 0.9 } else { 0.0 }
}

#[test]
fn what_is_skipped_ends_at_its_border() {
    let Some(device) = Device::open() else { return };
    let dense = bytes_volume(64, sheets);
    // Towards lower x and towards higher, where a sample too far lands in a sheet.
    for look in [Look::Corner, Look::Inside] {
        let data = scene_of_whole(&dense, look, &at_level_0());
        let statistics = the_same_every_way(&device, "sheets", &data, true);
        assert!(statistics.bricks_hidden + statistics.bricks_constant >= 32, "{statistics:?}");
    }
    device.finish();
}

#[test]
fn every_voxel_format_alone_and_together() {
    let Some(device) = Device::open() else { return };
    let size = [56, 48, 40];
    let formats = [VoxelFormat::Rgba8, VoxelFormat::I16, VoxelFormat::U16, VoxelFormat::F32];
    for format in formats {
        let dense = bricks(volume(size, vec![channel(size, format, hill)]), 16);
        let data = scene_of_whole(&dense, Look::Corner, &at_level_0());
        the_same_every_way(&device, format.name(), &data, true);
    }
    let mixed = vec![
        channel(size, VoxelFormat::U8, hill),
        channel(size, VoxelFormat::F32, waves),
        channel(size, VoxelFormat::U8, other_hill),
        channel(size, VoxelFormat::U16, waves),
    ];
    let data = scene_of_whole(&bricks(volume(size, mixed), 16), Look::Corner, &at_level_0());
    let plan = device.plan(&data, &slots(8));
    assert_eq!(plan.images.len(), 3, "one atlas per texel format: {:?}", plan.images);
    the_same_every_way(&device, "four channels of three formats", &data, true);
    device.finish();
}

#[test]
fn nan_voxels_stay_nothing() {
    let Some(device) = Device::open() else { return };
    let size = [50, 50, 50];
    let mut holed = channel(size, VoxelFormat::F32, hill);
    let Voxels::F32(voxels) = &mut holed.voxels else { unreachable!("as asked") };
    // Single ones, and whole bricks.
    voxels.iter_mut().step_by(97).for_each(|voxel| *voxel = f32::NAN);
    voxels[..50 * 50 * 18].fill(f32::NAN);
    let dense = bricks(volume(size, vec![holed]), 16);
    let data = scene_of_whole(&dense, Look::Corner, &at_level_0());
    the_same_every_way(&device, "NaN", &data, true);
    device.finish();
}

#[test]
fn odd_sizes_and_payloads() {
    let Some(device) = Device::open() else { return };
    for (size, payload) in
        [([61, 47, 33], 8), ([61, 47, 33], 16), ([8, 64, 9], 8), ([65, 1, 33], 32), ([7, 9, 5], 16)]
    {
        let dense = bricks(volume(size, vec![channel(size, VoxelFormat::U8, waves)]), payload);
        let data = scene_of_whole(&dense, Look::Corner, &at_level_0());
        let seen = covered(&finished(&device, &data, &slots(8)).picture);
        assert!(seen > 20, "{size:?}: {seen} pixels");
        let what = format!("{size:?} in bricks of {payload}");
        if seen > 200 {
            the_same_every_way(&device, &what, &data, true);
        }
    }
    device.finish();
}

#[test]
fn a_second_drawing_reads_nothing_and_is_the_same() {
    let Some(device) = Device::open() else { return };
    let data = scene(bytes_volume(64, waves), Look::Corner, &at_level_0());
    for settings in [slots(8), ways()[1]] {
        let mut renderer = device.renderer(&data, &settings);
        let mut draw = || renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        let ((first, _), (second, again)) = (draw(), draw());
        assert_same(&second, &first, &format!("{settings:?}"));
        let loading = again.loading.expect("bricks were loaded");
        assert!(again.bricks_uploaded > 40, "{again:?}");
        assert!(loading.cache_hits > 40, "they came from the RAM cache: {loading:?}");
        assert!(loading.reads <= 64, "and were read once: {loading:?}");
    }
    device.finish();
}

fn with_levels(size: u32) -> Overrides {
    Overrides { size: Some([size; 2]), level_max: None, step: Some(0.5), ..Overrides::default() }
}

#[test]
fn several_levels_along_a_ray() {
    let Some(device) = Device::open() else { return };
    let size = [80; 3];
    for (what, channels) in [
        ("one channel", vec![channel(size, VoxelFormat::U8, waves)]),
        (
            "two formats",
            vec![channel(size, VoxelFormat::U16, hill), channel(size, VoxelFormat::U8, waves)],
        ),
    ] {
        let dense = bricks(volume(size, channels), 8);
        let data = scene(dense, Look::Inside, &with_levels(40));
        let statistics = the_same_every_way(&device, what, &data, false);
        let levels = statistics.bricks_uploaded_by_level.iter().filter(|count| **count > 0).count();
        assert!(levels > 1, "{what}: {:?}", statistics.bricks_uploaded_by_level);
    }
    device.finish();
}

#[test]
fn a_computed_volume_larger_than_its_atlas_seen_from_within() {
    let Some(device) = Device::open() else { return };
    let size = Size3::cube(2048);
    let unit = WorldFromVoxel::from_spacing([1.0 / 2048.0; 3]).expect("a spacing");
    let field = computed("shells", size).expect("a known kind");
    let source = Arc::new(FieldSource::new("shells", field, size, Size3::cube(32), unit));
    let data = scene(source, Look::Inside, &with_levels(64));
    let statistics = the_same_every_way(&device, "shells", &data, false);
    let by_level = &statistics.bricks_uploaded_by_level;
    println!("shells: {} needed, uploaded by level {by_level:?}", statistics.bricks_needed);
    assert!(by_level.iter().filter(|count| **count > 0).count() > 1, "{by_level:?}");
    device.finish();
}
