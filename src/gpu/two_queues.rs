//! A proof, over recorded submits, that two queues and the host never get in each other's way.
//!
//! No Vulkan call and no sampling of interleavings: an order is either shown or a fault. It holds on
//! any device, also where the tests' own driver has one queue and would run everything in turn.
//!
//! # What orders what
//! - A wait on a time point: all that was submitted to that role up to its value, and all that those
//!   submits themselves waited for, comes before this submit and later ones of its role.
//! - The host's waits likewise; its own events and submits come one after another.
//! - On one role, a recorded barrier on the same resource whose stages and accesses fit, or several
//!   in a chain. Order of submission alone orders nothing.
//! - A resource that belongs to one role at a time is used by the role that has it: from its first use or a copy
//!   into it, which asks for nothing that it held, until it is released, and from being acquired on.
//!
//! # Assumptions
//! Names stand for resources: no two share one. Slots begin unused: the list holds every event of
//! theirs. Submits that are left out of it are taken to signal, and to touch nothing.

mod fault;
mod hazards;
mod ownership;
mod slots;
mod timeline;

pub use fault::{Fault, Where};

use crate::gpu::record::Record;
use timeline::{Moment, Timeline};

/// Every fault found in submits given in the order in which the host made them.
pub fn check(records: &[Record]) -> Vec<Fault> {
    let timeline = match Timeline::of(records) {
        Ok(timeline) => timeline,
        // Nothing runs beyond a wait that never ends, so nothing else can be said.
        Err(faults) => return faults,
    };
    let mut hazards = hazards::Hazards::new(&timeline);
    let mut slots = slots::Slots::default();
    let mut ownership = ownership::Ownership::default();
    for moment in timeline.moments() {
        match *moment {
            Moment::Host(index) => hazards.host(index, &records[index]),
            Moment::Device(index) => {
                let clock = timeline.start(index);
                for step in &records[index].steps {
                    hazards.step(clock, &records[index], step);
                    slots.step(clock, &records[index], step);
                    ownership.step(clock, &records[index], step);
                }
                hazards.forget_settled(records[index].role, clock);
            }
        }
    }
    let mut faults = hazards.faults;
    faults.extend(slots.faults);
    faults.extend(ownership.faults);
    faults
}
