//! What a rendering cost and gave, as `--stats` writes it.

use serde::Serialize;

use crate::loading::LoadingStatistics;
use crate::render::paging::Paced;

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

/// Why the loop ended before every ray did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "reason")]
pub enum Unfinished {
    /// What was asked for did not come.
    Starved {
        /// Bricks on their way when patience ended.
        bricks: u64,
    },
    /// Every slot is in use, and rays want more.
    Full {
        /// Slots of all atlases.
        slots: u64,
    },
    /// Bricks came and went, and no ray moved.
    Restless {
        /// For so many rounds.
        rounds: u64,
    },
    /// A replayed recording ended, made where rays needed less.
    Apart,
}

impl std::fmt::Display for Unfinished {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Unfinished::Starved { bricks } => {
                write!(f, "nothing came while {bricks} bricks were on their way: see to the source")
            }
            Unfinished::Full { slots } => write!(
                f,
                "all {slots} slots are in use and more bricks are wanted: raise --atlas-mib or use --refine exact"
            ),
            Unfinished::Restless { rounds } => write!(
                f,
                "bricks came and went for {rounds} rounds and no ray moved: the order of loading stands still"
            ),
            Unfinished::Apart => f.write_str(
                "the recording, made on another device, ends here: rays of this one part from it by rounding",
            ),
        }
    }
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
    /// Why it is not converged, where the loop ended before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unfinished: Option<Unfinished>,
    /// Rays that wait for a brick.
    pub rays_waiting: u64,
    /// Bricks that rays went through in slots; 0 where nothing is paged.
    pub bricks_needed: u64,
    /// Bricks copied to the device.
    pub bricks_uploaded: u64,
    /// The same by level, 0 first.
    pub bricks_uploaded_by_level: Vec<u64>,
    /// Bytes of texels copied to the device; where nothing is paged, before the first view.
    pub bytes_uploaded: u64,
    /// Bytes of rounds' reports, requests and grants that the host read back; not the picture's.
    pub bytes_read_back: u64,
    /// Bricks that could not be read; drawn as nothing.
    pub bricks_failed: u64,
    /// What the first of them said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_failure: Option<String>,
    /// Bricks, of those looked at, that the source does not have.
    pub bricks_absent: u64,
    /// Bricks, of those looked at, that show nothing.
    pub bricks_hidden: u64,
    /// Bricks, of those looked at, of one value.
    pub bricks_constant: u64,
    /// Bricks of one value that travel, since the table of values is full.
    pub constants_overflow: u64,
    /// What loaders did; absent where nothing is paged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loading: Option<LoadingStatistics>,
    /// How rounds kept to their target; absent where they have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paced: Option<Paced>,
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

    /// What the picture lacks, as the end of a sentence.
    pub fn lacks(&self) -> Option<String> {
        if let Some(reason) = &self.unfinished {
            return Some(format!("is unfinished, {} rays wait: {reason}", self.rays_waiting));
        }
        (self.bricks_failed > 0).then(|| {
            let first = self.first_failure.as_ref();
            let first = first.map_or(String::new(), |why| format!(", the first: {why}"));
            format!("lacks {} bricks that could not be read{first}", self.bricks_failed)
        })
    }

    /// Milliseconds on the device in one pass.
    pub fn gpu_ms_of(&self, pass: &str) -> f64 {
        self.gpu_ms.iter().filter(|time| time.pass == pass).map(|time| time.ms).sum()
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
