//! Repeated measurements as one figure, and whose time they count.

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::gpu::Gpu;
use crate::study::clock::{Clock, median};

/// The middle of several repetitions, and how far they lie apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// The middle one; of an even number, the lower.
    pub median: f64,
    /// The smallest.
    pub least: f64,
    /// The greatest.
    pub most: f64,
}

impl Spread {
    /// Of these values; NaN of none.
    pub fn of(values: &[f64]) -> Spread {
        Spread {
            median: median(values),
            least: values.iter().copied().fold(f64::NAN, f64::min),
            most: values.iter().copied().fold(f64::NAN, f64::max),
        }
    }

    /// Of the ratios of values that were measured in the same turns.
    pub fn of_ratios(above: &[f64], below: &[f64]) -> Spread {
        let ratios: Vec<f64> =
            above.iter().zip(below).map(|(above, below)| above / below).collect();
        Spread::of(&ratios)
    }
}

/// Whose time counts: processor time of this process where the device is a CPU and the system tells,
/// since other work on the machine does not change it.
#[derive(Clone, Copy, Debug)]
pub struct Timer {
    processor: bool,
}

/// Milliseconds that something took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Took {
    /// Of the clock that counts.
    pub ms: f64,
    /// On the wall.
    pub wall_ms: f64,
}

impl Timer {
    /// The clock for a device.
    pub fn of(gpu: &Gpu) -> Timer {
        let told = Clock::start().elapsed().cpu_ns.is_some();
        Timer { processor: gpu.facts().kind == "cpu" && told }
    }

    /// Whether it counts processor time.
    pub fn counts_processor(self) -> bool {
        self.processor
    }

    /// "processor" or `otherwise`.
    pub fn name(self, otherwise: &'static str) -> &'static str {
        if self.processor { "processor" } else { otherwise }
    }

    /// Measures `run`.
    ///
    /// # Errors
    /// Its own.
    pub fn time<T>(self, run: impl FnOnce() -> Result<T>) -> Result<(T, Took)> {
        let clock = Clock::start();
        let value = run()?;
        let elapsed = clock.elapsed();
        let wall_ms = elapsed.wall_ns * 1e-6;
        let ms = match elapsed.cpu_ns {
            Some(cpu_ns) if self.processor => cpu_ns * 1e-6,
            _ => wall_ms,
        };
        Ok((value, Took { ms, wall_ms }))
    }
}

impl std::ops::AddAssign for Took {
    fn add_assign(&mut self, other: Took) {
        self.ms += other.ms;
        self.wall_ms += other.wall_ms;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_pair_what_was_measured_together() {
        let spread = Spread::of_ratios(&[2.0, 30.0, 8.0], &[1.0, 10.0, 2.0]);
        assert_eq!(spread, Spread { median: 3.0, least: 2.0, most: 4.0 });
        assert!(Spread::of(&[]).median.is_nan());
    }
}
