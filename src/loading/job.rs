//! What a loader does: one read or one survey, whatever the source does meanwhile.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Exit, Result};
use crate::loading::{Block, DoneWork, Moments};
use crate::source::{BrickEntry, BrickSource, read_checked_telling};
use crate::volume::{BrickId, ValueRange};

/// The sources by volume.
pub type Sources = Arc<[Arc<dyn BrickSource>]>;

/// What somebody learns of a brick from its voxels, as `BrickSource::read` gives them: ranges of its leaves.
/// Loaders call it, since they have the voxels at hand and time.
pub type Inspect = Arc<dyn Fn(BrickId, &[u8]) -> Vec<ValueRange> + Send + Sync>;

/// A brick that a loader has read.
pub struct Read {
    /// Its voxels.
    pub bytes: Arc<[u8]>,
    /// What [`Inspect`] says of them, where somebody asks.
    pub leaf_ranges: Option<Vec<ValueRange>>,
}

/// Work for a loader.
#[derive(Clone, Copy, Debug)]
pub enum Job {
    /// Voxels of a brick.
    Read(BrickId),
    /// Entries of a block's bricks.
    Survey(Block),
}

/// What became of a job.
pub enum Arrival {
    /// Of [`Job::Read`].
    Read(BrickId, Result<Read>),
    /// Of [`Job::Survey`].
    Survey(Block, Vec<(BrickId, Result<BrickEntry>)>),
}

impl Arrival {
    /// What was done, without what came of it.
    pub fn work(&self) -> DoneWork {
        match self {
            Arrival::Read(id, read) => {
                DoneWork::Read { id: *id, bytes: read.as_ref().ok().map(|r| r.bytes.len() as u64) }
            }
            Arrival::Survey(block, entries) => {
                DoneWork::Survey { block: *block, bricks: entries.len() as u64 }
            }
        }
    }
}

impl Job {
    /// Does it. `buffer` keeps its memory between reads, so that a brick is allocated once, at its
    /// own size, which is what the cache counts. `moments` are taken where there is a place for them.
    pub fn run(
        self,
        sources: &[Arc<dyn BrickSource>],
        inspect: Option<&Inspect>,
        buffer: &mut Vec<u8>,
        mut moments: Option<&mut Moments>,
    ) -> Arrival {
        match self {
            Job::Read(id) => {
                let read = guarded(id, "source", || {
                    let source = source_of(sources, id)?;
                    let mut fetched = || {
                        if let Some(moments) = moments.as_deref_mut() {
                            moments.decode = Some(Instant::now());
                        }
                    };
                    read_checked_telling(source, id, buffer, &mut fetched)
                });
                let read = read.and_then(|()| {
                    if let Some(moments) = moments.filter(|_| inspect.is_some()) {
                        moments.inspect = Some(Instant::now());
                    }
                    let leaf_ranges = inspect
                        .map(|inspect| guarded(id, "inspection", || Ok(inspect(id, buffer))));
                    Ok(Read {
                        bytes: Arc::from(&buffer[..]),
                        leaf_ranges: leaf_ranges.transpose()?,
                    })
                });
                if read.is_err() {
                    // A source that came back long must not leave a long buffer behind.
                    *buffer = Vec::new();
                }
                Arrival::Read(id, read)
            }
            Job::Survey(block) => Arrival::Survey(block, survey(sources, block)),
        }
    }
}

fn survey(sources: &[Arc<dyn BrickSource>], block: Block) -> Vec<(BrickId, Result<BrickEntry>)> {
    let first = block.first();
    let grid = guarded(first, "source", || {
        let description = source_of(sources, first)?.description();
        let grid = description.grid(block.level).filter(|_| description.has(first));
        grid.ok_or_else(|| {
            Error::input(format!("volume \"{}\" has no {first} to survey", description.name))
        })
    });
    match grid {
        Ok(grid) => {
            let entry = |id| guarded(id, "source", || source_of(sources, id)?.entry(id));
            block.bricks(grid).map(|id| (id, entry(id))).collect()
        }
        Err(why) => vec![(first, Err(why))],
    }
}

fn source_of(sources: &[Arc<dyn BrickSource>], id: BrickId) -> Result<&dyn BrickSource> {
    sources.get(usize::from(id.volume)).map(|source| &**source).ok_or_else(|| {
        let (volume, count) = (id.volume, sources.len());
        Error::input(format!("{id} is wished of volume {volume} where there are {count}"))
    })
}

/// A panic of the source, or of `whose` work it is, as an error: it costs a brick, not a loader.
fn guarded<T>(id: BrickId, whose: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    // What the work leaves half done is its buffer, which the caller throws away.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let message = format!("{id}: its {whose} panicked: {}", said(&*payload));
        Err(Error { exit: Exit::Bug, message })
    })
}

fn said(payload: &(dyn Any + Send)) -> &str {
    match payload.downcast_ref::<String>() {
        Some(text) => text,
        None => payload.downcast_ref::<&str>().unwrap_or(&"without a word"),
    }
}
