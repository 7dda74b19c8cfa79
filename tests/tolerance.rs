//! The integrator "adaptive" keeps to its tolerance: against the reference, over every scene.

mod common;

use std::path::Path;

use ashfall::cli::load_scene;
use ashfall::reference::{Settings as TruthSettings, render as truth};
use ashfall::render::{Addressing, Plan, SceneData, Settings};
use ashfall::scene::Overrides;
use common::drawing::{Device, computed_scene};

const TOLERANCES: [f64; 3] = [0.1, 0.01, 0.001];
/// f32 adds up some hundred samples.
const ROUNDING: f64 = 2e-6;

fn overrides(size: [u32; 2], tolerance: f64) -> Overrides {
    Overrides {
        size: Some(size),
        integrator: Some("adaptive".to_owned()),
        tolerance: Some(tolerance),
        level_max: Some(0),
        ..Overrides::default()
    }
}

fn reference(data: &SceneData) -> Vec<[f64; 4]> {
    let (volume, voxels) = data.volume().unwrap_or_else(|why| panic!("{why}"));
    let scene = &data.scene;
    let settings = TruthSettings { tolerance: 1e-7, ..TruthSettings::default() };
    let (size, background) = (scene.picture.size, scene.picture.background);
    truth(&scene.views[0], size, background, &[(volume, &*voxels)], &settings, &|_| {}).rgba
}

/// Draws with every tolerance: greatest error of a component over the tolerance, and samples.
fn held(
    device: &Device,
    what: &str,
    most: f64,
    load: impl Fn(f64) -> SceneData,
    failures: &mut Vec<String>,
) {
    let truth = reference(&load(TOLERANCES[0]));
    let mut line = format!("{what}:");
    let mut samples_before = 0;
    for tolerance in TOLERANCES {
        let drawn = device.draw(&load(tolerance), 0);
        let parts = drawn.picture.pixels.iter().flatten().zip(truth.iter().flatten());
        let error = parts.map(|(got, truth)| (f64::from(*got) - truth).abs()).fold(0.0, f64::max);
        let samples = drawn.statistics.samples;
        line += &format!(
            " {tolerance}: {:.2} ({:.2} M samples)",
            error / tolerance,
            samples as f64 / 1e6
        );
        if error.is_nan() || error > most * tolerance + ROUNDING {
            failures.push(format!("{what}, tolerance {tolerance}: error {error:.2e}"));
        }
        if samples <= samples_before {
            failures.push(format!("{what}, tolerance {tolerance}: no more samples than before"));
        }
        samples_before = samples;
    }
    println!("{line}");
}

#[test]
fn computed_scenes_keep_to_the_tolerance() {
    let Some(device) = Device::open() else { return };
    let mut failures = Vec::new();
    for (kind, size) in [
        ("marschner-lobb", [41, 41, 41]),
        ("hydrogen", [64, 40, 50]),
        ("ramp", [30, 3, 100]),
        ("mandelbulb", [64, 64, 64]),
    ] {
        let load = |tolerance| computed_scene(kind, size, &overrides([96, 80], tolerance));
        held(&device, kind, 1.0, load, &mut failures);
    }
    assert!(failures.is_empty(), "{failures:#?}");
    device.finish();
}

/// Of these the reference is all that is known: twice the tolerance is allowed.
#[test]
fn real_scenes_keep_to_twice_the_tolerance() {
    let Some(data_folder) = common::shared_data() else { return };
    let Some(device) = Device::open() else { return };
    let mut failures = Vec::new();
    for scene in [
        "scenes/bonsai.toml",
        "scenes/aneurism.toml",
        "scenes/engine.toml",
        "scenes/stent.toml",
        "scenes/mni152.toml",
        "scenes/dna_2_channels.toml",
        "scenes/marschner_lobb.toml",
        "synth256/sparse.toml",
        "synth256/linear.toml",
    ] {
        let path = data_folder.join(scene);
        let load = |tolerance| {
            load_scene(Path::new(&path), &overrides([128, 128], tolerance))
                .unwrap_or_else(|why| panic!("{why}"))
        };
        held(&device, scene, 2.0, load, &mut failures);
    }
    assert!(failures.is_empty(), "{failures:#?}");
    device.finish();
}

/// Bricks have no macrocells yet: it is said, not done another way.
#[test]
fn bricks_are_refused() {
    let Some(device) = Device::open() else { return };
    let data = computed_scene("ramp", [30, 3, 100], &overrides([16, 16], 0.01));
    let settings = Settings { addressing: Addressing::Paged, ..Settings::default() };
    let refused = Plan::new(&device.gpu, &device.compiler, &data, &settings);
    let why = refused.map(|_| ()).expect_err("refused");
    assert_eq!(why.exit as u8, 3, "{why}");
    assert!(why.message.contains("adaptive") && why.message.contains("--atlas-mib"), "{why}");
    device.finish();
}
