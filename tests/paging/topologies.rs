//! Queues, staging halves and hand-overs as settings: the same bytes, and no fault in the simulation of two queues.

use ashfall::error::Exit;
use ashfall::gpu::two_queues::{Fault, check};
use ashfall::gpu::{
    DeviceRequest, Gpu, Instance, QueueTopology, Record, RoleKind, StepKind, Validation,
};
use ashfall::render::Settings;
use ashfall::render::paging::CopyPath;

use crate::common::drawing::{Device, Drawn};
use crate::two_queues::{all_found, planted, said};
use crate::worlds::{Look, assert_same, at_level_0, bytes_volume, finished, hill, paged, scene};

fn settings(path: CopyPath, lockstep: bool, hands_over: bool) -> Settings {
    paged(|paging| {
        paging.atlas_slots = Some(8);
        paging.staging_bricks = Some(1);
        paging.copy_path = Some(path);
        paging.lockstep = lockstep;
        paging.hands_over = hands_over;
        paging.keep_records = true;
    })
}

fn drawn(device: &Device, settings: &Settings) -> Drawn {
    let data = scene(bytes_volume(64, hill), Look::Corner, &at_level_0());
    let plan = device.plan(&data, settings);
    let halves = plan.buffers.iter().filter(|of| of.name.starts_with("staging_half_")).count();
    assert_eq!(halves as u64, device.gpu.staging_halves());
    finished(device, &data, settings)
}

#[test]
fn every_setting_gives_the_same_bytes_without_a_fault() {
    let mut first: Option<Drawn> = None;
    for three_halves in [false, true] {
        let request = DeviceRequest { three_halves, ..DeviceRequest::default() };
        let Some(device) = Device::open_as(request) else { return };
        for lockstep in [true, false] {
            for (path, hands_over) in
                [(CopyPath::Straight, false), (CopyPath::Placed, false), (CopyPath::Placed, true)]
            {
                let drawn = drawn(&device, &settings(path, lockstep, hands_over));
                let what = format!(
                    "three halves {three_halves}, lockstep {lockstep}, {path:?}, handed over {hands_over}"
                );
                let faults = check(&drawn.records);
                assert!(faults.is_empty(), "{what}: {:#?}", said(&faults));
                let copies = labelled(&drawn.records, "copy");
                let [releases, acquires] =
                    ["release", "acquire"].map(|label| labelled(&drawn.records, label));
                let expected = if hands_over { copies } else { 0 };
                assert_eq!([releases, acquires], [expected; 2], "{what}");
                let same = first.get_or_insert_with(|| Drawn {
                    picture: drawn.picture.clone(),
                    statistics: drawn.statistics.clone(),
                    records: Vec::new(),
                });
                assert_same(&drawn.picture, &same.picture, &what);
            }
        }
        device.finish();
    }
}

fn labelled(records: &[Record], label: &str) -> usize {
    let steps = records.iter().flat_map(|record| &record.steps);
    steps.filter(|step| step.label == label).count()
}

/// With three halves the host waits less for a half that a copy still reads.
#[test]
fn halves_are_filled_in_turns() {
    let request = DeviceRequest { three_halves: true, ..DeviceRequest::default() };
    let Some(device) = Device::open_as(request) else { return };
    let drawn = drawn(&device, &settings(CopyPath::Straight, false, false));
    let copies =
        drawn.records.iter().filter(|record| labelled(std::slice::from_ref(record), "copy") > 0);
    let read = |record: &Record| record.steps[0].accesses[0].0;
    let halves: Vec<&str> = copies.map(read).collect();
    assert!(halves.len() > 6, "{halves:?}");
    // The usage order went first, through the first half.
    for (at, half) in halves.iter().enumerate() {
        assert_eq!(
            *half,
            ["staging_half_1", "staging_half_2", "staging_half_0"][at % 3],
            "{halves:?}"
        );
    }
    device.finish();
}

#[test]
fn faults_planted_in_hand_overs_are_found() {
    let Some(device) = Device::open() else { return };
    let drawn = drawn(&device, &settings(CopyPath::Placed, true, true));
    let records = &drawn.records;
    assert!(check(records).is_empty());
    let without = |label: &'static str| {
        move |records: &mut Vec<Record>, at: usize| {
            let steps = &mut records[at].steps;
            let before = steps.len();
            steps.retain(|step| step.label != label);
            steps.len() < before
        }
    };
    let unreleased =
        |fault: &Fault| matches!(fault, Fault::AcquiredUnreleased { resource: "upload", .. });
    let unowned = |fault: &Fault| matches!(fault, Fault::UsedUnowned { resource: "upload", .. });
    all_found("no release", planted(records, without("release"), unreleased));
    all_found("no acquire", planted(records, without("acquire"), unowned));
    // Acquired without waiting for the release.
    let early = |records: &mut Vec<Record>, at: usize| {
        let acquires = records[at].steps.iter().any(|step| step.label == "acquire");
        records[at].waits.retain(|point| point.role != RoleKind::Transfer);
        acquires
    };
    all_found("acquired early", planted(records, early, unreleased));
    // Released to the role that has it already.
    let wrong = |records: &mut Vec<Record>, at: usize| {
        let mut steps = records[at].steps.iter_mut();
        let release = steps.find_map(|step| match &mut step.kind {
            StepKind::Release { to, .. } => Some(to),
            _ => None,
        });
        release.map(|to| *to = RoleKind::Transfer).is_some()
    };
    all_found("released to the wrong role", planted(records, wrong, unreleased));
    device.finish();
}

#[test]
fn what_a_device_does_not_offer_is_refused_in_a_sentence() {
    let Some(device) = Device::open() else { return };
    let facts = device.gpu.facts().clone();
    let offered = QueueTopology::offered(&facts.queues);
    let instance = Instance::new(Validation::On).expect("as before");
    for queues in QueueTopology::ALL {
        let choice = Some(facts.index.to_string());
        let request = DeviceRequest { choice, queues, ..DeviceRequest::default() };
        match Gpu::open(&instance, &request) {
            Ok(gpu) => {
                assert!(offered.contains(&queues), "{queues:?}");
                assert_eq!(gpu.topology(), queues);
            }
            Err(why) => {
                assert!(!offered.contains(&queues), "{queues:?}: {why}");
                assert_eq!(why.exit, Exit::Machine);
                let [lacks, name] = [queues.lacks(&facts.queues).expect("why"), queues.name()];
                assert!(why.message.contains(lacks) && why.message.contains(name), "{why}");
                assert!(why.message.contains("it offers one-queue"), "{why}");
            }
        }
    }
    // A hand-over needs an upload buffer.
    let data = scene(bytes_volume(64, hill), Look::Corner, &at_level_0());
    let straight = settings(CopyPath::Straight, true, true).checked().expect("in range");
    let refused = ashfall::render::Plan::new(&device.gpu, &device.compiler, &data, &straight);
    let why = refused.map(|_| ()).expect_err("no upload buffer");
    assert!(why.exit == Exit::Arguments && why.message.contains("--copy-path straight"), "{why}");
    device.finish();
}
