//! Substitute refinement: coarse first, the exact picture at the end, honest where there is no room.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ashfall::error::{Error, Result};
use ashfall::import::DenseVolume;
use ashfall::render::paging::PagingSettings;
use ashfall::render::{Renderer, SceneData, Settings, Unfinished};
use ashfall::scene::{Overrides, Projection, Refine, View};
use ashfall::source::faulty::{Fault, Faulty, Slow};
use ashfall::volume::BrickId;
use glam::DVec3;

use crate::common::drawing::Device;
use crate::faults::{Dense, faulty};
use crate::worlds::{
    Look, assert_same, at_level_0, bytes_volume, covered, finished, fog, hill, paged, psnr_db,
    scene, slots,
};

/// Lets so many reads through, and keeps the names of all.
struct Only {
    reads: u64,
    asked: Mutex<Vec<BrickId>>,
}

impl Fault for Only {
    fn before(&self, read: u64, id: BrickId) -> Result<()> {
        self.asked.lock().expect("no test panics with the lock").push(id);
        if read < self.reads {
            return Ok(());
        }
        Err(Error::input(format!("{id}: no read is left")))
    }
}

fn limited(reads: u64) -> Arc<Faulty<Dense, Only>> {
    let fault = Only { reads, asked: Mutex::default() };
    Arc::new(Faulty::new(Dense(bytes_volume(128, fog)), fault))
}

fn refined(mut data: SceneData) -> SceneData {
    data.scene.quality.refine = Refine::Substitute;
    data
}

fn outside() -> Overrides {
    at_level_0()
}

#[test]
fn it_ends_with_the_exact_bytes_when_all_fits() {
    let Some(device) = Device::open() else { return };
    for (what, field, look, overrides) in [
        ("hill, outside", hill as fn(_) -> _, Look::Corner, outside()),
        ("fog, outside", fog, Look::Corner, outside()),
        ("fog, inside", fog, Look::Inside, Overrides { level_max: None, ..outside() }),
    ] {
        let dense: Arc<DenseVolume> = bytes_volume(96, field);
        let exact = finished(&device, &scene(dense.clone(), look, &overrides), &slots(16));
        let data = refined(scene(dense, look, &overrides));
        let free = |paging: &mut PagingSettings| paging.lockstep = false;
        for settings in [paged(|_| {}), paged(free), Settings { tile: [40, 24], ..paged(|_| {}) }] {
            let drawn = finished(&device, &data, &settings);
            assert_same(&drawn.picture, &exact.picture, &format!("{what}, {settings:?}"));
        }
    }
    device.finish();
}

/// A ray that took a coarser brick counts as waiting, whichever of the round's dispatches it ended in:
/// what is on its way is asked for no more, and nothing else would keep the loop from ending.
#[test]
fn it_does_not_end_before_what_is_on_its_way_has_come() {
    let Some(device) = Device::open() else { return };
    let source = || faulty(Slow(Duration::from_millis(3)));
    let exact = finished(&device, &scene(source(), Look::Corner, &outside()), &slots(64));
    let data = refined(scene(source(), Look::Corner, &outside()));
    let settings = Settings { steps_per_dispatch: 32, ..paged(|paging| paging.lockstep = false) };
    let plan = device.plan(&data, &settings);
    let march = plan.passes.iter().find(|pass| pass.name == "march_bricks").expect("it marches");
    assert!(march.dispatches_per_tile > 2, "rays end in several dispatches");
    for _ in 0..3 {
        let drawn = finished(&device, &data, &settings);
        assert_same(&drawn.picture, &exact.picture, "running free");
    }
    device.finish();
}

#[test]
fn it_says_when_the_atlas_is_full() {
    let Some(device) = Device::open() else { return };
    let dense = bytes_volume(128, fog);
    let exact = finished(&device, &scene(dense.clone(), Look::Corner, &outside()), &slots(64));
    let data = refined(scene(dense, Look::Corner, &outside()));
    let mut before = 0.0;
    for count in [16, 64] {
        let drawn = device.draw_with(&data, 0, &slots(count));
        let statistics = &drawn.statistics;
        let db = psnr_db(&drawn.picture, &exact.picture);
        println!("{count} slots: {db:.1} dB after {} rounds", statistics.rounds);
        assert_eq!(statistics.unfinished, Some(Unfinished::Full { slots: count.into() }));
        assert!(!statistics.converged);
        assert!(covered(&drawn.picture) >= covered(&exact.picture) * 9 / 10, "a whole picture");
        assert!(db > before, "{count} slots: {db:.1} dB, before {before:.1}");
        before = db;
    }
    device.finish();
}

