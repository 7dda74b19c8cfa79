//! The thread that draws what is wanted, without a window.

use std::time::{Duration, Instant};

use ashfall::gpu::ShaderCompiler;
use ashfall::passes::SOURCES;
use ashfall::render::paging::Rung;
use ashfall::render::{Addressing, SceneData, Settings, StereoLayout, srgb_bytes};
use ashfall::scene::{Overrides, Refine, Scene};
use ashfall::viewer::{Camera, EyesLayout, Live, PICTURE_EDGE_MAX, Screens, Shown, Wanted};
use glam::DVec3;

use crate::binary::ashfall;
use crate::common::drawing::{Device, computed_scene};
use crate::folder::Folder;

fn scene(size: [u32; 2]) -> SceneData {
    let overrides = Overrides { size: Some(size), ..Overrides::default() };
    let mut data = computed_scene("shells", [96; 3], &overrides);
    data.scene.quality.refine = Refine::Substitute;
    data.scene.views.truncate(1);
    data
}

fn settings(lockstep: bool) -> Settings {
    let mut settings = Settings {
        addressing: Addressing::Paged,
        tile: [PICTURE_EDGE_MAX; 2],
        ..Settings::default()
    };
    settings.paging.lockstep = lockstep;
    settings
}

fn live(device: &Device, lockstep: bool) -> (Live, Scene) {
    let data = scene([120, 90]);
    let wanted = data.scene.clone();
    let compiler =
        ShaderCompiler::new(SOURCES, Some(std::env::temp_dir().join("ashfall-test-spirv")));
    let live = Live::new(&device.gpu, compiler, data, settings(lockstep));
    (live.unwrap_or_else(|why| panic!("{why}")), wanted)
}

/// What `render` draws of the scene, exactly.
fn assert_is_render_of(device: &Device, shown: &Shown, wanted: &Scene) {
    assert!(shown.error.is_none(), "{:?}", shown.error);
    let mut data = scene(wanted.picture.size).again(wanted.clone()).expect("drawable");
    data.scene.quality.refine = Refine::Exact;
    let drawn = device.draw_with(&data, 0, &settings(true));
    let picture = shown.picture.as_ref().expect("a picture");
    assert!(picture.pixels.iter().filter(|pixel| pixel[3] > 0.1).count() > 200, "something");
    assert!(**picture == drawn.picture, "not what is drawn exactly");
    assert_eq!(*shown.bytes, srgb_bytes(&drawn.picture));
}

#[test]
fn the_last_scene_wanted_is_shown_exactly() {
    let Some(device) = Device::open() else { return };
    for lockstep in [true, false] {
        let (live, mut wanted) = live(&device, lockstep);
        let middle = DVec3::splat(0.5);
        let mut camera = Camera::new(wanted.views[0].clone(), middle);
        live.want(wanted.clone());
        assert_is_render_of(&device, &live.converged(), &wanted);
        let mut seen = 0;
        for turn in 0..40 {
            camera.orbit(0.05, 0.01);
            wanted.views[0] = camera.view().clone();
            // Smaller and back: the same renderer goes on. Larger: another one.
            wanted.picture.size = match turn {
                10..20 => [60, 45],
                30.. => [150, 100],
                _ => [120, 90],
            };
            live.want(wanted.clone());
            if turn % 7 == 0 {
                // Pictures follow while things move: a newer scene's comes, however slow the machine.
                let begun = Instant::now();
                while live.shown().scene <= seen {
                    assert!(begun.elapsed() < Duration::from_secs(60), "no picture of turn {turn}");
                    std::thread::sleep(Duration::from_millis(1));
                }
                seen = live.shown().scene;
            }
        }
        assert_is_render_of(&device, &live.converged(), &wanted);
        assert!(seen > 5, "{seen}");
        // Another transfer function, and another quality.
        let channel = &mut wanted.volumes[0].channels[0];
        channel.window[1] *= 0.7;
        live.want(wanted.clone());
        assert_is_render_of(&device, &live.converged(), &wanted);
        wanted.quality.step = 0.8;
        wanted.quality.early_stop = 0.01;
        live.want(wanted.clone());
        assert_is_render_of(&device, &live.converged(), &wanted);
    }
    device.finish();
}

/// A hand that never rests: bricks come all the same, and what is seen is not the coarsest level for good.
#[test]
fn bricks_come_while_the_camera_never_rests() {
    let Some(device) = Device::open() else { return };
    let (live, mut wanted) = live(&device, false);
    let mut camera = Camera::new(wanted.views[0].clone(), DVec3::splat(0.5));
    live.want(wanted.clone());
    let begun = Instant::now();
    // Whenever a round ends, another scene is wanted already.
    while live.shown().number < 60 {
        assert!(begun.elapsed() < Duration::from_secs(100), "no pictures");
        camera.orbit(0.001, 0.0002);
        wanted.views[0] = camera.view().clone();
        live.want(wanted.clone());
        std::thread::sleep(Duration::from_micros(200));
    }
    let slots = live.shown().cache.slots.iter().flatten().count();
    let at_rest = live.converged().cache.slots.iter().flatten().count();
    println!("slots in use while it moves {slots}, at rest {at_rest}");
    assert!(slots * 2 > at_rest && at_rest > 15, "{slots}, {at_rest}");
    device.finish();
}

