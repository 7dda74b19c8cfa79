//! The simulation of two queues: right schedules have no fault, and every planted fault is named.

mod random;
mod truth;

#[path = "two_queues/schedules.rs"]
mod schedules;

use ashfall::gpu::two_queues::{Fault, check};
use ashfall::gpu::{Access, HostEvent, Record, SlotEvent};
use random::Random;
use schedules::{
    HALVES, RENDER, TRANSFER, after, copy, frame, plant, point, schedule, step, submit, with_slots,
    wrote,
};

/// Two frames and two flushes; slot 5 goes the whole way twice.
fn right() -> Vec<Record> {
    let (r, t) = (|value| point(RENDER, value), |value| point(TRANSFER, value));
    let waited = HostEvent::Waited;
    let lists = HostEvent::Read { buffer: "short_lists", range: 0..64 };
    vec![
        submit(RENDER, 1, &[], &[], frame(&[], &[], &[5, 6], true)),
        submit(TRANSFER, 1, &[r(1)], &[wrote(0, 0..128)], vec![copy(0, 0..128, &[5, 6])]),
        submit(RENDER, 2, &[], &[waited(r(1)), lists], frame(&[], &[], &[7], false)),
        submit(TRANSFER, 2, &[r(2)], &[wrote(1, 0..64)], vec![copy(1, 0..64, &[7])]),
        submit(RENDER, 3, &[t(1)], &[], frame(&[5, 6], &[5, 6], &[5], false)),
        submit(TRANSFER, 3, &[r(3)], &[waited(t(1)), wrote(0, 0..64)], vec![copy(0, 0..64, &[5])]),
        submit(RENDER, 4, &[t(3)], &[], frame(&[5, 7], &[5, 6, 7], &[], false)),
    ]
}

#[track_caller]
fn one(records: &[Record], found: impl Fn(&Fault) -> bool, sentence: &str) {
    let faults = check(records);
    let text: Vec<String> = faults.iter().map(Fault::to_string).collect();
    assert!(faults.iter().any(found), "not found among {text:#?}");
    assert!(text.iter().any(|text| text == sentence), "{sentence:?} is not among {text:#?}");
}

#[test]
fn a_right_list_has_no_fault() {
    assert_eq!(check(&right()), []);
    assert_eq!(check(&[]), []);
    // What waits may be submitted before what it waits for.
    let mut early = right();
    early.swap(3, 4);
    assert_eq!(check(&early), []);
    // A brick that is dropped after its copy is never published.
    let mut dropped = right();
    dropped.pop();
    assert_eq!(check(&dropped), []);
}

#[test]
fn a_slot_is_not_written_while_rays_may_read_it() {
    let mut records = right();
    records[5].waits.clear();
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenWhileRead { slot: 5, .. }),
        "slot 5 is written by copy in transfer 3 while march in render 3 may read it",
    );
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenBeforeUnmapped { slot: 5, .. }),
        "slot 5 is written by copy in transfer 3, which does not wait for its unmapping by grant in render 3",
    );
    // Waiting for an earlier frame is not enough.
    records[5].waits = vec![point(RENDER, 2)];
    assert!(!check(&records).is_empty());
}

#[test]
fn a_slot_is_published_after_its_copy() {
    let mut records = right();
    records[6].waits.clear();
    one(
        &records,
        |fault| matches!(fault, Fault::PublishedBeforeWritten { slot: 5, write: Some(_), .. }),
        "slot 5 is published by publish in render 4, which does not wait for its copy, copy in transfer 3",
    );
    let mut records = right();
    records[3].steps[0].slots.clear();
    one(
        &records,
        |fault| matches!(fault, Fault::PublishedBeforeWritten { slot: 7, write: None, .. }),
        "slot 7 is published by publish in render 4, but nothing was copied into it",
    );
}

#[test]
fn a_slot_is_read_only_while_published() {
    let mut records = right();
    records[2].steps[1].slots.push((SlotEvent::MayRead, 5));
    one(
        &records,
        |fault| matches!(fault, Fault::ReadUnpublished { slot: 5, .. }),
        "slot 5 may be read by march in render 2, but is not published: the last to touch it is copy in transfer 1",
    );
    let mut records = right();
    records[0].steps[1].slots.push((SlotEvent::MayRead, 3));
    one(
        &records,
        |fault| matches!(fault, Fault::ReadUnpublished { slot: 3, last: None, .. }),
        "slot 3 may be read by march in render 1, but nothing was ever put into it",
    );
}

