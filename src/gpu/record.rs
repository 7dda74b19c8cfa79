//! What was recorded, as plain data: for tests, traces and the simulation of two queues.

use std::ops::Range;

use crate::gpu::access::{Access, Barrier};
use crate::gpu::roles::{RoleKind, TimePoint};

/// What kind of step was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// A compute dispatch, in workgroups.
    Dispatch([u32; 3]),
    /// A copy from a buffer into an image.
    CopyToImage,
    /// A copy from a buffer into a buffer.
    CopyToBuffer,
    /// A part of a buffer is filled with one number.
    Fill,
    /// An image gets its layout.
    Prepare,
    /// The host reads after the submit.
    HostRead,
    /// A buffer is given to another role.
    Release {
        /// The buffer's name.
        buffer: &'static str,
        /// Who gets it.
        to: RoleKind,
    },
    /// A buffer that was released is taken.
    Acquire {
        /// The buffer's name.
        buffer: &'static str,
        /// Who gave it.
        from: RoleKind,
    },
}

/// What a step does with a slot; to this room a slot is a number, whose owner adds the events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotEvent {
    /// Unmapped, and promised for a copy.
    Granted,
    /// Written by a copy.
    CopiedInto,
    /// Written by a shader.
    Placed,
    /// Made visible to the rays of later steps.
    Published,
    /// Rays of this step may read it.
    MayRead,
}

/// What the host did with buffers that the device uses, in its own order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HostEvent {
    /// It waited until the time point was reached.
    Waited(TimePoint),
    /// It wrote bytes of a buffer, such as a staging half.
    Wrote {
        /// The buffer's name.
        buffer: &'static str,
        /// Which bytes.
        range: Range<u64>,
    },
    /// It read bytes of a buffer.
    Read {
        /// The buffer's name.
        buffer: &'static str,
        /// Which bytes.
        range: Range<u64>,
    },
}

/// One recorded step, as tests and traces see it.
#[derive(Clone, Debug)]
pub struct StepRecord {
    /// The pass, or what is copied.
    pub label: &'static str,
    /// What kind of step.
    pub kind: StepKind,
    /// Resource names and how they are used.
    pub accesses: Vec<(&'static str, Access)>,
    /// Names of those resources that belong to one role at a time.
    pub handed_over: Vec<&'static str>,
    /// Bytes of buffers that copies read and write; a buffer that is not named here is used whole.
    pub regions: Vec<(&'static str, Range<u64>, Access)>,
    /// Barriers before the step, with the resource's name.
    pub barriers: Vec<(&'static str, Barrier)>,
    /// What it does with slots; empty unless their owner says it.
    pub slots: Vec<(SlotEvent, u32)>,
    /// Names of resources of which it touches nothing but the slots in `slots`; empty unless their
    /// owner says it.
    pub by_slot: Vec<&'static str>,
}

/// All steps of one submit, in order.
#[derive(Clone, Debug)]
pub struct Record {
    /// Whose queue.
    pub role: RoleKind,
    /// Reached when the device has finished it; of value 0 where nothing was submitted.
    pub point: TimePoint,
    /// Reached before it begins.
    pub waits: Vec<TimePoint>,
    /// What the host did since the submit before, as far as it says so.
    pub host: Vec<HostEvent>,
    /// In order of execution.
    pub steps: Vec<StepRecord>,
}

impl Record {
    /// What the host did without a submit after it.
    pub fn of_host(host: Vec<HostEvent>) -> Record {
        let role = RoleKind::Transfer;
        let point = TimePoint { role, value: 0 };
        Record { role, point, waits: Vec::new(), host, steps: Vec::new() }
    }
}

/// A submit that was handed to the device.
#[derive(Clone, Debug)]
pub struct Submitted {
    /// Reached when the device has finished it.
    pub point: TimePoint,
    /// What was recorded.
    pub record: Record,
}
