//! Rounds with a target, and submits with a bound: the finished picture has the same bytes, and both are heeded.

use std::ops::ControlFlow;

use ashfall::error::Exit;
use ashfall::render::paging::{LADDER, Rung, Traversal};
use ashfall::render::{Addressing, SceneData, Settings};
use ashfall::scene::{Overrides, Refine};

use crate::common::drawing::Device;
use crate::worlds::{Look, assert_same, bytes_volume, finished, paged, scene, waves};

/// More bricks than a round of a few may bring.
fn many_bricks() -> SceneData {
    let overrides = Overrides { size: Some([48, 40]), step: Some(0.5), ..Overrides::default() };
    let mut data = scene(bytes_volume(96, waves), Look::Corner, &overrides);
    data.scene.quality.refine = Refine::Substitute;
    data
}

fn free_running(frame_us: Option<u32>) -> Settings {
    paged(|paging| {
        paging.lockstep = false;
        paging.frame_us = frame_us;
    })
}

#[test]
fn uploads_follow_the_target_and_the_picture_does_not() {
    let Some(device) = Device::open() else { return };
    let data = many_bricks();
    let want = finished(&device, &data, &free_running(None));
    assert_eq!(want.statistics.paced, None, "nobody asked for a target");
    for (frame_us, few) in [(1, true), (60_000_000, false)] {
        let mut renderer = device.renderer(&data, &free_running(Some(frame_us)));
        let mut before = 0;
        let mut told = Vec::new();
        let drawn = renderer.draw_watched(0, &mut |round| {
            let pace = round.pace.expect("a target");
            told.push((round.bricks_uploaded - before, pace));
            before = round.bricks_uploaded;
            ControlFlow::Continue(())
        });
        let (picture, statistics) = drawn.expect("drawn").expect("whole");
        let what = format!("{frame_us} us: {statistics:?}");
        assert_same(&picture, &want.picture, &what);
        let paced = statistics.paced.as_ref().expect("a target");
        assert_eq!(paced.target_ms, f64::from(frame_us) / 1e3, "{what}");
        assert_eq!(paced.rounds, statistics.rounds, "{what}");
        assert_eq!(paced.over_target, if few { paced.rounds } else { 0 }, "{what}");
        assert!(paced.p95_ms <= paced.p99_ms && paced.p99_ms <= paced.worst_ms, "{what}");
        // No round brought more than the one before it allowed; the first, than a first one may.
        let allowed = told.iter().map(|(_, pace)| u64::from(pace.paced.uploads_max[1]));
        for (round, ((came, _), most)) in told.iter().zip(allowed).enumerate() {
            assert!(*came <= most, "{what}: {came} bricks in round {round}, {most} allowed");
        }
        let rung = told.last().expect("rounds").1.rung;
        let expected = if few { LADDER[LADDER.len() - 1] } else { Rung::FINEST };
        assert_eq!(rung, expected, "{what}");
    }
    device.finish();
}

#[test]
fn a_run_with_a_target_is_not_recorded() {
    let Some(device) = Device::open() else { return };
    let data = many_bricks();
    let mut renderer = device.renderer(&data, &free_running(Some(50_000)));
    let why = renderer.record(&data).expect_err("it goes by the clock");
    assert_eq!(why.exit, Exit::Arguments, "{why}");
    let direct = Settings { addressing: Addressing::Direct, ..Settings::default() };
    let whole = crate::worlds::scene_of_whole(
        &bytes_volume(32, waves),
        Look::Corner,
        &Overrides::default(),
    );
    let why = device.renderer(&whole, &direct).record(&whole).expect_err("nothing is paged");
    assert_eq!(why.exit, Exit::Arguments, "{why}");
    device.finish();
}

/// As on a device so slow that nothing fits a submit.
#[test]
fn bounded_submits_draw_the_same_bytes() {
    let Some(device) = Device::open() else { return };
    let overrides = Overrides { size: Some([64, 64]), step: Some(0.01), ..Overrides::default() };
    let volume = bytes_volume(64, waves);
    let whole = crate::worlds::scene_of_whole(&volume, Look::Corner, &overrides);
    for addressing in [Addressing::Direct, Addressing::Paged] {
        for traversal in [Traversal::PageTable, Traversal::ResidencyOctree] {
            let draw = |submit_ms: Option<u32>| {
                let mut settings = free_running(None);
                settings.paging.traversal = traversal;
                settings.paging.lockstep = true;
                settings.paging.keep_records = true;
                let drawn =
                    device.draw_with(&whole, 0, &Settings { addressing, submit_ms, ..settings });
                let marches = drawn.records.iter().map(|record| {
                    record.steps.iter().filter(|step| step.label.starts_with("march")).count()
                });
                let marches: Vec<usize> = marches.filter(|count| *count > 0).collect();
                (drawn, marches)
            };
            let (free, before) = draw(Some(0));
            let (bounded, after) = draw(Some(1));
            let what = format!("{addressing:?}, {traversal:?}: {before:?}, {after:?}");
            assert_same(&bounded.picture, &free.picture, &what);
            assert!(after.len() > 2 * before.len(), "{what}");
            assert!(after[after.len() / 2..].iter().all(|count| *count == 1), "{what}");
            assert_eq!(free.statistics.samples, bounded.statistics.samples, "{what}");
        }
    }
    device.finish();
}