#[test]
fn a_slot_is_granted_once_and_copied_only_then() {
    let mut records = right();
    records[2].steps[2].slots.push((SlotEvent::Granted, 6));
    one(
        &records,
        |fault| matches!(fault, Fault::GrantedTwice { slot: 6, .. }),
        "slot 6 is granted by grant in render 1 and by grant in render 2, but not published in between",
    );
    let mut records = right();
    records[5].steps[0].slots.push((SlotEvent::CopiedInto, 6));
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenUngranted { slot: 6, published: Some(_), .. }),
        "slot 6 is written by copy in transfer 3 without a grant, though published by publish in render 3",
    );
    let mut records = right();
    records[5].steps[0].slots.push((SlotEvent::CopiedInto, 1));
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenUngranted { slot: 1, published: None, .. }),
        "slot 1 is written by copy in transfer 3, but nothing granted it",
    );
}

#[test]
fn two_copies_into_a_slot_need_an_order() {
    let mut records = right();
    let again = submit(
        TRANSFER,
        4,
        &[],
        &[HostEvent::Waited(point(TRANSFER, 2)), wrote(1, 0..64)],
        vec![copy(1, 0..64, &[5])],
    );
    records.insert(6, again);
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenTwice { slot: 5, .. }),
        "slot 5 is written by copy in transfer 3 and copy in transfer 4 without an order",
    );
    let steps = std::mem::take(&mut records[6].steps);
    let ordered = steps
        .into_iter()
        .map(|step| after(step, "atlas", [Access::CopyWrite, Access::CopyWrite]))
        .collect();
    records[6].steps = ordered;
    records[7].waits = vec![point(TRANSFER, 4)];
    assert_eq!(check(&records), [], "the recorder's barrier orders them");
}

#[test]
fn the_host_waits_for_the_copy_that_reads_a_half() {
    let mut records = right();
    records[5].host.remove(0);
    one(
        &records,
        |fault| matches!(fault, Fault::OverwrittenByHost { buffer: "staging_half_0", .. }),
        "the host before transfer 3 overwrites bytes 0..64 of staging_half_0, which copy in transfer 1 may still use",
    );
    // Other bytes of the same half are free to be written.
    records[5].host[0] = wrote(0, 128..192);
    assert_eq!(check(&records), []);
    let mut records = right();
    records.push(Record::of_host(vec![wrote(0, 8..9)]));
    one(
        &records,
        |fault| matches!(fault, Fault::OverwrittenByHost { .. }),
        "the host at the end overwrites bytes 8..9 of staging_half_0, which copy in transfer 3 may still use",
    );
    let mut records = right();
    records[2].host.remove(0);
    one(
        &records,
        |fault| matches!(fault, Fault::ReadByHostEarly { buffer: "short_lists", .. }),
        "the host before render 2 reads bytes 0..64 of short_lists, which lists in render 1 may not have written yet",
    );
}

#[test]
fn waits_end() {
    let mut records = right();
    records[4].waits.push(point(TRANSFER, 9));
    one(
        &records,
        |fault| matches!(fault, Fault::NeverSignalled { .. }),
        "render 3 waits for transfer 9, which nobody signals",
    );
    let mut records = right();
    records[4].waits.push(point(TRANSFER, 3));
    one(
        &records,
        |fault| matches!(fault, Fault::WaitsInACycle { .. }),
        "render 3, transfer 3 wait for each other in a cycle",
    );
    // The host waits for what it has yet to submit.
    let mut records = right();
    records[3].host.push(HostEvent::Waited(point(RENDER, 4)));
    assert!(matches!(check(&records)[..], [Fault::WaitsInACycle { .. }]));
    // Submits before the list's own are taken to have signalled, and order nothing else.
    let of_window = [
        submit(RENDER, 7, &[point(TRANSFER, 2)], &[], Vec::new()),
        submit(TRANSFER, 5, &[point(RENDER, 7)], &[], Vec::new()),
    ];
    assert_eq!(check(&of_window), []);
    let mut records = right();
    records[6].point.value = 3;
    one(
        &records,
        |fault| matches!(fault, Fault::TimelineBackwards { .. }),
        "render 3 is submitted after render 3: time points must grow",
    );
}

