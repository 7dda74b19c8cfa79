//! How much the room may use, and how long it tries.

use std::time::Duration;

use crate::error::{Error, Result};

/// Loader threads at most: far more than help any disk.
pub const LOADERS_MAX: usize = 256;
/// No pause before a retry is longer, however often a brick failed.
pub const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Bounds of a [`Loading`](crate::loading::Loading).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadingLimits {
    /// Voxels that the cache holds at most; 0 keeps nothing.
    pub ram_bytes: u64,
    /// Loader threads, 1 to [`LOADERS_MAX`].
    pub loaders: usize,
    /// Reads of a brick before it counts as failed, at least 1.
    pub attempts: u32,
    /// Pause after the first failed read; it doubles with each further one, up to [`PAUSE_MAX`].
    pub retry_after: Duration,
    /// Wishes, and surveys, that may wait at once, at least 1.
    pub wishes_max: usize,
    /// Whether loader threads stand back behind others where there are fewer cores than work, as far as the system
    /// lets them.
    pub yielding: bool,
}

impl Default for LoadingLimits {
    fn default() -> LoadingLimits {
        LoadingLimits {
            ram_bytes: 1 << 30,
            loaders: 4,
            attempts: 3,
            retry_after: Duration::from_millis(20),
            wishes_max: 1 << 16,
            yielding: false,
        }
    }
}

impl LoadingLimits {
    /// Refuses limits under which nothing could be loaded.
    pub(super) fn check(&self) -> Result<()> {
        if !(1..=LOADERS_MAX).contains(&self.loaders) {
            return Err(Error::arguments(format!(
                "loading: loaders must be from 1 to {LOADERS_MAX}, got {}",
                self.loaders
            )));
        }
        if self.attempts == 0 {
            return Err(Error::arguments("loading: attempts must be at least 1, got 0"));
        }
        if self.wishes_max == 0 {
            return Err(Error::arguments("loading: wishes_max must be at least 1, got 0"));
        }
        Ok(())
    }

    /// How long to wait after the `failures`-th failed read of a brick, counted from 1.
    pub(super) fn pause(&self, failures: u32) -> Duration {
        let doublings = failures.saturating_sub(1).min(31);
        self.retry_after.saturating_mul(1 << doublings).min(PAUSE_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_their_bound() {
        let ms = Duration::from_millis;
        let limits = LoadingLimits { retry_after: ms(10), ..LoadingLimits::default() };
        assert_eq!([1, 2, 3, 4].map(|n| limits.pause(n)), [ms(10), ms(20), ms(40), ms(80)]);
        assert_eq!(limits.pause(u32::MAX), PAUSE_MAX);
        let limits = LoadingLimits { retry_after: Duration::MAX, ..limits };
        assert_eq!(limits.pause(40), PAUSE_MAX);
        let limits = LoadingLimits { retry_after: Duration::ZERO, ..limits };
        assert_eq!(limits.pause(40), Duration::ZERO);
    }

    #[test]
    fn useless_limits_are_refused() {
        let good = LoadingLimits::default();
        assert_eq!(good.check(), Ok(()));
        for (bad, word) in [
            (LoadingLimits { loaders: 0, ..good }, "loaders"),
            (LoadingLimits { loaders: usize::MAX, ..good }, "loaders"),
            (LoadingLimits { attempts: 0, ..good }, "attempts"),
            (LoadingLimits { wishes_max: 0, ..good }, "wishes_max"),
        ] {
            assert!(bad.check().is_err_and(|why| why.message.contains(word)), "{bad:?}");
        }
    }
}
