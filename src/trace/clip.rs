//! Spans of one track made fit to be shown on one line.
//!
//! Hosts and loaders nest: a span that begins within another ends with it at the latest. Steps of a
//! queue follow each other: a queue comes to a step (its first timestamp) while the one before still
//! runs, so a step begins when the one before has ended.

use crate::trace::Span;

/// How much was cut off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clipped {
    /// Spans that were cut.
    pub spans: u64,
    /// Nanoseconds, all together.
    pub ns: u64,
}

impl Clipped {
    fn cut(&mut self, ns: i64) {
        if ns > 0 {
            self.spans += 1;
            self.ns += ns.unsigned_abs();
        }
    }
}

/// Sorts a track's spans, and cuts what outlasts the span that it began in.
pub fn nest(spans: &mut [Span]) -> Clipped {
    let mut clipped = Clipped::default();
    straighten(spans, &mut clipped);
    // Of two that begin together, the longer one holds the other.
    spans.sort_by_key(|span| (span.begin_ns, std::cmp::Reverse(span.end_ns)));
    let mut open: Vec<i64> = Vec::new();
    for span in spans {
        while open.last().is_some_and(|end| *end <= span.begin_ns) {
            open.pop();
        }
        if let Some(end) = open.last() {
            clipped.cut(span.end_ns - end);
            span.end_ns = span.end_ns.min(*end);
        }
        open.push(span.end_ns);
    }
    clipped
}

/// Sorts a track's spans by their ends, and cuts what begins before the one before has ended.
pub fn follow_each_other(spans: &mut [Span]) -> Clipped {
    let mut clipped = Clipped::default();
    straighten(spans, &mut clipped);
    spans.sort_by_key(|span| (span.end_ns, span.begin_ns));
    let mut before = i64::MIN;
    for span in spans {
        if span.begin_ns < before {
            clipped.cut(before - span.begin_ns);
            span.begin_ns = before;
        }
        before = span.end_ns;
    }
    clipped
}

/// A span that ends before it begins took no time.
fn straighten(spans: &mut [Span], clipped: &mut Clipped) {
    for span in spans {
        clipped.cut(span.begin_ns - span.end_ns);
        span.end_ns = span.end_ns.max(span.begin_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{Details, Track};

    fn spans(of: &[(i64, i64)]) -> Vec<Span> {
        let span = |&(begin_ns, end_ns): &(i64, i64)| Span {
            track: Track::Host,
            name: "span",
            begin_ns,
            end_ns,
            details: Details::None,
        };
        of.iter().map(span).collect()
    }

    fn times(spans: &[Span]) -> Vec<(i64, i64)> {
        spans.iter().map(|span| (span.begin_ns, span.end_ns)).collect()
    }

    #[test]
    fn what_is_nested_or_in_sequence_stays() {
        let good = [(0, 10), (0, 4), (1, 2), (4, 10), (10, 12), (20, 20)];
        let mut shuffled = spans(&[good[4], good[3], good[1], good[5], good[0], good[2]]);
        assert_eq!(nest(&mut shuffled), Clipped::default());
        assert_eq!(times(&shuffled), good);
    }

    #[test]
    fn a_span_ends_with_the_one_it_began_in() {
        let mut crossing = spans(&[(0, 10), (5, 15), (8, 20), (15, 16)]);
        assert_eq!(nest(&mut crossing), Clipped { spans: 2, ns: 15 });
        assert_eq!(times(&crossing), [(0, 10), (5, 10), (8, 10), (15, 16)]);
    }

    #[test]
    fn nothing_is_negative() {
        for clip in [nest, follow_each_other] {
            let mut negative = spans(&[(5, 3)]);
            assert_eq!(clip(&mut negative), Clipped { spans: 1, ns: 2 });
            assert_eq!(times(&negative), [(5, 5)]);
        }
    }

    #[test]
    fn a_step_begins_when_the_one_before_has_ended() {
        let mut steps = spans(&[(0, 10), (2, 14), (14, 20), (3, 3)]);
        assert_eq!(follow_each_other(&mut steps), Clipped { spans: 2, ns: 11 });
        assert_eq!(times(&steps), [(3, 3), (3, 10), (10, 14), (14, 20)]);
    }
}
