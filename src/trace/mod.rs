//! Recording of what happened when, and the file that shows it.
//!
//! A [`Trace`] is filled beside drawing: spans of the host, what loaders did, passes and copies with
//! the device's own times, counters. [`Trace::write`] makes a file of it that Perfetto and
//! chrome://tracing open. Nobody who draws without a trace pays for it: it is an `Option` that is none.
//!
//! # Invariants
//! - Every event is of one fixed size and there are at most [`TraceOptions::events_max`]; what does not
//!   fit is counted, and the file says so.
//! - Spans of one track are nested or follow each other, and none is negative: what was cut
//!   ([`nest`], [`follow_each_other`]) is counted, and the file says so.
//!
//! # Units
//! Nanoseconds since the trace began, on the host's clock; the file has microseconds, as its format
//! wants.

mod chrome;
mod clip;
mod clock;
mod event;
mod flows;
mod reading;
mod recording;
pub mod summary;
pub mod timeline;
mod timeline_svg;
#[cfg(feature = "tracy")]
mod tracy;

pub use clip::{Clipped, follow_each_other, nest};
pub use clock::{ClockReport, QueueClock};
pub use event::{BrickStep, Counter, Details, Span, Track};
pub use recording::{Guard, Trace, TraceOptions, TraceSize};
