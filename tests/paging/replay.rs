//! Runs written down and done again: the same bytes in every round, whatever the disk does that day; and with
//! forced arrivals and evictions the same cache where rays differ.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use ashfall::error::Exit;
use ashfall::render::paging::{Recording, Replayed, Traversal};
use ashfall::render::{Picture, Renderer, SceneData, Settings, Statistics};
use ashfall::scene::{Overrides, Refine, View};
use ashfall::source::faulty::{Faulty, Slow};
use glam::DVec3;

use crate::common::drawing::Device;
use crate::worlds::{
    Look, assert_same, bytes_volume, covered, fog, other_hill, paged, psnr_db, scene, waves,
};

/// Pictures of a replay elsewhere, against those of the recording.
const ELSEWHERE_DB_MIN: f64 = 60.0;
/// Kept with the code: shells of four views under pressure, recorded on lavapipe.
const GOLDEN: &str = "tests/golden/replay_under_pressure.json";

/// Four views around a volume, more of which is seen than eight slots hold.
fn around(refine: Refine, delay: Option<Duration>) -> SceneData {
    let volume = bytes_volume(64, if refine == Refine::Exact { fog } else { waves });
    let overrides = Overrides { size: Some([48, 40]), step: Some(0.5), ..Overrides::default() };
    let mut data = match delay {
        None => scene(volume, Look::Corner, &overrides),
        Some(delay) => {
            let volume = Arc::into_inner(volume).expect("nobody else's");
            let slow = Faulty::new(volume, Slow(delay));
            scene(Arc::new(slow), Look::Corner, &overrides)
        }
    };
    data.scene.quality.refine = refine;
    let first = data.scene.views[0].clone();
    let eyes = [[-1.0, -0.9, 1.2], [0.2, 2.1, 0.4], [0.45, 0.1, 0.6]];
    for (name, eye) in ["b", "c", "d"].into_iter().zip(eyes) {
        let eye = DVec3::from_array(eye);
        let forward = (DVec3::splat(0.5) - eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let up = right.cross(forward);
        data.scene.views.push(View { name: name.into(), eye, forward, right, up, ..first.clone() });
    }
    data
}

fn few_slots(loaders: u32) -> Settings {
    paged(|paging| {
        paging.atlas_slots = Some(8);
        paging.staging_bricks = Some(3);
        paging.lockstep = false;
        paging.loaders = Some(loaders);
        paging.patience = Duration::from_secs(5);
    })
}

/// Every view, drawn by what `begin` made of a renderer.
fn all_views(renderer: &mut Renderer, views: usize) -> Vec<(Picture, Statistics)> {
    (0..views)
        .map(|view| renderer.draw(view, &mut |_| {}).unwrap_or_else(|why| panic!("{why}")))
        .collect()
}

fn recorded(
    device: &Device,
    data: &SceneData,
    settings: &Settings,
) -> (Recording, Vec<(Picture, Statistics)>) {
    let mut renderer = device.renderer(data, settings);
    renderer.record(data).expect("paged");
    let drawn = all_views(&mut renderer, data.scene.views.len());
    (renderer.recording().expect("recorded"), drawn)
}

fn replayed(
    device: &Device,
    data: &SceneData,
    settings: &Settings,
    recording: &Recording,
    forced: bool,
) -> (Replayed, Vec<(Picture, Statistics)>) {
    let mut renderer = device.renderer(data, settings);
    renderer.replay(recording.clone(), data, forced).unwrap_or_else(|why| panic!("{why}"));
    let drawn = all_views(&mut renderer, data.scene.views.len());
    (renderer.replayed().expect("replayed"), drawn)
}

#[test]
fn ten_replays_have_the_recorded_bytes_in_every_round() {
    let Some(device) = Device::open() else { return };
    for refine in [Refine::Substitute, Refine::Exact] {
        let data = around(refine, None);
        let (recording, drawn) = recorded(&device, &data, &few_slots(4));
        let rounds: u64 = drawn.iter().map(|(_, statistics)| statistics.rounds).sum();
        assert_eq!(recording.rounds() as u64, rounds, "{refine:?}");
        assert!(recording.bricks() > 16, "{refine:?}: nothing was given up");
        // A file says all of it.
        let recording = Recording::from_json(recording.to_json().as_bytes()).expect("its own");
        for turn in 0..10 {
            // Loaders and disk are others each time.
            let delay = (turn % 3 == 1).then_some(Duration::from_millis(2));
            let again = around(refine, delay);
            let settings = few_slots(1 + turn % 5);
            let (told, pictures) = replayed(&device, &again, &settings, &recording, false);
            let what = format!("{refine:?}, replay {turn}: {told:?}");
            assert!(!told.forced && told.left == 0, "{what}");
            assert_eq!(told.rounds, rounds, "{what}");
            let frames = if refine == Refine::Substitute { rounds } else { 0 };
            assert_eq!(told.pictures, frames + data.scene.views.len() as u64, "{what}");
            assert_eq!(told.pictures_same, told.pictures, "{what}");
            for ((again, statistics), (picture, before)) in pictures.iter().zip(&drawn) {
                assert_same(again, picture, &what);
                assert_eq!(statistics.bricks_uploaded, before.bricks_uploaded, "{what}");
            }
        }
        println!("{refine:?}: ten replays of {rounds} rounds, {} bricks", recording.bricks());
    }
    device.finish();
}

/// Two free runs go different ways: what replays give is not what happens anyway.
#[test]
fn without_a_recording_runs_go_their_own_ways() {
    let Some(device) = Device::open() else { return };
    let ways: std::collections::BTreeSet<String> = (0..6)
        .map(|turn| {
            let delay = (turn % 2 == 1).then_some(Duration::from_millis(3));
            let data = around(Refine::Substitute, delay);
            recorded(&device, &data, &few_slots(1 + turn)).0.to_json()
        })
        .collect();
    assert!(ways.len() > 1, "six free runs went the same way");
    device.finish();
}

#[test]
fn forced_arrivals_and_evictions_give_the_same_cache() {
    let Some(device) = Device::open() else { return };
    for refine in [Refine::Substitute, Refine::Exact] {
        for lockstep in [false, true] {
            let data = around(refine, None);
            let mut settings = few_slots(3);
            settings.paging.lockstep = lockstep;
            let (recording, drawn) = recorded(&device, &data, &settings);
            let (told, pictures) = replayed(&device, &data, &settings, &recording, true);
            let what = format!("{refine:?}, lockstep {lockstep}: {told:?}");
            assert!(told.forced && told.left == 0, "{what}");
            // Here rays are the same: a brick that stayed too long, or came too late, would show in a round.
            assert_eq!(told.pictures_same, told.pictures, "{what}");
            for ((again, statistics), (picture, before)) in pictures.iter().zip(&drawn) {
                assert_same(again, picture, &what);
                assert_eq!(statistics.converged, before.converged, "{what}");
            }
        }
    }
    device.finish();
}

/// As on another device: rays that differ by rounding, and more than that.
#[test]
fn where_rays_differ_the_recorded_cache_is_kept() {
    let Some(device) = Device::open() else { return };
    for refine in [Refine::Substitute, Refine::Exact] {
        let data = around(refine, None);
        let settings = few_slots(3);
        let (recording, drawn) = recorded(&device, &data, &settings);
        let mut elsewhere = around(refine, None);
        for view in &mut elsewhere.scene.views {
            view.eye += 3e-6;
        }
        // It says that it is of this scene.
        let (of_other, _) = recorded(&device, &elsewhere, &settings);
        let mut other = recording.clone();
        other.of = of_other.of;
        let (told, pictures) = replayed(&device, &elsewhere, &settings, &other, true);
        assert!(told.pictures_same < told.pictures, "rays did not differ: {told:?}");
        for ((again, statistics), (picture, _)) in pictures.iter().zip(&drawn) {
            let db = psnr_db(again, picture);
            println!("{refine:?}: {db:.1} dB, {} rays wait", statistics.rays_waiting);
            assert!(db >= ELSEWHERE_DB_MIN, "{refine:?}: {db} dB");
        }
    }
    device.finish();
}

#[test]
fn a_run_that_parts_from_its_recording_says_so() {
    let Some(device) = Device::open() else { return };
    let data = around(Refine::Exact, None);
    let settings = few_slots(2);
    let (recording, _) = recorded(&device, &data, &settings);
    let mut elsewhere = around(Refine::Exact, None);
    elsewhere.scene.views[0].eye += 0.05;
    let (of_other, _) = recorded(&device, &elsewhere, &settings);
    let mut other = recording;
    other.of = of_other.of;
    let mut renderer = device.renderer(&elsewhere, &settings);
    renderer.replay(other, &elsewhere, false).expect("it says that it is of this scene");
    let why = renderer.draw(0, &mut |_| {}).expect_err("it goes another way");
    assert_eq!(why.exit, Exit::Difference, "{why}");
    assert!(why.message.contains("another way than recorded"), "{why}");
    device.finish();
}

#[test]
fn what_a_recording_is_not_of_is_refused() {
    let Some(device) = Device::open() else { return };
    let data = around(Refine::Exact, None);
    let settings = few_slots(2);
    let (recording, _) = recorded(&device, &data, &settings);
    let refused = |data: &SceneData, settings: &Settings, part: &str| {
        let mut renderer = device.renderer(data, settings);
        let why = renderer.replay(recording.clone(), data, false).expect_err(part);
        assert_eq!(why.exit, Exit::Input, "{why}");
        assert!(why.message.contains(part), "{why}");
    };
    let mut other = settings;
    other.paging.atlas_slots = Some(9);
    refused(&data, &other, "slots of atlases [8] where [9] stands");
    let mut other = settings;
    other.paging.lockstep = true;
    refused(&data, &other, "recorded with --free-running");
    let mut other = settings;
    other.paging.staging_bricks = Some(2);
    refused(&data, &other, "bytes of a staging half");
    refused(&data, &Settings { tile: [32, 32], ..settings }, "tiles of [48, 40]");
    refused(&data, &Settings { steps_per_dispatch: 64, ..settings }, "--steps-per-dispatch");
    let mut moved = around(Refine::Exact, None);
    moved.scene.views[1].eye.x += 0.1;
    refused(&moved, &settings, "another scene");
    device.finish();
}

/// The octree chosen by the clock is chosen again.
#[test]
fn the_traversal_that_marched_marches_again() {
    let Some(device) = Device::open() else { return };
    let mut data = around(Refine::Exact, None);
    let volume = bytes_volume(64, other_hill);
    data.volumes[0] = scene(volume, Look::Corner, &Overrides::default()).volumes.remove(0);
    let mut settings = few_slots(2);
    settings.paging.atlas_slots = Some(64);
    settings.paging.traversal = Traversal::Auto;
    let mut renderer = device.renderer(&data, &settings);
    renderer.record(&data).expect("paged");
    for _ in 0..3 {
        all_views(&mut renderer, 4);
    }
    let recording = renderer.recording().expect("recorded");
    let text = recording.to_json();
    assert!(text.contains("[true,") && text.contains("[false,"), "one traversal alone marched");
    let mut renderer = device.renderer(&data, &settings);
    renderer.replay(recording, &data, false).expect("the same");
    for _ in 0..3 {
        all_views(&mut renderer, 4);
    }
    let told = renderer.replayed().expect("replayed");
    assert_eq!((told.left, told.pictures_same), (0, 12), "{told:?}");
    device.finish();
}

/// Whatever is wrong with a file, there is a sentence, and an end.
#[test]
fn damaged_recordings_end_in_a_sentence() {
    let Some(device) = Device::open() else { return };
    let data = around(Refine::Substitute, None);
    let settings = few_slots(2);
    let (recording, _) = recorded(&device, &data, &settings);
    let whole: serde_json::Value = serde_json::from_str(&recording.to_json()).expect("JSON");
    let count = whole["events"].as_array().expect("events").len();
    let mut refused = 0;
    for turn in 0..48 {
        let at = turn * count / 48;
        let mut value = whole.clone();
        let events = value["events"].as_array_mut().expect("events");
        match turn % 4 {
            0 => _ = events.remove(at),
            1 => events.swap(at, (at + 1) % count),
            2 => events.truncate(at),
            _ => {
                let mut text = events[at].to_string();
                text = text.replace('1', "901").replace(":[0,", ":[7,");
                events[at] = serde_json::from_str(&text).unwrap_or(serde_json::Value::Null);
            }
        }
        let bytes = value.to_string();
        let Ok(damaged) = Recording::from_json(bytes.as_bytes()) else {
            refused += 1;
            continue;
        };
        for forced in [false, true] {
            let mut renderer = device.renderer(&data, &settings);
            renderer.replay(damaged.clone(), &data, forced).expect("of this scene");
            let ended = (0..4).try_for_each(|view| renderer.draw(view, &mut |_| {}).map(|_| ()));
            let told = renderer.replayed().expect("replayed");
            let same = ended.is_ok() && told.left == 0 && told.pictures_same == told.pictures;
            refused += usize::from(!same);
        }
    }
    assert!(refused > 48, "{refused} of damaged recordings were noticed");
    for bytes in [&b""[..], b"{}", b"[1]", b"{\"format\":2}", b"\xff"] {
        let why = Recording::from_json(bytes).expect_err("no recording");
        assert_eq!(why.exit, Exit::Input, "{why}");
    }
    device.finish();
}

/// Streaming under pressure, as it went when this was recorded: on the same driver byte for byte, on another
/// one with its arrivals and evictions. `ASHFALL_GOLDEN=1` records it anew.
#[test]
fn the_golden_run_goes_as_it_went() {
    let Some(device) = Device::open() else { return };
    let data = around(Refine::Substitute, None);
    let settings = few_slots(2);
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join(GOLDEN);
    if std::env::var_os("ASHFALL_GOLDEN").is_some() {
        let (recording, _) = recorded(&device, &data, &settings);
        std::fs::write(&path, recording.to_json()).expect("written");
    }
    let golden = Recording::from_json(&std::fs::read(&path).expect("kept with the code"))
        .unwrap_or_else(|why| panic!("{why}"));
    let (told, pictures) = replayed(&device, &data, &settings, &golden, false);
    println!("{GOLDEN}: {told:?}");
    assert_eq!(told.left, 0, "{told:?}");
    assert!(told.forced || told.pictures_same == told.pictures, "{told:?}");
    for (picture, statistics) in &pictures {
        assert!(covered(picture) > 300, "something is seen: {statistics:?}");
    }
    device.finish();
}
