//! Random right schedules of a paging loop, and single faults planted in them.

use std::ops::Range;

use crate::random::Random;
use ashfall::gpu::{
    Access, Barrier, HostEvent, Record, RoleKind, SlotEvent, StepKind, StepRecord, TimePoint,
};

pub const RENDER: RoleKind = RoleKind::Render;
pub const TRANSFER: RoleKind = RoleKind::Transfer;
pub const HALVES: [&str; 2] = ["staging_half_0", "staging_half_1"];
const SLOTS: u32 = 8;

pub fn point(role: RoleKind, value: u64) -> TimePoint {
    TimePoint { role, value }
}

pub fn step(label: &'static str, accesses: &[(&'static str, Access)]) -> StepRecord {
    StepRecord {
        label,
        kind: StepKind::Dispatch([1; 3]),
        accesses: accesses.to_vec(),
        handed_over: Vec::new(),
        regions: Vec::new(),
        barriers: Vec::new(),
        slots: Vec::new(),
        by_slot: Vec::new(),
    }
}

/// Adds the barrier between two uses.
pub fn after(mut step: StepRecord, name: &'static str, uses: [Access; 2]) -> StepRecord {
    step.barriers.push((name, Barrier::between(uses[0], uses[1])));
    step
}

pub fn with_slots(mut step: StepRecord, event: SlotEvent, slots: &[u32]) -> StepRecord {
    step.slots.extend(slots.iter().map(|slot| (event, *slot)));
    step
}

/// A copy from a half into slots of the atlas.
pub fn copy(half: usize, range: Range<u64>, slots: &[u32]) -> StepRecord {
    let accesses = [(HALVES[half], Access::CopyRead), ("atlas", Access::CopyWrite)];
    let mut step = with_slots(step("copy", &accesses), SlotEvent::CopiedInto, slots);
    step.kind = StepKind::CopyToImage;
    step.regions.push((HALVES[half], range, Access::CopyRead));
    step.by_slot.push("atlas");
    step
}

pub fn submit(
    role: RoleKind,
    value: u64,
    waits: &[TimePoint],
    host: &[HostEvent],
    steps: Vec<StepRecord>,
) -> Record {
    let (waits, host) = (waits.to_vec(), host.to_vec());
    Record { role, point: point(role, value), waits, host, steps }
}

pub fn wrote(half: usize, range: Range<u64>) -> HostEvent {
    HostEvent::Wrote { buffer: HALVES[half], range }
}

/// Publish, march and grant, as a frame of the paging loop records them; `first` has nothing before.
pub fn frame(publish: &[u32], may_read: &[u32], grant: &[u32], first: bool) -> Vec<StepRecord> {
    use Access::{CopyWrite, HostRead, ShaderRead, ShaderSample, ShaderUpdate};
    let table = |label, access| step(label, &[("page_table", access)]);
    let mut published = with_slots(table("publish", ShaderUpdate), SlotEvent::Published, publish);
    if !first {
        published = after(published, "page_table", [ShaderUpdate, ShaderUpdate]);
    }
    let marched = step("march", &[("page_table", ShaderRead), ("atlas", ShaderSample)]);
    let mut marched = with_slots(marched, SlotEvent::MayRead, may_read);
    marched.by_slot.push("atlas");
    let granted = with_slots(table("grant", ShaderUpdate), SlotEvent::Granted, grant);
    let mut listed = step("lists", &[("page_table", ShaderRead), ("short_lists", CopyWrite)]);
    if !first {
        listed = after(listed, "short_lists", [CopyWrite, CopyWrite]);
    }
    vec![
        published,
        after(marched, "page_table", [ShaderUpdate, ShaderRead]),
        after(granted, "page_table", [ShaderRead, ShaderUpdate]),
        after(listed, "page_table", [ShaderUpdate, ShaderRead]),
        after(
            step("host_read", &[("short_lists", HostRead)]),
            "short_lists",
            [CopyWrite, HostRead],
        ),
    ]
}

