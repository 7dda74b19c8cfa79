//! The papers' order, by how many rays ask: what it costs, and that where it stands still the loop says
//! so and ends.

use std::time::{Duration, Instant};

use ashfall::render::paging::LoadOrder;
use ashfall::render::{Settings, Unfinished};
use ashfall::volume::VoxelFormat;

use crate::common::drawing::Device;
use crate::worlds::{
    Look, at_level_0, bricks, bytes_volume, channel, finished, fog, hill, other_hill, paged, scene,
    slots, volume, waves,
};

/// Far more than any end takes.
const LONG: Duration = Duration::from_secs(120);

fn papers(count: u32) -> Settings {
    paged(|paging| {
        paging.atlas_slots = Some(count);
        paging.order = LoadOrder::Papers;
    })
}

#[test]
fn it_stands_still_for_several_channels_and_says_so() {
    let Some(device) = Device::open() else { return };
    let size = [96; 3];
    let of = |field| channel(size, VoxelFormat::U8, field);
    let dense = bricks(volume(size, vec![of(fog), of(waves), of(hill), of(other_hill)]), 16);
    let data = scene(dense, Look::Corner, &at_level_0());
    let begun = Instant::now();
    let statistics = device.draw_with(&data, 0, &papers(8)).statistics;
    println!(
        "papers, four channels, 8 slots: {} rounds, {} loaded, {:?}, {} rays wait",
        statistics.rounds,
        statistics.bricks_uploaded,
        statistics.unfinished,
        statistics.rays_waiting
    );
    assert!(!statistics.converged);
    assert!(statistics.rays_waiting > 0);
    assert!(
        matches!(
            statistics.unfinished,
            Some(Unfinished::Restless { .. } | Unfinished::Full { .. })
        ),
        "{:?}",
        statistics.unfinished
    );
    assert!(begun.elapsed() < LONG, "{:?}", begun.elapsed());
    finished(&device, &data, &slots(8));
    device.finish();
}

#[test]
fn it_loads_more_for_one_channel() {
    let Some(device) = Device::open() else { return };
    let data = scene(bytes_volume(128, fog), Look::Corner, &at_level_0());
    for count in [8, 64] {
        let statistics = device.draw_with(&data, 0, &papers(count)).statistics;
        let ours = finished(&device, &data, &slots(count)).statistics;
        let factor =
            |s: &ashfall::render::Statistics| s.bricks_uploaded as f64 / s.bricks_needed as f64;
        println!(
            "one channel, {count} slots: papers {:.3} in {} rounds, {:?}; ours {:.3} in {}",
            factor(&statistics),
            statistics.rounds,
            statistics.unfinished,
            factor(&ours),
            ours.rounds
        );
        assert!(factor(&statistics) > factor(&ours), "{count} slots");
    }
    device.finish();
}