/// Two eyes: every picture that is shown is of all of them at one moment, and the finished one is
/// what `render` draws of each.
#[test]
fn pictures_of_several_views_come_together() {
    let Some(device) = Device::open() else { return };
    let (live, wanted) = live(&device, false);
    let layout = EyesLayout::Joined(StereoLayout::SideBySide);
    let screens = Screens::Eyes { layout, separation: Some(0.3), distance: Some(2.0) };
    let mut camera = Camera::new(wanted.views[0].clone(), DVec3::splat(0.5));
    let size = screens.picture_size([160, 60], 1);
    assert_eq!(size, [80, 60]);
    let mut scene_of = wanted.clone();
    scene_of.picture.size = size;
    for _ in 0..10 {
        camera.orbit(0.05, 0.01);
        let views = screens.views(camera.view(), camera.distance(), [160, 60], 1);
        scene_of.views = views.expect("eyes");
        live.want_on(Wanted {
            scene: scene_of.clone(),
            screens: screens.clone(),
            rung: Rung::FINEST,
        });
        std::thread::sleep(Duration::from_millis(5));
    }
    let shown = live.converged();
    assert!(shown.error.is_none() && shown.lacks.is_empty(), "{:?}", shown.error);
    let mut data = scene(size).again(scene_of).expect("drawable");
    data.scene.quality.refine = Refine::Exact;
    let [left, right] = [0, 1].map(|eye| device.draw_with(&data, eye, &settings(true)).picture);
    assert!(left != right);
    let joined = StereoLayout::SideBySide.joined(&left, &right);
    assert!(**shown.picture.as_ref().expect("a picture") == joined);
    drop(live);
    device.finish();
}

#[test]
fn a_scene_that_cannot_be_drawn_is_told_and_the_next_one_is_drawn() {
    let Some(device) = Device::open() else { return };
    let (live, wanted) = live(&device, true);
    let mut bad = wanted.clone();
    bad.volumes[0].channels[0].level_max = Some(0);
    bad.quality.integrator = ashfall::scene::Integrator::Adaptive;
    live.want(bad.clone());
    let shown = live.converged();
    let why = shown.error.expect("refused").to_string();
    assert!(why.contains("\"adaptive\" is not built for bricks yet"), "{why}");
    live.want(wanted.clone());
    assert_is_render_of(&device, &live.converged(), &wanted);
    // While one is shown.
    live.want(bad);
    assert!(live.converged().error.is_some());
    live.want(wanted.clone());
    assert_is_render_of(&device, &live.converged(), &wanted);
    device.finish();
}

#[test]
fn at_rest_nothing_is_submitted_and_the_end_does_not_wait() {
    let Some(device) = Device::open() else { return };
    let (live, mut wanted) = live(&device, false);
    live.want(wanted.clone());
    live.converged();
    let before = device.gpu.submits();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(device.gpu.submits(), before);
    // An end in the middle of a picture: after its round.
    wanted.picture.size = [1600, 1200];
    wanted.quality.step = 0.05;
    live.want(wanted);
    std::thread::sleep(Duration::from_millis(20));
    let begun = Instant::now();
    drop(live);
    println!("ended in {:.0} ms", begun.elapsed().as_secs_f64() * 1e3);
    device.finish();
}

/// Small, so that it cannot break unseen.
#[test]
fn pictures_follow_a_path_in_every_atlas() {
    if std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        return;
    }
    let folder = Folder::new("interaction");
    let text = "format = 1\n[[volume]]\nname = \"v\"\nsource = { computed = \"shells\", size = [96, 96, 96] }\n\
        [[volume.channel]]\nwindow = [0.0, 1.0]\ntransfer = [\n\
        { at = 0.2, color = [1, 1, 1], extinction = 0.0 }, { at = 1.0, color = [1, 1, 1], extinction = 0.1 }]\n\
        [[view]]\neye = [150.0, -100.0, 120.0]\ntarget = [48.0, 48.0, 48.0]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 40.0\n";
    let scene = folder.write("scene.toml", text);
    let run = ashfall([
        "bench".as_ref(),
        "interaction".as_ref(),
        scene.as_os_str(),
        "--size=80x60".as_ref(),
        "--steps=5".as_ref(),
        "--atlases=1,64".as_ref(),
        "--json".as_ref(),
        "--validate".as_ref(),
    ]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let table: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    let rows = table["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2);
    for row in rows {
        let of = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
        assert!(of("step_ms") > 0.0 && of("step_ms") <= of("step_p95_ms"), "{row}");
        assert!(of("step_p95_ms") <= of("step_worst_ms") && of("first_picture_ms") > 0.0, "{row}");
        assert!((1.0..=3.0).contains(&of("rounds_to_picture_max")), "{row}");
        assert!(of("converged_ms") > 0.0 && of("bricks_read") > 5.0, "{row}");
    }
}