/// A schedule, and where each kind of fault can be planted in it.
#[derive(Default)]
pub struct Schedule {
    pub records: Vec<Record>,
    /// Record and wait without which an order is lost.
    essential: Vec<(usize, TimePoint)>,
    /// Records with the copy into a slot, and with its publishing.
    journeys: Vec<(usize, usize, u32)>,
    /// Records of copies, and a slot that rays may read at that time.
    mapped: Vec<(usize, u32)>,
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    Free,
    Granted(u64),
    /// Copied by this record.
    Copied(u64, usize),
    Mapped,
}

/// What was submitted, and what each side knows to have ended: render and transfer.
#[derive(Default)]
struct Known {
    host: [u64; 2],
    begun: [[u64; 2]; 2],
    starts: [Vec<[u64; 2]>; 2],
}

fn join(a: [u64; 2], b: [u64; 2]) -> [u64; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

impl Known {
    fn after(&self, wait: TimePoint) -> [u64; 2] {
        let role = wait.role as usize;
        let mut known = self.starts[role][wait.value as usize - 1];
        known[role] = known[role].max(wait.value);
        known
    }

    /// Submits; says which of the waits told something new.
    fn submit(&mut self, role: RoleKind, waits: &[TimePoint]) -> Vec<TimePoint> {
        let role = role as usize;
        let base = join(self.begun[role], self.host);
        let without = |left_out: &TimePoint| {
            let others = waits.iter().filter(|wait| *wait != left_out);
            others.fold(base, |known, wait| join(known, self.after(*wait)))
        };
        let news = |wait: &&TimePoint| without(wait)[wait.role as usize] < wait.value;
        let essential = waits.iter().filter(news).copied().collect();
        let known = waits.iter().fold(base, |known, wait| join(known, self.after(*wait)));
        self.begun[role] = known;
        self.starts[role].push(known);
        essential
    }

    fn wait(&mut self, wait: TimePoint) {
        self.host = join(self.host, self.after(wait));
    }
}

pub fn schedule(random: &mut Random) -> Schedule {
    let mut made = Schedule::default();
    let mut slots = [State::Free; SLOTS as usize];
    let mut known = Known::default();
    let (mut frames, mut flushes) = (0u64, 0u64);
    let which = |slots: &[State], wanted: &dyn Fn(State) -> bool| -> Vec<u32> {
        (0..SLOTS).filter(|slot| wanted(slots[*slot as usize])).collect()
    };
    let frames_least = 6 + (random.unit() * 20.0) as u64;
    while frames < frames_least || flushes == 0 {
        // A frame: what arrived, or some of it, is published; rays read; others are granted.
        let arrived = which(&slots, &|s| matches!(s, State::Copied(..)));
        let publish: Vec<u32> = arrived.into_iter().filter(|_| random.unit() < 0.7).collect();
        let mut newest = 0;
        for slot in &publish {
            if let State::Copied(flush, record) = slots[*slot as usize] {
                newest = newest.max(flush);
                made.journeys.push((record, made.records.len(), *slot));
            }
            slots[*slot as usize] = State::Mapped;
        }
        let may_read = which(&slots, &|s| s == State::Mapped);
        let takable = which(&slots, &|s| matches!(s, State::Mapped | State::Free));
        let grant: Vec<u32> = takable.into_iter().filter(|_| random.unit() < 0.4).collect();
        frames += 1;
        grant.iter().for_each(|slot| slots[*slot as usize] = State::Granted(frames));
        let waits: Vec<_> = (newest > 0).then(|| point(TRANSFER, newest)).into_iter().collect();
        let mut host = Vec::new();
        if frames > 1 && random.unit() < 0.3 {
            let wait = point(RENDER, frames - 1);
            known.wait(wait);
            host.push(HostEvent::Waited(wait));
            host.push(HostEvent::Read { buffer: "short_lists", range: 0..64 });
        }
        let essential = known.submit(RENDER, &waits);
        made.essential.extend(essential.into_iter().map(|wait| (made.records.len(), wait)));
        let steps = frame(&publish, &may_read, &grant, frames == 1);
        made.records.push(submit(RENDER, frames, &waits, &host, steps));

        // Some of what is granted is copied, in one submit or two.
        for _ in 0..(random.unit() * 3.0) as usize {
            let granted = which(&slots, &|s| matches!(s, State::Granted(_)));
            let chosen: Vec<u32> = granted.into_iter().filter(|_| random.unit() < 0.6).collect();
            if chosen.is_empty() {
                continue;
            }
            let half = flushes as usize % 2;
            flushes += 1;
            let mut host = Vec::new();
            if flushes > 2 {
                let wait = point(TRANSFER, flushes - 2);
                known.wait(wait);
                host.push(HostEvent::Waited(wait));
            }
            let bytes = 64 * chosen.len() as u64;
            host.push(wrote(half, 0..bytes));
            let granted_in = |slot: &u32| match slots[*slot as usize] {
                State::Granted(frame) => frame,
                _ => 0,
            };
            let newest = chosen.iter().map(granted_in).max().unwrap_or(0);
            let waits = [point(RENDER, newest)];
            let essential = known.submit(TRANSFER, &waits);
            let index = made.records.len();
            made.essential.extend(essential.into_iter().map(|wait| (index, wait)));
            let mapped = which(&slots, &|s| s == State::Mapped);
            made.mapped.extend(mapped.into_iter().map(|slot| (index, slot)));
            for slot in &chosen {
                slots[*slot as usize] = State::Copied(flushes, index);
            }
            let mut copied = copy(half, 0..bytes, &chosen);
            if flushes > 1 {
                copied = after(copied, "atlas", [Access::CopyWrite, Access::CopyWrite]);
            }
            made.records.push(submit(TRANSFER, flushes, &waits, &host, vec![copied]));
        }
    }
    made
}

fn any<T: Copy>(random: &mut Random, from: &[T]) -> Option<T> {
    from.get((random.unit() * from.len() as f64) as usize).copied()
}

/// Plants one fault; says which, or nothing when the schedule has no place for one.
pub fn plant(made: &mut Schedule, random: &mut Random, kind: usize) -> Option<String> {
    let records = &mut made.records;
    match kind {
        0 => {
            let (record, wait) = any(random, &made.essential)?;
            records[record].waits.retain(|other| *other != wait);
            Some(format!("{:?} no longer waits for {wait:?}", records[record].point))
        }
        1 => {
            let (copied, published, slot) = any(random, &made.journeys)?;
            for (record, from, to) in [
                (copied, SlotEvent::CopiedInto, SlotEvent::Published),
                (published, SlotEvent::Published, SlotEvent::CopiedInto),
            ] {
                let steps = records[record].steps.iter_mut().flat_map(|step| &mut step.slots);
                let event = steps.into_iter().find(|event| **event == (from, slot))?;
                event.0 = to;
            }
            Some(format!("slot {slot} is published where it was copied, and the reverse"))
        }
        2 => {
            let (record, slot) = any(random, &made.mapped)?;
            records[record].steps[0].slots.push((SlotEvent::CopiedInto, slot));
            Some(format!("slot {slot} is copied into by {:?}", records[record].point))
        }
        _ => {
            let copies = |(_, record): &(usize, &Record)| record.role == TRANSFER;
            let copies: Vec<usize> =
                records.iter().enumerate().filter(copies).map(|(index, _)| index).collect();
            let record = any(random, &copies)?;
            let (buffer, range, _) = records[record].steps[0].regions[0].clone();
            let overwrite = HostEvent::Wrote { buffer, range };
            match records.get_mut(record + 1) {
                Some(next) => next.host.insert(0, overwrite),
                None => records.push(Record::of_host(vec![overwrite])),
            }
            Some(format!("{buffer} is overwritten after record {record}"))
        }
    }
}