#[test]
fn on_one_role_only_a_fitting_barrier_orders() {
    use Access::{CopyRead, CopyWrite, ShaderRead, ShaderUpdate, ShaderWrite};
    let of = |second| {
        let first = step("write", &[("counters", ShaderWrite)]);
        check(&[submit(RENDER, 1, &[], &[], vec![first, second])])
    };
    let read = || step("read", &[("counters", ShaderRead)]);
    let text = "counters is used by write in render 1 (ShaderWrite) and read in render 1 (ShaderRead) without an order between them";
    assert_eq!(of(read()).iter().map(Fault::to_string).collect::<Vec<_>>(), [text]);
    assert_eq!(of(after(read(), "counters", [ShaderWrite, ShaderRead])), []);
    assert_eq!(
        of(after(read(), "others", [ShaderWrite, ShaderRead])).len(),
        1,
        "another's barrier"
    );
    assert_eq!(of(after(read(), "counters", [ShaderWrite, CopyRead])).len(), 1, "another stage");
    assert_eq!(of(after(read(), "counters", [CopyWrite, ShaderRead])).len(), 1, "another source");
    // Ordered, but what was written is not made available.
    assert_eq!(of(after(read(), "counters", [ShaderRead, ShaderRead])).len(), 1, "no memory");
    // Over two submits and a chain of stages.
    let chain = |between: bool| {
        let copied = step("copy", &[("counters", CopyRead)]);
        let copied = match between {
            true => after(copied, "counters", [ShaderWrite, CopyRead]),
            false => copied,
        };
        let updated = step("update", &[("counters", ShaderUpdate)]);
        let updated = after(updated, "counters", [CopyRead, ShaderUpdate]);
        let first = step("write", &[("counters", ShaderWrite)]);
        check(&[
            submit(RENDER, 1, &[], &[], vec![first]),
            submit(RENDER, 2, &[], &[], vec![copied]),
            submit(RENDER, 3, &[], &[], vec![updated]),
        ])
    };
    assert_eq!(chain(true), []);
    assert!(!chain(false).is_empty());
}

#[test]
fn the_way_through_an_upload_buffer_is_followed_too() {
    use Access::{CopyRead, CopyWrite, ShaderRead, ShaderStore};
    let mut copied = step("copy", &[(HALVES[0], CopyRead), ("upload", CopyWrite)]);
    copied.regions.push((HALVES[0], 0..64, CopyRead));
    copied.regions.push(("upload", 0..64, CopyWrite));
    let placed = step("place", &[("upload", ShaderRead), ("atlas", ShaderStore)]);
    let mut placed = with_slots(placed, SlotEvent::Placed, &[2]);
    placed.by_slot.push("atlas");
    let mut steps = frame(&[2], &[2], &[], false);
    steps[1] = after(steps[1].clone(), "atlas", [ShaderStore, Access::ShaderSample]);
    steps.insert(0, placed);
    let mut records = vec![
        submit(RENDER, 1, &[], &[], frame(&[], &[], &[2], true)),
        submit(TRANSFER, 1, &[], &[wrote(0, 0..64)], vec![copied]),
        submit(RENDER, 2, &[point(TRANSFER, 1)], &[], steps),
    ];
    assert_eq!(check(&records), []);
    records[2].steps[2].barriers.retain(|(name, _)| *name != "atlas");
    one(
        &records,
        |fault| matches!(fault, Fault::WrittenWhileRead { slot: 2, .. }),
        "slot 2 is written by place in render 2 while march in render 2 may read it",
    );
    records[2].waits.clear();
    one(
        &records,
        |fault| matches!(fault, Fault::Unordered { resource: "upload", .. }),
        "upload is used by copy in transfer 1 (CopyWrite) and place in render 2 (ShaderRead) without an order between them",
    );
}

#[test]
fn random_right_schedules_have_no_fault_and_every_planted_one_is_found() {
    let mut planted = [0; 4];
    for seed in 0..1000 {
        let mut random = Random(seed);
        let mut made = schedule(&mut random);
        assert_eq!(check(&made.records), [], "seed {seed}");
        // Some schedules are too short for some kinds.
        for tried in 0..4 {
            let kind = (seed as usize + tried) % 4;
            if let Some(what) = plant(&mut made, &mut random, kind) {
                assert!(!check(&made.records).is_empty(), "seed {seed}: not found: {what}");
                planted[kind] += 1;
                break;
            }
        }
    }
    println!("planted by kind: {planted:?}");
    assert!(planted.iter().all(|count| *count > 150), "{planted:?}");
    assert_eq!(planted.iter().sum::<usize>(), 1000);
}
