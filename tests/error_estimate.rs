//! `--error`: the estimate of a picture's error covers the true one, is not far above it, and says how
//! each part is known.

mod binary;
mod common;
mod folder;

use ashfall::cli::load_scene;
use ashfall::reference::{Settings as TruthSettings, render as truth};
use ashfall::render::{Addressing, SceneData, Settings};
use ashfall::scene::Overrides;
use ashfall::study::error_estimate::{
    Coverage, Drawing, Drawn, DrawnBy, ErrorEstimate, How, coverage,
};
use binary::ashfall;
use common::drawing::{Device, computed_scene};
use folder::Folder;

/// Of pixels, as measured: 0.995 to 1.
const COVERED_LEAST: f64 = 0.99;
/// Estimate over true error, as measured: 2.5 to 12. A factor of 3 is the step's, for errors that fall with
/// its square; neighbours and early stop add to it.
const OVER_TRUTH_MOST: f64 = 20.0;

struct Estimated {
    estimate: ErrorEstimate,
    covered: Coverage,
    converged: bool,
}

/// Draws the first view, estimates its error, and compares with the truth of level 0.
fn estimated(device: &Device, data: &mut SceneData, settings: &Settings) -> Estimated {
    let asked = data.scene.quality.clone();
    let mut renderer = device.renderer(data, settings);
    let (picture, statistics) = renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
    let by = DrawnBy::plan(renderer.plan(), data);
    drop(renderer);
    let drawn = [Drawn { picture, statistics }];
    let mut drawing = Drawing {
        gpu: &device.gpu,
        compiler: &device.compiler,
        settings: settings.checked().unwrap_or_else(|why| panic!("{why}")),
        progress: &mut |_, _| {},
    };
    let estimates = drawing.estimate(data, &by, &drawn).unwrap_or_else(|why| panic!("{why}"));
    assert_eq!(data.scene.quality, asked, "the scene is as it was");
    let estimate = estimates.into_iter().next().expect("one view");
    let [drawn] = drawn;
    let covered = coverage(&estimate.total, &drawn.picture.pixels, &reference(data));
    Estimated { estimate, covered, converged: drawn.statistics.converged }
}

fn reference(data: &SceneData) -> Vec<[f64; 4]> {
    let (volume, voxels) = data.volume().unwrap_or_else(|why| panic!("{why}"));
    let scene = &data.scene;
    let settings = TruthSettings { tolerance: 1e-7, ..TruthSettings::default() };
    let (size, background) = (scene.picture.size, scene.picture.background);
    truth(&scene.views[0], size, background, &[(volume, &*voxels)], &settings, &|_| {}).rgba
}

fn part_names(estimate: &ErrorEstimate) -> Vec<(&'static str, How)> {
    estimate.parts.iter().map(|part| (part.name, part.how)).collect()
}

fn quality(integrator: &str, step_or_tolerance: f64) -> Overrides {
    let adaptive = integrator == "adaptive";
    Overrides {
        size: Some([112, 96]),
        integrator: Some(integrator.to_owned()),
        step: (!adaptive).then_some(step_or_tolerance),
        tolerance: adaptive.then_some(step_or_tolerance),
        level_max: Some(0),
        ..Overrides::default()
    }
}

const QUALITIES: [(&str, f64); 6] = [
    ("riemann", 1.0),
    ("riemann", 0.25),
    ("preintegrated", 1.0),
    ("preintegrated", 0.25),
    ("adaptive", 0.1),
    ("adaptive", 0.001),
];

