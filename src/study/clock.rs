//! Time that a measurement took.

use std::time::{Duration, Instant};

/// Wall time, and on Linux also the processor time of all threads of this process: on a device that
/// computes on the CPU, the latter does not change when the machine has other work.
#[derive(Clone, Copy)]
pub struct Clock {
    wall: Instant,
    cpu_ns: Option<u64>,
}

/// What a [`Clock`] measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elapsed {
    /// Nanoseconds on the wall.
    pub wall_ns: f64,
    /// Nanoseconds of processor time over all threads, where the system tells.
    pub cpu_ns: Option<f64>,
}

impl Clock {
    /// Starts now.
    pub fn start() -> Clock {
        let cpu_ns = cpu_ns();
        Clock { wall: Instant::now(), cpu_ns }
    }

    /// Since the start.
    pub fn elapsed(&self) -> Elapsed {
        let wall_ns = self.wall.elapsed().as_nanos() as f64;
        let cpu_ns = match (self.cpu_ns, cpu_ns()) {
            (Some(before), Some(now)) => Some(now.saturating_sub(before) as f64),
            _ => None,
        };
        Elapsed { wall_ns, cpu_ns }
    }
}

/// Time on a processor, summed over the threads that live now.
fn cpu_ns() -> Option<u64> {
    // The system brings a thread's time up to date when it stops running, else every few milliseconds.
    std::thread::sleep(Duration::from_micros(1));
    let mut sum = 0;
    for task in std::fs::read_dir("/proc/self/task").ok()? {
        let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        sum += text.split_whitespace().next()?.parse::<u64>().ok()?;
    }
    Some(sum)
}

/// The middle value; of an even number, the lower one.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().saturating_sub(1) / 2).copied().unwrap_or(f64::NAN)
}
