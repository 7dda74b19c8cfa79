//! How many threads a command works with.

use crate::error::{Error, Result};

/// One thread per core.
pub fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Starts a rayon pool for a command.
pub fn pool(jobs: Option<u32>) -> Result<rayon::ThreadPool> {
    let jobs = jobs.map_or_else(all_cores, |jobs| jobs as usize);
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build()
        .map_err(|why| Error::machine(format!("cannot start {jobs} jobs: {why}")))
}
