//! Real drawings through the simulation of two queues: no fault in them, and every planted one is found.

use ashfall::gpu::two_queues::{Fault, check};
use ashfall::gpu::{HostEvent, Record, RoleKind, SlotEvent, TimePoint};
use ashfall::render::paging::CopyPath;
use ashfall::scene::Overrides;
use ashfall::volume::VoxelFormat;

use crate::common::drawing::{Device, Drawn};
use crate::worlds::{
    Look, at_level_0, bricks, bytes_volume, channel, finished, hill, other_hill, paged, scene,
    volume,
};

/// Everything that is submitted for a small picture, in one of the ways.
fn recorded(
    device: &Device,
    slots: u32,
    path: CopyPath,
    lockstep: bool,
    staging: Option<u32>,
) -> Drawn {
    let data = scene(bytes_volume(64, hill), Look::Corner, &at_level_0());
    let settings = paged(|paging| {
        paging.atlas_slots = Some(slots);
        paging.copy_path = Some(path);
        paging.lockstep = lockstep;
        paging.staging_bricks = staging;
        paging.keep_records = true;
    });
    finished(device, &data, &settings)
}

fn slot_events(records: &[Record], kind: SlotEvent) -> usize {
    let steps = records.iter().flat_map(|record| &record.steps);
    steps.flat_map(|step| &step.slots).filter(|(event, _)| *event == kind).count()
}

#[test]
fn real_drawings_have_no_fault() {
    let Some(device) = Device::open() else { return };
    for path in [CopyPath::Straight, CopyPath::Placed] {
        for lockstep in [true, false] {
            for (slots, staging) in [(8, Some(1)), (8, None), (64, Some(1)), (64, None)] {
                let drawn = recorded(&device, slots, path, lockstep, staging);
                let what = format!("{path:?}, lockstep {lockstep}, {slots} slots, {staging:?}");
                let faults = check(&drawn.records);
                assert!(faults.is_empty(), "{what}: {:#?}", said(&faults));
                // What is checked is there: every brick was granted, written and published.
                let uploaded = drawn.statistics.bricks_uploaded as usize;
                let written = match path {
                    CopyPath::Straight => SlotEvent::CopiedInto,
                    CopyPath::Placed => SlotEvent::Placed,
                };
                let counts = [written, SlotEvent::Published, SlotEvent::Granted]
                    .map(|kind| slot_events(&drawn.records, kind));
                assert_eq!(counts[..2], [uploaded; 2], "{what}");
                assert!(counts[2] >= uploaded, "{what}: {counts:?}");
                assert!(slot_events(&drawn.records, SlotEvent::MayRead) > uploaded, "{what}");
            }
        }
    }
    device.finish();
}

/// Placements are written beside those that the device has not read yet: the host waits for no batch
/// but those that it has long known to be placed.
#[test]
fn placing_keeps_no_host_waiting() {
    let Some(device) = Device::open() else { return };
    let mut reused = 0;
    for lockstep in [true, false] {
        for (slots, staging) in [(8, Some(1)), (8, None), (64, Some(1)), (64, None)] {
            let drawn = recorded(&device, slots, CopyPath::Placed, lockstep, staging);
            let what = format!("lockstep {lockstep}, {slots} slots, {staging:?}");
            let mut known = 0;
            for record in &drawn.records {
                let places = record.steps.iter().any(|step| step.label == "place");
                for event in &record.host {
                    let HostEvent::Waited(point) = event else { continue };
                    if places {
                        assert!(point.value <= known, "{what}: {point:?}, known {known}");
                        reused += 1;
                    } else if point.role == RoleKind::Render {
                        known = known.max(point.value);
                    }
                }
            }
        }
    }
    assert!(reused > 20, "{reused} batches took the place of others");
    device.finish();
}

/// Surveys and bricks come while the device marches: what it then still asks for is on its way.
#[test]
fn running_free_no_brick_takes_two_slots() {
    let Some(device) = Device::open() else { return };
    let dense = bricks(volume([96; 3], vec![channel([96; 3], VoxelFormat::U8, hill)]), 8);
    let overrides = Overrides { size: Some([256, 256]), ..at_level_0() };
    let data = scene(dense, Look::Corner, &overrides);
    for count in [64, 256, 1024] {
        let settings = paged(|paging| {
            paging.atlas_slots = Some(count);
            paging.lockstep = false;
            paging.loaders = Some(8);
            paging.keep_records = true;
        });
        let drawn = finished(&device, &data, &settings);
        let uploaded = drawn.statistics.bricks_uploaded as usize;
        let counts = [SlotEvent::CopiedInto, SlotEvent::Published]
            .map(|kind| slot_events(&drawn.records, kind));
        println!("{count} slots: {uploaded} uploaded, {counts:?} copied and published");
        assert_eq!(counts, [uploaded; 2], "{count} slots: a copy was never published");
        let faults = check(&drawn.records);
        assert!(faults.is_empty(), "{count} slots: {:#?}", said(&faults));
    }
    device.finish();
}

