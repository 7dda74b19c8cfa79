//! Fewer samples where they say enough: channels that take one of several, and boxes of one value, which
//! are one sample each.

use std::path::Path;
use std::sync::Arc;

use ashfall::import::DenseVolume;
use ashfall::reference::Truth;
use ashfall::render::paging::Traversal;
use ashfall::render::{Addressing, Plan, SceneData, Settings, VolumeData};
use ashfall::scene::{Overrides, Scene};
use ashfall::study::error_metrics::picture_error;
use ashfall::volume::VoxelFormat;

use crate::common::drawing::Device;
use crate::worlds::{
    Look, assert_same, at_level_0, bricks, channel, covered, finished, hill, other_hill, paged,
    plateau, psnr_db, scene_of_whole, scene_text, volume, waves,
};

/// Three channels, which take one of so many samples each.
fn three_channels(every: [u32; 3], overrides: &Overrides) -> SceneData {
    let size = [48, 48, 40];
    let of = |field| channel(size, VoxelFormat::U8, field);
    let dense = bricks(volume(size, vec![of(hill), of(waves), of(other_hill)]), 16);
    scene_with_rates(&dense, &every, overrides)
}

fn scene_with_rates(dense: &Arc<DenseVolume>, every: &[u32], overrides: &Overrides) -> SceneData {
    let mut parts = vec![String::new()];
    let text = scene_text(&vec![VoxelFormat::U8; every.len()], Look::Corner);
    parts.extend(every.iter().map(|every| format!("[[volume.channel]]\nsample_every = {every}\n")));
    let text: String = parts
        .into_iter()
        .zip(text.split("[[volume.channel]]\n"))
        .map(|(begin, rest)| begin + rest)
        .collect();
    let scene = Scene::from_toml(&text, Path::new("made.toml"), overrides)
        .unwrap_or_else(|why| panic!("{why}"));
    let data = VolumeData::of_whole(dense.clone(), dense.voxels().clone());
    SceneData::new(scene, vec![data]).expect("drawable")
}

fn fine() -> Overrides {
    Overrides { step: Some(0.0625), early_stop: Some(0.0), ..at_level_0() }
}

fn traversal(traversal: Traversal) -> Settings {
    paged(|paging| paging.traversal = traversal)
}

fn directly() -> Settings {
    Settings { addressing: Addressing::Direct, ..Settings::default() }
}

/// Rates are steps of the channel's own: the picture is the integral, nearer the shorter they are, and
/// whichever way it is drawn it is the same.
#[test]
fn a_channel_sampled_less_often_is_its_integral_too() {
    let Some(device) = Device::open() else { return };
    let truth = {
        let data = three_channels([1; 3], &fine());
        let scene = &data.scene;
        let (volume, voxels) = data.volume().expect("whole");
        let (size, background) = (scene.picture.size, scene.picture.background);
        Truth::new(&scene.views[0], size, background, &[(volume, &voxels)], 1e-6)
            .picture(2, &|_| {})
            .rgba
    };
    let mut of_every = Vec::new();
    for every in [[1, 1, 1], [1, 2, 2], [4, 4, 8], [16, 8, 1], [16, 16, 16]] {
        let data = three_channels(every, &fine());
        let drawn = device.draw_with(&data, 0, &directly());
        for way in [Traversal::PageTable, Traversal::ResidencyOctree, Traversal::Auto] {
            let in_pages = finished(&device, &data, &traversal(way));
            assert_same(&in_pages.picture, &drawn.picture, &format!("{every:?}, {way:?}"));
        }
        let db = picture_error(&drawn.picture.pixels, &truth).whole.psnr_db;
        println!("every {every:?}: {db:.1} dB");
        assert!(covered(&drawn.picture) > 500 && db > 50.0, "{every:?}: {db:.1} dB");
        of_every.push(db);
    }
    assert!(of_every[0] > of_every[4] + 10.0, "it costs something: {of_every:?}");
    device.finish();
}

/// Where only such channels show, an octree's rays leave out the samples that none takes.
#[test]
fn samples_that_no_channel_takes_are_left_out() {
    let Some(device) = Device::open() else { return };
    let size = [48; 3];
    let of = |field| channel(size, VoxelFormat::U8, field);
    let dense = bricks(volume(size, vec![of(hill), of(other_hill)]), 16);
    let samples = |every: [u32; 2]| {
        let data = scene_with_rates(&dense, &every, &fine());
        let drawn = finished(&device, &data, &traversal(Traversal::ResidencyOctree));
        drawn.statistics.samples
    };
    let [all, quarter, one_of_both] = [[1, 1], [4, 4], [1, 8]].map(samples);
    // To a sample at each border of a box.
    assert!((quarter as f64 / all as f64 - 0.25).abs() < 0.01, "{quarter} of {all}");
    assert!(one_of_both < all * 97 / 100 && one_of_both > quarter, "{one_of_both} of {all}");
    device.finish();
}

#[test]
fn rates_need_the_midpoint_rule() {
    let Some(device) = Device::open() else { return };
    for integrator in ["preintegrated", "adaptive"] {
        let integrator = Some(integrator.to_owned());
        let data = three_channels([1, 2, 1], &Overrides { integrator, ..fine() });
        for settings in [directly(), traversal(Traversal::PageTable)] {
            let why = Plan::new(&device.gpu, &device.compiler, &data, &settings);
            let why = why.expect_err("refused").to_string();
            let paged_adaptive = why.contains("is not built for bricks yet");
            assert!(paged_adaptive || why.contains("sample_every of a channel needs"), "{why}");
        }
    }
    device.finish();
}

/// In substitution, through the octree alone: what may be drawn either way, or has the same bytes for
/// every atlas, is added up sample by sample.
#[test]
fn a_box_of_one_value_is_one_sample() {
    let Some(device) = Device::open() else { return };
    let size = [64; 3];
    let dense = bricks(volume(size, vec![channel(size, VoxelFormat::U8, plateau)]), 16);
    let data = |refine: &str| {
        let refine = Some(refine.to_owned());
        let step = Some(0.25);
        let overrides = Overrides { refine, step, early_stop: Some(0.0), ..at_level_0() };
        scene_of_whole(&dense, Look::Corner, &overrides)
    };
    let draw = |refine: &str, way| finished(&device, &data(refine), &traversal(way));
    let exact = draw("exact", Traversal::PageTable);
    for (refine, way) in [
        ("exact", Traversal::ResidencyOctree),
        ("substitute", Traversal::PageTable),
        ("substitute", Traversal::Auto),
    ] {
        let drawn = draw(refine, way);
        assert_same(&drawn.picture, &exact.picture, &format!("{refine}, {way:?}"));
    }
    let stepwise = draw("exact", Traversal::ResidencyOctree).statistics.samples;
    let closed = draw("substitute", Traversal::ResidencyOctree);
    let (samples, db) = (closed.statistics.samples, psnr_db(&closed.picture, &exact.picture));
    println!("{samples} samples in the place of {stepwise}, {db:.1} dB");
    assert!(samples * 5 < stepwise * 2, "{samples} of {stepwise}");
    assert!(db > 120.0, "{db:.1} dB");
    device.finish();
}
