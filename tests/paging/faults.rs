//! Sources that misbehave: the loop ends, says what is missing, and shows where.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ashfall::error::{Error, Result};
use ashfall::import::DenseVolume;
use ashfall::render::paging::PagingSettings;
use ashfall::render::{SceneData, Settings};
use ashfall::source::faulty::{Corrupt, Failing, Fault, Faulty, Short, Slow};
use ashfall::source::{BrickEntry, BrickSource, Description};
use ashfall::volume::BrickId;

use crate::common::drawing::{Device, Drawn};
use crate::worlds::{
    Look, assert_same, at_level_0, bytes_volume, covered, finished, fog, hill, paged, scene, slots,
};

/// A volume that a faulty source wraps and a test keeps.
pub struct Dense(pub Arc<DenseVolume>);

impl BrickSource for Dense {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.0.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.0.read(id, bytes)
    }
}

/// A hill of 64 voxels an edge, its reads spoilt by `fault`.
pub fn faulty<F: Fault + 'static>(fault: F) -> Arc<Faulty<Dense, F>> {
    Arc::new(Faulty::new(Dense(bytes_volume(64, hill)), fault))
}

pub fn outside(source: Arc<dyn BrickSource>) -> SceneData {
    scene(source, Look::Corner, &at_level_0())
}

fn undisturbed(device: &Device) -> Drawn {
    finished(device, &outside(bytes_volume(64, hill)), &slots(16))
}

/// In lockstep and running free, through a small atlas.
fn both_ways() -> [Settings; 2] {
    let change = |lockstep| {
        move |paging: &mut PagingSettings| {
            paging.atlas_slots = Some(16);
            paging.lockstep = lockstep;
        }
    };
    [paged(change(true)), paged(change(false))]
}

#[test]
fn slow_and_now_and_then_failing_reads_change_nothing() {
    let Some(device) = Device::open() else { return };
    let wanted = undisturbed(&device);
    for settings in both_ways() {
        let slow = outside(faulty(Slow(Duration::from_millis(3))));
        assert_same(&finished(&device, &slow, &settings).picture, &wanted.picture, "slow");
        let drawn = finished(&device, &outside(faulty(Failing(4))), &settings);
        assert_same(&drawn.picture, &wanted.picture, "every fourth read fails");
        let loading = drawn.statistics.loading.expect("bricks were loaded");
        assert!(loading.retries > 0, "{loading:?}");
    }
    device.finish();
}

/// Every brick that travels has failed; the rest is drawn, and the loop has ended.
fn all_fail<F: Fault + 'static>(device: &Device, what: &str, says: &str, fault: impl Fn() -> F) {
    for settings in both_ways() {
        let drawn = device.draw_with(&outside(faulty(fault())), 0, &settings);
        let statistics = &drawn.statistics;
        assert!(statistics.converged, "{what}: no ray waits for what failed: {statistics:?}");
        assert!(statistics.bricks_failed > 0, "{what}: {statistics:?}");
        assert_eq!(statistics.bricks_uploaded, 0, "{what}: {statistics:?}");
        assert_eq!(covered(&drawn.picture), 0, "{what}: nothing is made up");
        let why = statistics.first_failure.as_deref().unwrap_or_default();
        assert!(why.contains(says), "{what}: {why}");
    }
}

#[test]
fn bricks_that_never_come_right_are_failed_and_drawn_as_nothing() {
    let Some(device) = Device::open() else { return };
    all_fail(&device, "failing", "a test made it fail", || Failing(1));
    all_fail(&device, "short", "bytes where", || Short(5));
    device.finish();
}

#[test]
fn corrupt_bricks_are_found_as_far_as_their_range_tells() {
    let Some(device) = Device::open() else { return };
    let wanted = undisturbed(&device);
    let source = faulty(Corrupt);
    let drawn = device.draw_with(&outside(source.clone()), 0, &slots(16));
    let statistics = &drawn.statistics;
    let loading = statistics.loading.expect("bricks were loaded");
    println!(
        "corrupt: {} reads, {} retries, {} failed",
        source.reads(),
        loading.retries,
        loading.failed
    );
    assert!(statistics.converged, "{statistics:?}");
    // Outside of its range: read again. Within: shown, since nothing says that it is wrong.
    assert!(loading.retries + loading.failed > 0, "{loading:?}");
    // One of them was tried again at the end, whether the source had recovered.
    assert!(loading.failed > statistics.bricks_failed, "{loading:?}");
    assert!(statistics.bricks_failed > 0, "{statistics:?}");
    assert!(drawn.picture != wanted.picture, "one voxel of every brick is another");
    device.finish();
}

