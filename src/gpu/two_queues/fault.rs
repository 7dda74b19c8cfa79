//! What can go wrong between two queues and the host, each with its places.

use std::fmt;
use std::ops::Range;

use crate::gpu::access::Access;
use crate::gpu::record::{Record, StepRecord};
use crate::gpu::roles::TimePoint;

/// A place in the list of records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Where {
    /// A step of the submit that signals `point`.
    Step {
        /// Of its submit.
        point: TimePoint,
        /// The step's label.
        label: &'static str,
    },
    /// The host, before the submit that signals `point`.
    Host {
        /// Of the submit that follows; value 0: none follows.
        point: TimePoint,
    },
    /// A whole submit.
    Submit {
        /// What it signals.
        point: TimePoint,
    },
}

impl Where {
    pub(super) fn step(record: &Record, step: &StepRecord) -> Where {
        Where::Step { point: record.point, label: step.label }
    }
}

/// Two things without an order between them, or in the wrong one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Two uses of which one writes, of the same bytes or image.
    Unordered {
        /// Name of the buffer or image.
        resource: &'static str,
        /// Submitted first.
        first: (Where, Access),
        /// Submitted second.
        second: (Where, Access),
    },
    /// The host writes what the device may still read or write.
    OverwrittenByHost {
        /// Name of the staging half.
        buffer: &'static str,
        /// What the host writes.
        range: Range<u64>,
        /// Where it does.
        host: Where,
        /// Who may still be at it.
        device: Where,
    },
    /// The host reads what the device may not have written yet.
    ReadByHostEarly {
        /// Name of the buffer.
        buffer: &'static str,
        /// What the host reads.
        range: Range<u64>,
        /// Where it does.
        host: Where,
        /// Who writes.
        device: Where,
    },
    /// A slot is written while rays may read it.
    WrittenWhileRead {
        /// The slot.
        slot: u32,
        /// Who writes.
        write: Where,
        /// Who reads.
        read: Where,
    },
    /// A slot is written twice without an order.
    WrittenTwice {
        /// The slot.
        slot: u32,
        /// Submitted first.
        first: Where,
        /// Submitted second.
        second: Where,
    },
    /// A slot is written, but no grant came before.
    WrittenUngranted {
        /// The slot.
        slot: u32,
        /// Who writes.
        write: Where,
        /// Since when rays may read it, if they may.
        published: Option<Where>,
    },
    /// A slot is written, though its unmapping need not have ended.
    WrittenBeforeUnmapped {
        /// The slot.
        slot: u32,
        /// Who writes.
        write: Where,
        /// Who unmaps.
        grant: Where,
    },
    /// A slot is published, though its copy need not have ended.
    PublishedBeforeWritten {
        /// The slot.
        slot: u32,
        /// Who publishes.
        publish: Where,
        /// The copy, if there is one since the grant.
        write: Option<Where>,
    },
    /// Rays may read a slot that is not published, or whose publishing need not have ended.
    ReadUnpublished {
        /// The slot.
        slot: u32,
        /// Who reads.
        read: Where,
        /// What last happened to the slot.
        last: Option<Where>,
    },
    /// A slot is promised twice without being published in between.
    GrantedTwice {
        /// The slot.
        slot: u32,
        /// The first promise.
        first: Where,
        /// The second.
        second: Where,
    },
    /// A role acquires what the other has not released to it before.
    AcquiredUnreleased {
        /// Name of the buffer.
        resource: &'static str,
        /// Who acquires.
        acquire: Where,
        /// What last happened to it.
        release: Option<Where>,
    },
    /// A role uses what belongs to the other, or to nobody.
    UsedUnowned {
        /// Name of the buffer.
        resource: &'static str,
        /// Who uses it.
        used: Where,
        /// What last happened to it.
        last: Option<Where>,
    },
    /// A wait that never ends.
    NeverSignalled {
        /// Who waits.
        waiter: Where,
        /// For what.
        point: TimePoint,
    },
    /// Submits that wait for each other.
    WaitsInACycle {
        /// Each waits for the next, and the last for the first.
        points: Vec<TimePoint>,
    },
    /// A role's time points do not grow from submit to submit.
    TimelineBackwards {
        /// Submitted first.
        first: TimePoint,
        /// Submitted second.
        second: TimePoint,
    },
}