#[test]
fn real_drawings_of_two_atlases_have_no_fault() {
    let Some(device) = Device::open() else { return };
    let size = [48; 3];
    let channels =
        vec![channel(size, VoxelFormat::U8, hill), channel(size, VoxelFormat::U16, other_hill)];
    let data = scene(bricks(volume(size, channels), 16), Look::Corner, &at_level_0());
    for path in [CopyPath::Straight, CopyPath::Placed] {
        for lockstep in [true, false] {
            let settings = paged(|paging| {
                paging.atlas_slots = Some(8);
                paging.copy_path = Some(path);
                paging.lockstep = lockstep;
                paging.staging_bricks = Some(2);
                paging.keep_records = true;
            });
            let faults = check(&finished(&device, &data, &settings).records);
            assert!(faults.is_empty(), "{path:?}, lockstep {lockstep}: {:#?}", said(&faults));
        }
    }
    device.finish();
}

pub fn said(faults: &[Fault]) -> Vec<String> {
    faults.iter().map(Fault::to_string).collect()
}

/// Plants a fault in a copy of the records at every place where `plant` finds one; how many there were,
/// and how many of them `check` finds as what `expected` says.
pub fn planted(
    records: &[Record],
    mut plant: impl FnMut(&mut Vec<Record>, usize) -> bool,
    expected: impl Fn(&Fault) -> bool,
) -> (usize, usize) {
    let (mut places, mut found) = (0, 0);
    for at in 0..records.len() {
        let mut spoilt = records.to_vec();
        if plant(&mut spoilt, at) {
            places += 1;
            found += usize::from(check(&spoilt).iter().any(&expected));
        }
    }
    (places, found)
}

fn step_with(record: &mut Record, kind: SlotEvent) -> Option<&mut ashfall::gpu::StepRecord> {
    record.steps.iter_mut().find(|step| step.slots.iter().any(|(event, _)| *event == kind))
}

pub fn all_found(what: &str, (places, found): (usize, usize)) {
    println!("{what}: {found} of {places} found");
    assert!(places > 0, "{what}: planted nowhere");
    assert_eq!(found, places, "{what}");
}