#[test]
fn every_round_leaves_a_whole_picture_and_the_floor_comes_first() {
    let Some(device) = Device::open() else { return };
    let dense = bytes_volume(128, fog);
    let exact = finished(&device, &scene(dense, Look::Corner, &outside()), &slots(64));
    let mut before = 0.0;
    // However early the source ends, what came is a picture, and a better one the more came.
    for reads in [100, 200, 1000] {
        let source = limited(reads);
        let data = refined(scene(source.clone(), Look::Corner, &outside()));
        let settings = paged(|paging| {
            paging.loaders = Some(1);
            paging.staging_bricks = Some(4);
            paging.patience = Duration::from_secs(60);
        });
        let mut renderer: Renderer = device.renderer(&data, &settings);
        let (picture, statistics) =
            renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        let db = psnr_db(&picture, &exact.picture);
        println!("{reads} reads: {db:.1} dB, {} failed", statistics.bricks_failed);
        assert!(covered(&picture) >= covered(&exact.picture) * 9 / 10, "{reads}: a whole picture");
        assert!(db > before, "{reads} reads: {db:.1} dB, before {before:.1}");
        before = db;
        let asked = source.fault.asked.lock().expect("no test panics with the lock").clone();
        let coarsest = asked.iter().map(|id| id.level).max().expect("something is asked for");
        let first_fine = asked.iter().position(|id| id.level == 0).expect("level 0 is wanted");
        assert!(coarsest > 0, "a floor is held");
        assert!(
            asked[..first_fine].iter().any(|id| id.level == coarsest)
                && asked[first_fine..].iter().all(|id| id.level != coarsest),
            "the coarsest level comes before any of the finest: {asked:?}"
        );
    }
    device.finish();
}

/// Along z through a quarter of the volume.
fn through(name: &str, quarter: [f64; 2]) -> View {
    let [x, y] = quarter;
    let at = |z| DVec3::new(x, y, z);
    let projection = Projection::Orthographic { height: 0.4 };
    View::looking_at(name.to_owned(), at(-2.0), at(0.5), DVec3::Y, projection).expect("a good view")
}

/// What one view does not look at is there when the next one does, if only coarsely: the first of its
/// rounds leaves a whole picture already, though the view before could have used every slot.
#[test]
fn the_floor_outlasts_views_that_do_not_use_it() {
    let Some(device) = Device::open() else { return };
    let dense = bytes_volume(128, fog);
    let views = vec![through("near", [0.25, 0.25]), through("far", [0.75, 0.75])];
    let mut whole = scene(dense.clone(), Look::Corner, &outside());
    whole.scene.views.clone_from(&views);
    let exact = device.draw_with(&whole, 1, &paged(|_| {}));
    let mut data = refined(scene(dense, Look::Corner, &outside()));
    data.scene.views = views;
    for lockstep in [true, false] {
        let settings = paged(|paging| {
            paging.atlas_slots = Some(80);
            paging.lockstep = lockstep;
        });
        let mut renderer = device.renderer(&data, &settings);
        let (_, statistics) = renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        let full = Some(Unfinished::Full { slots: 80 });
        assert_eq!(statistics.unfinished, full, "the first view takes what it gets");
        let by_level = statistics.bricks_uploaded_by_level;
        assert_eq!(by_level[2..], [8, 1], "the floor was there");
        let mut first = None;
        let watched = renderer.draw_watched(1, &mut |round| {
            first.get_or_insert(round.picture);
            ControlFlow::Continue(())
        });
        watched.unwrap_or_else(|why| panic!("{why}"));
        let first = first.expect("a round");
        let db = psnr_db(&first, &exact.picture);
        println!("lockstep {lockstep}: {db:.1} dB after the first round");
        assert_eq!(covered(&first), covered(&exact.picture), "a whole picture");
        assert!(db > 25.0, "lockstep {lockstep}: {db:.1} dB");
    }
    device.finish();
}
