//! A queue's ticks on the host's clock: by calibration where the device offers it, else estimated.

use std::time::{Duration, Instant};

use crate::gpu::{Calibration, DeviceClock, SubmitTimes};

/// Clocks drift apart (quartz: 1e-4 at most): a calibration this old is made anew.
const CALIBRATION_AGE_MAX: Duration = Duration::from_millis(100);
/// An estimate is kept for longer: a new one may be further off than the drift.
const ESTIMATE_AGE_MAX: Duration = Duration::from_secs(5);

/// Where one queue's clock stands beside the host's.
///
/// # Invariants
/// Without calibration the end of a submit is, at first, when the host saw its time point; a submit
/// that was seen sooner after its end moves the estimate, until the anchor is too old.
#[derive(Clone, Debug, Default)]
pub struct QueueClock {
    anchor: Option<Anchor>,
    calibrated: bool,
    error_ns_max: f64,
    /// How long after it was submitted the soonest submit of this estimate seems to have begun.
    slack_ns_min: Option<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    ticks: u64,
    host: Instant,
}

/// How device times came on the host's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockReport {
    /// By the device's calibration, else by when the host saw time points.
    pub calibrated: bool,
    /// Times may be wrong by so many nanoseconds: for a calibrated clock, how long reading it took and
    /// how far it was off when it was read again; for an estimate, how much earlier
    /// everything may have been without beginning before it was submitted.
    pub error_ns: f64,
}

impl QueueClock {
    /// Takes in a submit; `calibrate` is asked where the anchor is old.
    pub fn observe(
        &mut self,
        times: &SubmitTimes,
        calibrate: impl FnOnce() -> Option<Calibration>,
    ) {
        let (Some(first), Some(last)) = (times.steps.first(), times.steps.last()) else { return };
        let old = |anchor: Anchor| times.seen.saturating_duration_since(anchor.host);
        let age_max = if self.calibrated { CALIBRATION_AGE_MAX } else { ESTIMATE_AGE_MAX };
        let fresh = self.anchor.is_some_and(|anchor| old(anchor) < age_max);
        if fresh && self.calibrated {
            return;
        }
        if let Some(now) = calibrate() {
            let jump = self.anchor.filter(|_| self.calibrated).map_or(0.0, |anchor| {
                let expected = times.clock.ns_between(anchor.ticks, now.ticks);
                (now.host.saturating_duration_since(anchor.host).as_nanos() as f64 - expected).abs()
            });
            self.error_ns_max = self.error_ns_max.max(now.error.as_nanos() as f64 + jump);
            self.calibrated = true;
            self.anchor = Some(Anchor { ticks: now.ticks, host: now.host });
            return;
        }
        let seen = Anchor { ticks: last.end, host: times.seen };
        let too_late = |anchor: Anchor| {
            let ends_ns = times.clock.ns_between(anchor.ticks, last.end);
            ends_ns > signed_ns(anchor.host, times.seen)
        };
        if !fresh {
            let slack_ns = self.slack_ns_min.take().unwrap_or(0.0);
            self.error_ns_max = self.error_ns_max.max(slack_ns);
        }
        if !fresh || self.anchor.is_none_or(too_late) {
            self.anchor = Some(seen);
        }
        let slack_ns = self.ns_of(&times.clock, first.begin, times.submitted).unwrap_or(0.0).abs();
        self.slack_ns_min = Some(self.slack_ns_min.map_or(slack_ns, |least| least.min(slack_ns)));
    }

    /// Nanoseconds on the host's clock from `start` to a tick.
    pub fn ns_of(&self, clock: &DeviceClock, ticks: u64, start: Instant) -> Option<f64> {
        let anchor = self.anchor?;
        Some(signed_ns(start, anchor.host) + clock.ns_between(anchor.ticks, ticks))
    }

    /// How it did; nothing where no submit was observed.
    pub fn report(&self) -> Option<ClockReport> {
        let calibrated = self.calibrated;
        let error_ns = self.error_ns_max.max(self.slack_ns_min.unwrap_or(0.0));
        self.anchor.map(|_| ClockReport { calibrated, error_ns })
    }
}

/// Nanoseconds between two moments; negative where `to` is earlier.
pub fn signed_ns(from: Instant, to: Instant) -> f64 {
    match to.checked_duration_since(from) {
        Some(later) => later.as_nanos() as f64,
        None => -(from.duration_since(to).as_nanos() as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{RoleKind, StepTicks, TimePoint};

    const CLOCK: DeviceClock = DeviceClock { period_ns: 2.0, valid_bits: 40 };

    /// Microseconds after `start` on the host's clock; ticks on the device's.
    fn submit(start: Instant, submitted: u64, seen: u64, ticks: [u64; 2]) -> SubmitTimes {
        let at = |us| start + Duration::from_micros(us);
        SubmitTimes {
            point: TimePoint { role: RoleKind::Render, value: 1 },
            submitted: at(submitted),
            seen: at(seen),
            clock: CLOCK,
            steps: vec![StepTicks { label: "march", begin: ticks[0], end: ticks[1] }],
        }
    }

    #[test]
    fn an_estimate_takes_the_submit_that_was_seen_soonest() {
        let start = Instant::now();
        let mut clock = QueueClock::default();
        assert_eq!(clock.report(), None);
        // 1000 ticks are 2 us. The host sees the first end 50 us late, the second 10 us late.
        clock.observe(&submit(start, 100, 200, [50_000, 75_000]), || None);
        assert_eq!(clock.ns_of(&CLOCK, 75_000, start), Some(200_000.0));
        clock.observe(&submit(start, 300, 360, [170_000, 175_000]), || None);
        assert_eq!(clock.ns_of(&CLOCK, 175_000, start), Some(360_000.0));
        assert_eq!(clock.ns_of(&CLOCK, 75_000, start), Some(160_000.0));
        // One that is seen later moves nothing.
        clock.observe(&submit(start, 400, 900, [250_000, 255_000]), || None);
        assert_eq!(clock.ns_of(&CLOCK, 175_000, start), Some(360_000.0));
        let report = clock.report().expect("observed");
        assert!(!report.calibrated);
        assert_eq!(report.error_ns, 50_000.0, "the second began 50 us after it was submitted");
    }

    #[test]
    fn calibration_wins_and_its_drift_is_its_error() {
        let start = Instant::now();
        let host = |us| start + Duration::from_micros(us);
        let read = |ticks, us| {
            let error = Duration::from_nanos(300);
            move || Some(Calibration { ticks, host: host(us), error })
        };
        let mut clock = QueueClock::default();
        clock.observe(&submit(start, 100, 200, [50_000, 75_000]), read(100_000, 210));
        assert_eq!(clock.ns_of(&CLOCK, 75_000, start), Some(160_000.0));
        // Too soon to ask again.
        clock.observe(&submit(start, 300, 360, [1, 2]), || panic!("asked again"));
        clock.observe(&submit(start, 300, 300_210, [1, 2]), read(150_100_000, 300_211));
        assert_eq!(clock.report(), Some(ClockReport { calibrated: true, error_ns: 1300.0 }));
    }
}
