//! What loading did, in numbers.

use serde::Serialize;

/// Counts since the start; `cache_bytes` is of now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LoadingStatistics {
    /// Reads handed to loaders, retries included.
    pub reads: u64,
    /// Voxel bytes that reads gave, those of old epochs included.
    pub bytes_read: u64,
    /// Bricks delivered without a read.
    pub cache_hits: u64,
    /// Voxel bytes in the cache.
    pub cache_bytes: u64,
    /// The most that `cache_bytes` ever was.
    pub cache_bytes_max: u64,
    /// Wishes dropped because a newer list lacked them.
    pub stale: u64,
    /// Bricks delivered as failed.
    pub failed: u64,
    /// Reads handed out again after an error.
    pub retries: u64,
    /// Wishes left out of a list because the brick had failed in this epoch.
    pub wishes_refused: u64,
    /// Wishes left out because a list was too long: those of the last ranks.
    pub wishes_overflow: u64,
    /// Blocks surveyed, repeats for a new epoch included.
    pub surveys: u64,
    /// Surveys left out because too many waited; they may be asked for again.
    pub surveys_overflow: u64,
    /// Reads and surveys thrown away because their source had changed since.
    pub dropped_old_epoch: u64,
}