/// Every integrator, coarse and fine; twice the pictures' early stop beside it.
#[test]
fn estimates_cover_the_error_and_are_not_far_above() {
    let Some(device) = Device::open() else { return };
    let mut failures = Vec::new();
    let mut held = |what: &str, load: &dyn Fn(&Overrides) -> SceneData| {
        for (integrator, at) in QUALITIES {
            let mut data = load(&quality(integrator, at));
            let found = estimated(&device, &mut data, &Settings::default());
            let Coverage { covered, beyond_max, over_truth, true_rms } = found.covered;
            println!(
                "{what}, {integrator} {at}: covers {:.3} %, beyond {beyond_max:.1e}, {over_truth:.1} times {true_rms:.1e}",
                100.0 * covered
            );
            if covered.is_nan() || covered < COVERED_LEAST || over_truth > OVER_TRUTH_MOST {
                failures.push(format!("{what}, {integrator} {at}: {:?}", found.covered));
            }
            let names = part_names(&found.estimate);
            assert!(names.contains(&("step", How::Estimate)), "{what}: {names:?}");
        }
    };
    held("marschner-lobb", &|overrides| computed_scene("marschner-lobb", [41, 41, 41], overrides));
    held("hydrogen", &|overrides| computed_scene("hydrogen", [64, 40, 50], overrides));
    if let Some(shared) = common::shared_data() {
        for scene in ["scenes/bonsai.toml", "scenes/engine.toml", "synth256/sparse.toml"] {
            let path = shared.join(scene);
            held(scene, &|overrides| {
                load_scene(&path, overrides).unwrap_or_else(|why| panic!("{why}"))
            });
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
    device.finish();
}

/// One voxel value: the one sample of a ray is exact, and nothing is drawn to find that out.
#[test]
fn what_is_exact_has_no_parts() {
    let Some(device) = Device::open() else { return };
    let mut data = computed_scene("constant", [8, 8, 8], &quality("riemann", 1.0));
    let found = estimated(&device, &mut data, &Settings::default());
    assert_eq!(part_names(&found.estimate), []);
    assert_eq!((found.estimate.control_samples, found.estimate.control_ms), (0, 0.0));
    assert_eq!(found.covered.covered, 1.0, "{:?}", found.covered);
    device.finish();
}

/// Pixels larger than voxels: levels are in use, and what they cost is a part of its own. A picture of level
/// 0 has none.
#[test]
fn levels_are_a_part_where_they_are_in_use() {
    let Some(device) = Device::open() else { return };
    let paged = Settings { addressing: Addressing::Paged, ..Settings::default() };
    // The volume has levels 0 to 2: of the last there is no coarser one.
    for (size, level_max, from) in [
        ([24, 20], Some(0), None),
        ([48, 40], Some(1), Some("levels above 0 one coarser")),
        ([24, 20], None, Some("levels above 0 one finer")),
    ] {
        let overrides = Overrides { size: Some(size), level_max, ..quality("riemann", 0.25) };
        let mut data = computed_scene("hydrogen", [96, 96, 96], &overrides);
        let found = estimated(&device, &mut data, &paged);
        let levels = found.estimate.parts.iter().find(|part| part.name == "levels");
        println!("{size:?}, {from:?}: {:?}", found.covered);
        assert_eq!(
            levels.map(|part| (part.how, &*part.from)),
            from.map(|from| (How::Estimate, from))
        );
        assert!(found.covered.covered >= 0.9, "{size:?}, {from:?}: {:?}", found.covered);
    }
    device.finish();
}

/// An atlas in which refinement by substitution cannot end: the picture that it should have been is drawn.
#[test]
fn substituted_levels_are_measured() {
    let Some(device) = Device::open() else { return };
    let mut settings = Settings { addressing: Addressing::Paged, ..Settings::default() };
    settings.paging.atlas_slots = Some(10);
    let overrides = Overrides {
        size: Some([64, 64]),
        refine: Some("substitute".to_owned()),
        ..quality("riemann", 0.5)
    };
    let mut data = computed_scene("hydrogen", [96, 96, 96], &overrides);
    let found = estimated(&device, &mut data, &settings);
    assert!(!found.converged, "ten slots are to be too few");
    let levels = found.estimate.parts.iter().find(|part| part.name == "levels").expect("a part");
    assert_eq!(levels.how, How::Measured);
    assert!(levels.max > 0.01, "substituted levels show: {}", levels.max);
    assert!(found.covered.covered >= COVERED_LEAST, "{:?}", found.covered);
    device.finish();
}

/// From the command to the layers and back.
#[test]
fn layers_are_written_and_compared() {
    let folder = Folder::new("error-layers");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tools/demo_scenes/hydrogen.toml");
    let (picture, png) = (folder.path("a.exr"), folder.path("a.png"));
    let (heat, truth) = (folder.path("heat.png"), folder.path("truth.exr"));
    let text = |path: &std::path::Path| path.to_str().expect("utf-8").to_owned();
    let size = ["--size", "32x24", "--level-max", "0"];
    let made = ashfall(["reference", scene, "-o", &text(&truth)].iter().chain(&size));
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    let (picture, png, heat, truth) = (text(&picture), text(&png), text(&heat), text(&truth));
    let flags = ["--error", "--error-picture", &heat, "--reference", &truth, "--json"];
    let render = ["render", scene, "-o", &picture, "-o", &png];
    let drawn = ashfall(render.iter().chain(&size).chain(&flags));
    assert_eq!(drawn.code, Some(0), "{}", drawn.stderr);
    let said: serde_json::Value = serde_json::from_str(&drawn.stdout).expect("json");
    let error = &said["views"][0]["error"];
    assert_eq!(error["parts"][0]["name"], "step", "{error}");
    assert_eq!(error["parts"][0]["how"], "estimate", "{error}");
    let covered = error["truth"]["covered"].as_f64().expect("a part");
    assert!(covered >= 0.95, "{error}");
    assert!(std::fs::read(&heat).expect("picture of the error").starts_with(b"\x89PNG"));

    let compared = ashfall(["compare", &picture, &truth, "--psnr", "1", "--json"]);
    assert_eq!(compared.code, Some(0), "{}", compared.stderr);
    let said: serde_json::Value = serde_json::from_str(&compared.stdout).expect("json");
    assert_eq!(said["error"]["covered"].as_f64(), Some(covered), "{said}");
    // A picture without layers is compared as ever.
    let plain = ashfall(["compare", &truth, &picture, "--psnr", "1", "--json"]);
    assert!(!plain.stdout.contains("\"error\""), "{}", plain.stdout);

    let other = ashfall([
        "render",
        scene,
        "-o",
        &picture,
        "--size",
        "16x16",
        "--error",
        "--reference",
        &truth,
    ]);
    assert_eq!(other.code, Some(3));
    assert!(
        other.sentence().expect("one").contains("32 x 24 pixels, the picture 16 x 16"),
        "{}",
        other.stderr
    );
    let alone = ashfall(["render", scene, "-o", &picture, "--reference", &truth]);
    assert_eq!(alone.code, Some(2), "{}", alone.stderr);
}
