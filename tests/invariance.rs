//! What must not change a picture: repetition, steps per dispatch, tiles, layout; and marches longer
//! than any driver's loop limit.

mod common;

use ashfall::render::{Layout, LayoutChoice, Settings};
use ashfall::scene::Overrides;
use common::drawing::{Device, Drawn, computed_scene, scene_data};

fn overrides(early_stop: f64) -> Overrides {
    Overrides {
        size: Some([97, 61]),
        step: Some(0.25),
        early_stop: Some(early_stop),
        ..Overrides::default()
    }
}

fn bytes(drawn: &Drawn) -> &[u8] {
    bytemuck::cast_slice(&drawn.picture.pixels)
}

#[test]
fn the_same_bytes_however_the_work_is_cut() {
    let Some(device) = Device::open() else { return };
    for early_stop in [0.0, 0.01] {
        let data = computed_scene("marschner-lobb", [48, 40, 33], &overrides(early_stop));
        let whole = device.draw(&data, 0);
        assert!(whole.picture.pixels.iter().any(|pixel| pixel[3] > 0.5), "something is seen");
        let auto = Settings::default();
        let cuts = [
            auto,
            Settings { steps_per_dispatch: 1, ..auto },
            Settings { steps_per_dispatch: 33, ..auto },
            Settings { steps_per_dispatch: 32768, ..auto },
            Settings { tile: [16, 16], ..auto },
            Settings { tile: [97, 7], steps_per_dispatch: 64, ..auto },
            Settings { tile: [1, 61], ..auto },
            Settings { layout: LayoutChoice::Only(Layout::Plain), ..auto },
            Settings { layout: LayoutChoice::Only(Layout::Quads), steps_per_dispatch: 96, ..auto },
        ];
        for settings in cuts {
            let cut = device.draw_with(&data, 0, &settings);
            assert!(bytes(&cut) == bytes(&whole), "{settings:?} changes the picture");
            assert_eq!(cut.statistics.samples, whole.statistics.samples, "{settings:?}");
        }
    }
    device.finish();
}

#[test]
fn staging_size_does_not_matter() {
    let Some(device) = Device::open() else { return };
    let data = computed_scene("hydrogen", [130, 70, 90], &overrides(0.0));
    let whole = device.draw(&data, 0);
    let small = Overrides { staging_mib: Some(1), ..overrides(0.0) };
    let pieces = device.draw(&computed_scene("hydrogen", [130, 70, 90], &small), 0);
    assert!(bytes(&pieces) == bytes(&whole));
    device.finish();
}

/// Settings that look at every sample.
fn everything() -> Settings {
    Settings { skipping: false, ..Settings::default() }
}

#[test]
fn leaving_out_what_shows_nothing_changes_no_byte() {
    let Some(device) = Device::open() else { return };
    let text = |source: &str, channels: usize| {
        let channel = |index: usize| {
            format!(
                r#"
[[volume.channel]]
index = {index}
window = [0.0, 1.0]
transfer = [
  {{ at = 0.0, color = [0.9, 0.2, 0.1], extinction = 0.0 }},
  {{ at = 0.61, color = [0.9, 0.2, 0.1], extinction = 0.0 }},
  {{ at = 0.63, color = [0.3, 0.9, 0.5], extinction = 40.0 }},
  {{ at = 0.66, color = [0.1, 0.5, 0.9], extinction = 0.0 }},
  {{ at = 0.98, color = [0.1, 0.5, 0.9], extinction = 0.0 }},
  {{ at = 0.98, color = [0.8, 0.8, 0.9], extinction = 7.0 }},
]
"#
            )
        };
        format!(
            r#"
format = 1
[[volume]]
source = {source}
spacing = [0.01, 0.011, 0.013]
{}
[[view]]
eye = [2.0, 1.3, 1.7]
target = [0.45, 0.45, 0.3]
up = [0.0, 0.0, 1.0]
fov_degrees = 30.0
"#,
            (0..channels).map(channel).collect::<String>()
        )
    };
    let source = "{ computed = \"marschner-lobb\", size = [90, 83, 41] }";
    for (integrator, step, filter) in [
        ("riemann", 0.31, "exact"),
        ("riemann", 3.0, "exact"),
        ("preintegrated", 0.5, "exact"),
        ("preintegrated", 7.3, "exact"),
    ] {
        let overrides = Overrides {
            integrator: Some(integrator.to_owned()),
            step: Some(step),
            filter: Some(filter.to_owned()),
            ..overrides(0.001)
        };
        let data = scene_data(&text(source, 1), &overrides);
        let all = device.draw_with(&data, 0, &everything());
        let some = device.draw(&data, 0);
        assert!(bytes(&all) == bytes(&some), "{integrator}, step {step}: another picture");
        let (all, some) = (all.statistics.samples, some.statistics.samples);
        assert!(some * 5 < all * 4, "{integrator}, step {step}: {some} of {all} samples");
        assert!(some > 0);
    }
    device.finish();
}

/// A fog of 100,000 steps a ray. In 64 layers of rising density, so that losing any part is seen.
#[test]
fn a_march_of_a_hundred_thousand_steps_is_whole() {
    let Some(device) = Device::open() else { return };
    let text = r#"
format = 1
[picture]
size = [8, 8]
[quality]
step = 0.00064
early_stop = 0.0
[[volume]]
source = { computed = "ramp", size = [64, 2, 2] }
[[volume.channel]]
window = [0.0, 1.0]
transfer = [
  { at = 0.0, color = [0.2, 0.4, 0.6], extinction = 0.01 },
  { at = 1.0, color = [0.9, 0.7, 0.5], extinction = 0.05 },
]
[[view]]
eye = [-10.0, 1.0, 1.0]
target = [1.0, 1.0, 1.0]
up = [0.0, 0.0, 1.0]
height = 1.0
"#;
    let data = scene_data(text, &Overrides::default());
    let drawn = device.draw(&data, 0);
    assert_eq!(drawn.statistics.samples, 64 * 100_000, "100,000 samples of each of 64 rays");
    let dispatches = drawn.records.iter().flat_map(|record| &record.steps);
    let marches = dispatches.filter(|step| step.label == "march").count();
    assert!(marches >= 25, "{marches} dispatches of at most 4096 steps");
    let (volume, voxels) = data.volume().unwrap_or_else(|why| panic!("{why}"));
    let truth = ashfall::reference::render(
        &data.scene.views[0],
        [8, 8],
        [0.0; 3],
        &[(volume, &*voxels)],
        &ashfall::reference::Settings::default(),
        &|_| {},
    );
    for (got, want) in drawn.picture.pixels.iter().zip(&truth.rgba) {
        for part in 0..4 {
            let error = (f64::from(got[part]) - want[part]).abs();
            assert!(error < 2e-6, "{got:?} against {want:?}: {error:e}");
        }
    }
    device.finish();
}