#[test]
fn faults_planted_in_real_drawings_are_found() {
    let Some(device) = Device::open() else { return };
    let drawn = recorded(&device, 8, CopyPath::Straight, true, Some(1));
    let records = &drawn.records;
    assert!(check(records).is_empty());

    // Publishing does not wait for the copy.
    let no_wait = |records: &mut Vec<Record>, at: usize| {
        let record = &mut records[at];
        let publishes = step_with(record, SlotEvent::Published).is_some();
        let waits = record.waits.iter().any(|point| point.role == RoleKind::Transfer);
        record.waits.retain(|point| point.role != RoleKind::Transfer);
        publishes && waits
    };
    let early =
        |fault: &Fault| matches!(fault, Fault::PublishedBeforeWritten { write: Some(_), .. });
    all_found("no wait for the copy", planted(records, no_wait, early));

    // A slot is published with the round before.
    let too_early = |records: &mut Vec<Record>, at: usize| {
        let before = (0..at)
            .rev()
            .find(|before| records[*before].steps.iter().any(|step| step.label == "publish"));
        let Some(before) = before else { return false };
        let Some(step) = step_with(&mut records[at], SlotEvent::Published) else { return false };
        let moved = step.slots.pop();
        let publish = records[before].steps.iter_mut().find(|step| step.label == "publish");
        publish.expect("as found").slots.extend(moved);
        true
    };
    let unwritten = |fault: &Fault| matches!(fault, Fault::PublishedBeforeWritten { .. });
    all_found("published a round early", planted(records, too_early, unwritten));

    // A slot that rays read is written for another brick.
    let reused = |records: &mut Vec<Record>, at: usize| {
        let read = records[..at]
            .iter()
            .rev()
            .flat_map(|record| &record.steps)
            .find_map(|step| step.slots.iter().find(|(event, _)| *event == SlotEvent::MayRead));
        let granted: Vec<u32> = records[..at]
            .iter()
            .rfind(|record| record.steps.iter().any(|step| step.label == "grant"))
            .into_iter()
            .flat_map(|record| &record.steps)
            .flat_map(|step| &step.slots)
            .filter(|(event, _)| *event == SlotEvent::Granted)
            .map(|(_, slot)| *slot)
            .collect();
        let Some((_, slot)) = read.copied().filter(|(_, slot)| !granted.contains(slot)) else {
            return false;
        };
        let Some(step) = step_with(&mut records[at], SlotEvent::CopiedInto) else { return false };
        step.slots[0].1 = slot;
        true
    };
    let ungranted = |fault: &Fault| {
        matches!(fault, Fault::WrittenUngranted { .. } | Fault::WrittenWhileRead { .. })
    };
    all_found("a slot reused early", planted(records, reused, ungranted));

    // A wait for what nobody signals.
    let last = records.iter().map(|record| record.point.value).max().expect("records");
    let forever = |records: &mut Vec<Record>, at: usize| {
        let role = RoleKind::Transfer;
        records[at].waits.push(TimePoint { role, value: last + 1000 });
        records[at].point.value > 0
    };
    let endless = |fault: &Fault| matches!(fault, Fault::NeverSignalled { .. });
    all_found("a wait for nobody", planted(records, forever, endless));

    // The host fills a half whose copy is under way: where no round's end has told it otherwise.
    let overwritten = |records: &mut Vec<Record>, at: usize| {
        let is_copy = |record: &Record| record.steps.iter().any(|step| step.label == "copy");
        let two_before = records[..at].iter().rev().take(2).filter(|r| is_copy(r)).count() == 2;
        let record = &mut records[at];
        let waited = record.host.iter().any(|event| matches!(event, HostEvent::Waited(_)));
        record.host.retain(|event| !matches!(event, HostEvent::Waited(_)));
        two_before && is_copy(record) && waited
    };
    let spoilt = |fault: &Fault| matches!(fault, Fault::OverwrittenByHost { .. });
    all_found("a half overwritten early", planted(records, overwritten, spoilt));
    device.finish();
}

#[test]
fn faults_planted_on_the_placed_path_are_found() {
    let Some(device) = Device::open() else { return };
    let drawn = recorded(&device, 8, CopyPath::Placed, true, Some(1));
    let records = &drawn.records;
    let labelled = |record: &Record, label| record.steps.iter().any(|step| step.label == label);

    let no_wait = |records: &mut Vec<Record>, at: usize| {
        let places = labelled(&records[at], "place") && !records[at].waits.is_empty();
        records[at].waits.clear();
        places
    };
    let unordered = |fault: &Fault| matches!(fault, Fault::Unordered { resource: "upload", .. });
    all_found("placing waits for no copy", planted(records, no_wait, unordered));

    // The next copy writes the upload buffer while bricks are placed from it.
    let no_room = |records: &mut Vec<Record>, at: usize| {
        let copies = labelled(&records[at], "copy");
        let before = at > 0 && labelled(&records[at - 1], "place");
        records[at].waits.clear();
        copies && before
    };
    all_found("copying waits for no placing", planted(records, no_room, unordered));

    // Placements of before are overwritten by the host.
    let host = |record: &Record| {
        record
            .host
            .iter()
            .any(|event| matches!(event, HostEvent::Wrote { buffer: "placements", .. }))
    };
    let place = |record: &&Record| labelled(record, "place");
    assert!(records.iter().filter(place).all(host), "the host says what it writes");
    let same_part = |records: &mut Vec<Record>, at: usize| {
        let two = at > 1 && labelled(&records[at], "place") && labelled(&records[at - 2], "place");
        let wrote = |record: &Record| {
            let wrote = record.host.iter().find(|event| matches!(event, HostEvent::Wrote { .. }));
            wrote.cloned()
        };
        let before = if two { wrote(&records[at - 2]) } else { None };
        records[at].host = before.clone().into_iter().collect();
        before.is_some()
    };
    let spoilt =
        |fault: &Fault| matches!(fault, Fault::OverwrittenByHost { buffer: "placements", .. });
    all_found("placements overwritten early", planted(records, same_part, spoilt));
    device.finish();
}
