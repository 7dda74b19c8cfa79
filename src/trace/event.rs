//! What a trace consists of: spans on tracks, and counters.

use crate::gpu::RoleKind;
use crate::volume::BrickId;

/// Whose time a span is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Track {
    /// The thread that runs the loop.
    Host,
    /// A loader thread, numbered from 0.
    Loader(u32),
    /// A role's queue.
    Queue(RoleKind),
}

/// Something that took time; of fixed size, so that events are bounded by their number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Whose time.
    pub track: Track,
    /// What was done.
    pub name: &'static str,
    /// First nanosecond.
    pub begin_ns: i64,
    /// One past the last.
    pub end_ns: i64,
    /// What else is known.
    pub details: Details,
}

/// What is known of a span beside its times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Details {
    /// Nothing.
    None,
    /// The round, counted over the whole trace.
    Round(u64),
    /// A brick and its voxel bytes; nothing where it could not be read.
    Brick(BrickId, Option<u64>),
    /// The first brick of a surveyed block, and how many there are.
    Block(BrickId, u64),
    /// A step on a queue: its submit's time point, and the round.
    Step {
        /// Value on the role's timeline.
        time_point: u64,
        /// The round in which it was submitted.
        round: u64,
    },
    /// A copy on a queue, or the flush that submitted it.
    Copy {
        /// Value on the role's timeline.
        time_point: u64,
        /// How many bricks; 0 where something else is copied.
        bricks: u64,
        /// Texel bytes.
        bytes: u64,
    },
}

/// A number that changes over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Counter {
    /// Rays that wait for a brick, at a round's end.
    RaysWaiting,
    /// Bricks that a slot is kept for and that have not come.
    BricksBound,
    /// Slots that the last round granted.
    SlotsGranted,
    /// Texel bytes copied to the device, in this view.
    BytesUploaded,
    /// Voxel bytes in the RAM cache.
    RamCacheBytes,
    /// Slots of all atlases without a brick.
    SlotsFree,
    /// Bricks that the last round's rays went through for the first time in the view.
    BricksTouched,
    /// Bricks that the last round's rays asked for in vain.
    BricksMissed,
    /// Bytes that the host read back for the last round.
    BytesReadBack,
    /// Microseconds of a window's last round on the wall.
    FrameTime,
    /// What it may take while something moves.
    FrameTarget,
    /// Bricks that a round may upload, to keep to that.
    UploadsMax,
}

impl Counter {
    pub(super) const ALL: [Counter; 12] = [
        Counter::RaysWaiting,
        Counter::BricksBound,
        Counter::SlotsGranted,
        Counter::BytesUploaded,
        Counter::RamCacheBytes,
        Counter::SlotsFree,
        Counter::BricksTouched,
        Counter::BricksMissed,
        Counter::BytesReadBack,
        Counter::FrameTime,
        Counter::FrameTarget,
        Counter::UploadsMax,
    ];

    /// The word in the file.
    pub const fn name(self) -> &'static str {
        match self {
            Counter::RaysWaiting => "rays waiting",
            Counter::BricksBound => "bricks bound",
            Counter::SlotsGranted => "slots granted",
            Counter::BytesUploaded => "bytes uploaded",
            Counter::RamCacheBytes => "RAM cache bytes",
            Counter::SlotsFree => "slots free",
            Counter::BricksTouched => "bricks touched",
            Counter::BricksMissed => "bricks missed",
            Counter::BytesReadBack => "bytes read back",
            Counter::FrameTime => "frame time, us",
            Counter::FrameTarget => "frame target, us",
            Counter::UploadsMax => "uploads allowed",
        }
    }
}

/// What happens to a brick on its way from being asked for to being given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrickStep {
    /// A ray asked for it.
    Wanted,
    /// Its texels are in the staging half.
    Staged,
    /// The copy into its slot was submitted.
    Submitted {
        /// Value on the transfer role's timeline.
        time_point: u64,
        /// Its texels.
        bytes: u64,
    },
    /// Rays find it from this round of the cache on.
    Published(u32),
    /// A ray went through it for the first time, in this round.
    Sampled(u32),
    /// Its slot was given to another brick after this round.
    Evicted(u32),
}

impl BrickStep {
    /// The word in the file.
    pub const fn name(self) -> &'static str {
        match self {
            BrickStep::Wanted => "wanted",
            BrickStep::Staged => "staged",
            BrickStep::Submitted { .. } => "submitted",
            BrickStep::Published(_) => "published",
            BrickStep::Sampled(_) => "sampled",
            BrickStep::Evicted(_) => "evicted",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Event {
    Span(Span),
    Brick { id: BrickId, step: BrickStep, at_ns: i64 },
    Count { counter: Counter, at_ns: i64, value: u64 },
}

impl Event {
    pub fn span(&self) -> Option<&Span> {
        match self {
            Event::Span(span) => Some(span),
            Event::Brick { .. } | Event::Count { .. } => None,
        }
    }
}
