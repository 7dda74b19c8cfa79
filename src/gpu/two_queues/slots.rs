//! The life of slots: granted, written, published, read, and granted again.

use std::collections::HashMap;

use crate::gpu::record::{Record, SlotEvent, StepRecord};
use crate::gpu::roles::TimePoint;
use crate::gpu::two_queues::fault::{Fault, Where};
use crate::gpu::two_queues::timeline::Clock;

/// Follows every slot; races between single writes and reads are found by the hazards.
#[derive(Default)]
pub(super) struct Slots {
    slots: HashMap<u32, Slot>,
    pub faults: Vec<Fault>,
}

#[derive(Clone, Copy)]
struct Event {
    at: Where,
    point: TimePoint,
}

#[derive(Default)]
enum Phase {
    #[default]
    Unused,
    Granted(Event),
    Published(Event),
}

#[derive(Default)]
struct Slot {
    phase: Phase,
    /// Since the grant.
    writes: Vec<Event>,
    last: Option<Where>,
}

impl Slots {
    /// Follows a step's events, which must come in an order that respects the waits. On one role,
    /// events follow each other as submitted: what they do to resources is checked as hazards.
    pub fn step(&mut self, clock: &Clock, record: &Record, step: &StepRecord) {
        let this = Event { at: Where::step(record, step), point: record.point };
        let before = |event: &Event| {
            event.point.role == record.role && event.point.value <= record.point.value
                || clock.knows(event.point)
        };
        for (event, number) in &step.slots {
            let slot = self.slots.entry(*number).or_default();
            let number = *number;
            let fault = match event {
                SlotEvent::Granted => {
                    let twice = match slot.phase {
                        Phase::Granted(first) => Some(Fault::GrantedTwice {
                            slot: number,
                            first: first.at,
                            second: this.at,
                        }),
                        _ => None,
                    };
                    slot.phase = Phase::Granted(this);
                    slot.writes.clear();
                    twice
                }
                SlotEvent::CopiedInto | SlotEvent::Placed => {
                    slot.writes.push(this);
                    slot.written(number, this.at, before)
                }
                SlotEvent::Published => {
                    let early = slot.writes.iter().find(|write| !before(write));
                    let fault = Fault::PublishedBeforeWritten {
                        slot: number,
                        publish: this.at,
                        write: early.map(|write| write.at),
                    };
                    let wrong = early.is_some() || slot.writes.is_empty();
                    slot.phase = Phase::Published(this);
                    slot.writes.clear();
                    wrong.then_some(fault)
                }
                SlotEvent::MayRead => {
                    let visible = matches!(&slot.phase, Phase::Published(p) if before(p));
                    let (read, last) = (this.at, slot.last);
                    (!visible).then_some(Fault::ReadUnpublished { slot: number, read, last })
                }
            };
            if *event != SlotEvent::MayRead {
                slot.last = Some(this.at);
            }
            self.faults.extend(fault);
        }
    }
}

impl Slot {
    fn written(&self, slot: u32, write: Where, before: impl Fn(&Event) -> bool) -> Option<Fault> {
        match self.phase {
            Phase::Granted(grant) if before(&grant) => None,
            Phase::Granted(grant) => {
                Some(Fault::WrittenBeforeUnmapped { slot, write, grant: grant.at })
            }
            Phase::Published(published) => {
                let published = Some(published.at);
                Some(Fault::WrittenUngranted { slot, write, published })
            }
            Phase::Unused => Some(Fault::WrittenUngranted { slot, write, published: None }),
        }
    }
}
