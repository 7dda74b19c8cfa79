//! What was recorded, as plain data: for tests, traces and the simulation of two queues.

use std::ops::Range;

use crate::gpu::access::{Access, Barrier};
use crate::gpu::roles::TimePoint;

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
    /// Bytes of buffers that copies read and write; a buffer that is not named here is used whole.
    pub regions: Vec<(&'static str, Range<u64>, Access)>,
    /// Barriers before the step, with the resource's name.
    pub barriers: Vec<(&'static str, Barrier)>,
}

/// All steps of one submit, in order.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// In order of execution.
    pub steps: Vec<StepRecord>,
}

/// A submit that was handed to the device.
#[derive(Clone, Debug)]
pub struct Submitted {
    /// Reached when the device has finished it.
    pub point: TimePoint,
    /// What was recorded.
    pub record: Record,
}