fn point_text(point: TimePoint) -> String {
    format!("{} {}", point.role.name(), point.value)
}

fn last_text(last: Option<Where>) -> String {
    last.map_or(String::new(), |at| format!(": the last to touch it is {at}"))
}

impl fmt::Display for Where {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Where::Step { point, label } => write!(f, "{label} in {}", point_text(*point)),
            Where::Host { point } if point.value == 0 => f.write_str("the host at the end"),
            Where::Host { point } => write!(f, "the host before {}", point_text(*point)),
            Where::Submit { point } => f.write_str(&point_text(*point)),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Fault::Unordered { resource, first, second } => write!(
                f,
                "{resource} is used by {} ({:?}) and {} ({:?}) without an order between them",
                first.0, first.1, second.0, second.1
            ),
            Fault::OverwrittenByHost { buffer, range, host, device } => write!(
                f,
                "{host} overwrites bytes {range:?} of {buffer}, which {device} may still use"
            ),
            Fault::ReadByHostEarly { buffer, range, host, device } => write!(
                f,
                "{host} reads bytes {range:?} of {buffer}, which {device} may not have written yet"
            ),
            Fault::WrittenWhileRead { slot, write, read } => {
                write!(f, "slot {slot} is written by {write} while {read} may read it")
            }
            Fault::WrittenTwice { slot, first, second } => {
                write!(f, "slot {slot} is written by {first} and {second} without an order")
            }
            Fault::WrittenUngranted { slot, write, published: Some(published) } => write!(
                f,
                "slot {slot} is written by {write} without a grant, though published by {published}"
            ),
            Fault::WrittenUngranted { slot, write, published: None } => {
                write!(f, "slot {slot} is written by {write}, but nothing granted it")
            }
            Fault::WrittenBeforeUnmapped { slot, write, grant } => write!(
                f,
                "slot {slot} is written by {write}, which does not wait for its unmapping by {grant}"
            ),
            Fault::PublishedBeforeWritten { slot, publish, write: Some(write) } => write!(
                f,
                "slot {slot} is published by {publish}, which does not wait for its copy, {write}"
            ),
            Fault::PublishedBeforeWritten { slot, publish, write: None } => {
                write!(f, "slot {slot} is published by {publish}, but nothing was copied into it")
            }
            Fault::ReadUnpublished { slot, read, last: Some(last) } => write!(
                f,
                "slot {slot} may be read by {read}, but is not published: the last to touch it is {last}"
            ),
            Fault::ReadUnpublished { slot, read, last: None } => {
                write!(f, "slot {slot} may be read by {read}, but nothing was ever put into it")
            }
            Fault::GrantedTwice { slot, first, second } => write!(
                f,
                "slot {slot} is granted by {first} and by {second}, but not published in between"
            ),
            Fault::AcquiredUnreleased { resource, acquire, release } => write!(
                f,
                "{resource} is acquired by {acquire}, and no release to it came before{}",
                last_text(*release)
            ),
            Fault::UsedUnowned { resource, used, last } => write!(
                f,
                "{resource} is used by {used}, whose role does not have it{}",
                last_text(*last)
            ),
            Fault::NeverSignalled { waiter, point } => {
                write!(f, "{waiter} waits for {}, which nobody signals", point_text(*point))
            }
            Fault::WaitsInACycle { points } => {
                let names: Vec<_> = points.iter().copied().map(point_text).collect();
                write!(f, "{} wait for each other in a cycle", names.join(", "))
            }
            Fault::TimelineBackwards { first, second } => write!(
                f,
                "{} is submitted after {}: time points must grow",
                point_text(*second),
                point_text(*first)
            ),
        }
    }
}