/// One brick fails always.
struct One(BrickId);

impl Fault for One {
    fn before(&self, _: u64, id: BrickId) -> Result<()> {
        match id == self.0 {
            true => Err(Error::input(format!("{id} is lost"))),
            false => Ok(()),
        }
    }
}

#[test]
fn a_failed_brick_is_tinted_where_rays_meet_it_and_nowhere_else() {
    let Some(device) = Device::open() else { return };
    let lost = BrickId { volume: 0, channel: 0, level: 0, x: 1, y: 2, z: 2 };
    for look in [Look::Parallel, Look::Corner] {
        let of = |fault| scene(faulty(fault), look, &at_level_0());
        let data = of(One(lost));
        let plain = device.draw_with(&data, 0, &slots(16));
        assert_eq!(plain.statistics.bricks_failed, 1);
        assert_eq!(plain.statistics.bricks_absent, 0);
        assert!(plain.statistics.first_failure.as_deref().is_some_and(|why| why.contains("lost")));
        let show = |paging: &mut PagingSettings| {
            paging.atlas_slots = Some(16);
            paging.show_states = true;
        };
        let shown = device.draw_with(&data, 0, &paged(show));
        // Nothing is tinted where nothing failed.
        let whole_data = outside_of(look);
        let whole = finished(&device, &whole_data, &slots(16));
        let untinted = finished(&device, &whole_data, &paged(show));
        assert_same(&untinted.picture, &whole.picture, "nothing to tint");
        let tinted = |at: usize| shown.picture.pixels[at] != plain.picture.pixels[at];
        let count = (0..plain.picture.pixels.len()).filter(|at| tinted(*at)).count();
        assert!(count > 30, "{look:?}: {count} pixels are tinted");
        for at in 0..plain.picture.pixels.len() {
            // What lacks the brick is tinted: where the picture differs, a ray met it.
            if plain.picture.pixels[at] != whole.picture.pixels[at] {
                assert!(tinted(at), "{look:?}: pixel {at} lacks the brick and is not tinted");
            }
            if look == Look::Parallel && tinted(at) {
                assert!(sees(at, lost), "pixel {at} does not see the brick");
            }
        }
    }
    device.finish();
}

fn outside_of(look: Look) -> SceneData {
    scene(bytes_volume(64, hill), look, &at_level_0())
}

/// Whether a pixel of the parallel look, 1.1 high from (0.5, 0.5), may see a brick of 16 of 64 voxels.
/// Its cells reach from half a voxel within to half a voxel beyond; x runs left there.
fn sees(pixel: usize, brick: BrickId) -> bool {
    let unit = |at: usize| (at as f64 + 0.5) / 64.0 * 1.1 - 0.05;
    let (across, down) = (unit(pixel % 64), unit(pixel / 64));
    let within = |at: f64, brick: u32| {
        let voxel = at * 64.0;
        let first = f64::from(brick * 16);
        voxel > first - 1.0 && voxel < first + 17.0
    };
    // Up is y, and row 0 is on top.
    let columns = [across, 1.0 - across];
    columns.iter().any(|x| within(*x, brick.x)) && within(1.0 - down, brick.y)
}

#[test]
fn a_request_for_every_brick_at_once_is_bounded() {
    let Some(device) = Device::open() else { return };
    // 1024 bricks in front, 8 slots: 16 requests a round.
    let dense = bytes_volume(128, fog);
    let begun = Instant::now();
    let data = scene(dense, Look::Parallel, &at_level_0());
    let drawn = finished(&device, &data, &slots(8));
    let statistics = &drawn.statistics;
    let whole = finished(&device, &data, &paged(|_| {}));
    assert_same(&drawn.picture, &whole.picture, "8 slots");
    println!(
        "every brick at once: {} needed, {} loaded, {} rounds, {:?}",
        statistics.bricks_needed,
        statistics.bricks_uploaded,
        statistics.rounds,
        begun.elapsed()
    );
    assert!(statistics.bricks_needed >= 64, "the front is all asked for in the first round");
    assert!(statistics.rounds > 64 / 16, "a round loads no more than it may");
    device.finish();
}
