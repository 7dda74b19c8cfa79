//! The same to the Tracy profiler, live: the loop's spans, a frame for each round, counters as plots.
//!
//! Compiled with the feature `tracy` alone. A program that has it listens from its start, on this machine alone, and
//! keeps nothing until a profiler connects. What loaders and queues did is told when it is over, for which Tracy has no
//! door: it stands in the trace's file.

use std::sync::OnceLock;

use tracy_client::{Client, PlotName, Span};

use crate::trace::event::Counter;

/// A span until it is dropped; on the thread that it began on.
pub struct Zone {
    _span: Span,
}

/// Begins a span.
pub fn zone(name: &'static str) -> Option<Zone> {
    let client = Client::running()?;
    Some(Zone { _span: client.span_alloc(Some(name), name, file!(), line!(), 0) })
}

/// A round has ended.
pub fn frame_end() {
    if let Some(client) = Client::running() {
        client.frame_mark();
    }
}

/// A counter has a new value.
pub fn plot(counter: Counter, value: u64) {
    // Tracy keeps names for good.
    static NAMES: OnceLock<[PlotName; Counter::ALL.len()]> = OnceLock::new();
    let names =
        NAMES.get_or_init(|| Counter::ALL.map(|of| PlotName::new_leak(of.name().to_owned())));
    if let Some(client) = Client::running() {
        client.plot(names[counter as usize], value as f64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_can_be_told_whether_or_not_a_profiler_listens() {
        let outer = zone("round");
        let inner = zone("wait");
        assert!(outer.is_some() && inner.is_some());
        drop(inner);
        drop(outer);
        frame_end();
        Counter::ALL.iter().for_each(|counter| plot(*counter, 2));
    }
}
