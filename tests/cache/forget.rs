//! The pass that forgets a channel: against its twin, the twin against plain words, and faults planted in it.

use ashfall::passes::forget::{record, variant};
use ashfall::twins::cache::entry;
use ashfall::twins::forget::{Push, forget};
use ashfall::twins::limits::{ENTRY_FAILED, ENTRY_MAPPED, OWNER_FREE, OWNER_GRANTED};

use crate::common::device::{Device, device};
use crate::faults::{Fault, all_noticed};
use crate::model::PLANS;
use crate::on_device::{buffers, compare, read};
use crate::random::Random;
use crate::world::{World, chance};

/// Forgets some channel of some atlas in a cache full of everything; what differs.
fn run(device: &Device, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let world = World::new(PLANS[random.index(PLANS.len())]);
    let mut cache = world.cache();
    for value in &mut cache.page_table {
        *value = entry(random.below(u64::from(ENTRY_FAILED) + 1) as u32, random.below(9) as u32);
    }
    let shapes: Vec<_> = world.atlases.clone();
    for shape in &shapes {
        for slot in shape.slot_first..shape.slot_first + shape.slot_count {
            let entries = u64::from(shape.word_count * 32);
            let brick = shape.entry_first + random.below(entries) as u32;
            let owner = [brick, brick, OWNER_FREE, OWNER_GRANTED][random.index(4)];
            cache.slot_owner[slot as usize] = owner;
        }
    }
    let shape = shapes[random.index(shapes.len())];
    let push = Push {
        entry_first: shape.entry_first,
        channels: shape.channels,
        channel: random.below(shape.channels.into()) as u32,
        places: shape.word_count * 32 / shape.channels,
        slot_first: shape.slot_first,
        slot_count: shape.slot_count,
        keep: chance(&mut random, 0.5).into(),
        round: 1 + random.below(9) as u32,
    };
    let pipeline = device.pipeline(&variant());
    let on_device = buffers(device, &world, &cache);
    device.run(|recorder| {
        record(recorder, &pipeline, &on_device, &push);
        recorder.host_read(&on_device.page_table);
        recorder.host_read(&on_device.slot_owner);
        recorder.host_read(&on_device.slot_used);
    });
    let before = cache.clone();
    forget(&mut cache, &push);
    // In plain words: an entry is the channel's by its remainder.
    let of_channel = |number: u32| {
        let at = number.wrapping_sub(push.entry_first);
        at < push.places * push.channels && at % push.channels == push.channel
    };
    for (number, (was, is)) in (0..).zip(before.page_table.iter().zip(&cache.page_table)) {
        let stays = !of_channel(number) || push.keep == 1 && was >> 28 == ENTRY_MAPPED;
        assert_eq!(*is, if stays { *was } else { 0 }, "entry {number}, {push:?}");
    }
    for (slot, (was, is)) in before.slot_owner.iter().zip(&cache.slot_owner).enumerate() {
        let of_atlas =
            (push.slot_first..push.slot_first + push.slot_count).contains(&(slot as u32));
        let freed = of_atlas && of_channel(*was) && push.keep == 0;
        assert_eq!(*is, if freed { OWNER_FREE } else { *was }, "slot {slot}, {push:?}");
        let (used, holds) = (cache.slot_used[slot], *was < OWNER_GRANTED);
        let marked = of_atlas && holds && push.keep == 0;
        let wanted = if freed { 0 } else { push.round };
        assert_eq!(used, if marked { wanted } else { before.slot_used[slot] }, "slot {slot}");
    }
    let got = read(device, &on_device, 0)?;
    compare(&got, &cache, !world.plan.substitute).map_err(|why| format!("seed {seed}: {why}"))
}

#[test]
fn a_channel_is_forgotten_and_no_other() {
    let Some(device) = device() else { return };
    (900..960).for_each(|seed| run(&device, seed).unwrap_or_else(|why| panic!("{why}")));
}

#[rustfmt::skip]
const FAULTS: &[Fault] = &[
    ("forget.comp", "index < push.places", "index + 1u < push.places"),
    ("forget.comp", "index * push.channels + push.channel", "index * push.channels"),
    ("forget.comp", "push.keep != 0u && ", ""),
    ("forget.comp", "== ENTRY_MAPPED;", "!= ENTRY_UNMAPPED;"),
    ("forget.comp", "push.slot_count && push.keep == 0u", "push.slot_count"),
    ("forget.comp", "owner < OWNER_GRANTED", "owner < OWNER_FREE"),
    ("forget.comp", "forgotten ? 0u : push.round", "push.round"),
    ("forget.comp", "(owner - push.entry_first) %", "owner %"),
    ("forget.comp", "uint slot = push.slot_first + index;", "uint slot = index;"),
];

#[test]
fn faults_in_forgetting_are_noticed() {
    let Some(mut device) = device() else { return };
    all_noticed(&mut device, FAULTS, |device| (900..960).find_map(|seed| run(device, seed).err()));
}
