//! What a rendering cost and gave, as `--stats` writes it.

use serde::Serialize;

/// Time of one pass on the device, summed over all its dispatches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassTime {
    /// The pass.
    pub pass: String,
    /// Milliseconds on the device.
    pub ms: f64,
    /// Dispatches or copies.
    pub count: u64,
}

/// Statistics of one view.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// From the first recording to the finished picture in host memory.
    pub wall_ms: f64,
    /// Per pass; empty where the queue has no timestamps.
    pub gpu_ms: Vec<PassTime>,
    /// Samples taken over all rays.
    pub samples: u64,
    /// Rounds of the paging loop; 1 where nothing is paged.
    pub rounds: u64,
    /// Whether no ray waits for a brick.
    pub converged: bool,
    /// Bricks that the picture depends on; 0 where nothing is paged.
    pub bricks_needed: u64,
    /// Bricks copied to the device.
    pub bricks_uploaded: u64,
    /// Bytes of voxels copied to the device for this renderer, before its first view.
    pub bytes_uploaded: u64,
    /// Bricks that could not be read.
    pub bricks_failed: u64,
    /// Device memory allocated, bytes.
    pub device_bytes: u64,
    /// Most resident memory of this process so far, bytes; 0 where the system does not say.
    pub peak_rss_bytes: u64,
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Messages of the validation layers since the instance was made.
    pub validation_messages: u64,
}

impl Statistics {
    /// Adds a measured step.
    pub fn add_step(&mut self, pass: &str, ms: f64) {
        match self.gpu_ms.iter_mut().find(|time| time.pass == pass) {
            Some(time) => {
                time.ms += ms;
                time.count += 1;
            }
            None => self.gpu_ms.push(PassTime { pass: pass.to_owned(), ms, count: 1 }),
        }
    }

    /// Milliseconds on the device over all passes.
    pub fn gpu_ms_total(&self) -> f64 {
        self.gpu_ms.iter().map(|time| time.ms).sum()
    }
}

/// The most memory this process has had resident, where Linux tells.
pub fn peak_rss_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").trim().parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
