//! What loaders did and when, as plain data, for whoever wants to know.

use std::time::Instant;

use crate::loading::Block;
use crate::volume::BrickId;

/// Jobs kept at most until they are taken; more are counted.
const KEPT_MAX: usize = 1 << 16;

/// One read or survey that came to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DoneJob {
    /// Number of the loader, from 0.
    pub loader: usize,
    /// When its parts began.
    pub moments: Moments,
    /// When it had ended.
    pub end: Instant,
    /// What it was.
    pub work: DoneWork,
}

/// When the parts of a job began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moments {
    /// The job: a read or a survey.
    pub begin: Instant,
    /// What was read is decoded and checked from here on; nothing where the source does not tell it apart.
    pub decode: Option<Instant>,
    /// [`Inspect`](crate::loading::Inspect) looks at the voxels from here on; nothing where nobody does.
    pub inspect: Option<Instant>,
}

impl Moments {
    /// Of a job that begins now.
    pub fn begin() -> Moments {
        Moments { begin: Instant::now(), decode: None, inspect: None }
    }
}

impl DoneJob {
    /// Its parts by name, one after the other: from when to when.
    pub fn parts(&self) -> impl Iterator<Item = (&'static str, [Instant; 2])> {
        let Moments { begin, decode, inspect } = self.moments;
        let first = match self.work {
            DoneWork::Read { .. } => "read",
            DoneWork::Survey { .. } => "survey",
        };
        let parts = [
            Some((first, [begin, decode.or(inspect).unwrap_or(self.end)])),
            decode.map(|decode| ("decode", [decode, inspect.unwrap_or(self.end)])),
            inspect.map(|inspect| ("inspect", [inspect, self.end])),
        ];
        parts.into_iter().flatten()
    }
}

/// What a loader did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DoneWork {
    /// It read a brick's voxels.
    Read {
        /// Which.
        id: BrickId,
        /// Voxel bytes; nothing where the read failed.
        bytes: Option<u64>,
    },
    /// It asked what is known of a block's bricks.
    Survey {
        /// Which.
        block: Block,
        /// Bricks in it.
        bricks: u64,
    },
}

/// Jobs that nobody has taken yet.
#[derive(Debug, Default)]
pub struct DoneJobs {
    kept: Vec<DoneJob>,
    dropped: u64,
}

impl DoneJobs {
    /// Keeps one.
    pub fn push(&mut self, job: DoneJob) {
        if self.kept.len() < KEPT_MAX {
            self.kept.push(job);
        } else {
            self.dropped += 1;
        }
    }

    /// Gives what is kept, and how many were not.
    pub fn take(&mut self) -> (Vec<DoneJob>, u64) {
        (std::mem::take(&mut self.kept), std::mem::take(&mut self.dropped))
    }
}
