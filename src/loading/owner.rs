//! The owner's side: wishes in, deliveries out, and the loop between them.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::loading::cache::Cache;
use crate::loading::done::DoneJobs;
use crate::loading::job::{Arrival, Inspect, Job, Read};
use crate::loading::loaders::Loaders;
use crate::loading::surveys::Surveys;
use crate::loading::wishes::{Place, WishList};
use crate::loading::{Block, Delivery, DoneJob, LoadingLimits, LoadingStatistics, Wish};
use crate::source::{BrickEntry, BrickSource};
use crate::volume::BrickId;

/// Loads wished bricks; see the [room](crate::loading) for what it keeps to.
///
/// Work goes to loaders within [`wish`](Loading::wish), [`survey`](Loading::survey) and
/// [`next`](Loading::next), so an owner who waits for bricks calls `next`.
///
/// Dropping it tells the loaders to stop and joins them. One that is stuck inside its source for more
/// than [`PATIENCE`](crate::loading::PATIENCE) is left behind, and ends when the source lets it go.
pub struct Loading {
    limits: LoadingLimits,
    wishes: WishList,
    surveys: Surveys,
    cache: Cache,
    /// Reads from the hand-over until the arrival was taken.
    reading: HashMap<BrickId, Reading>,
    /// In this epoch, since failures were last forgotten.
    failed: HashSet<BrickId>,
    loaders: Loaders,
    /// All but what the cache counts itself.
    counts: LoadingStatistics,
    /// Where somebody wants to know.
    done: Option<DoneJobs>,
}

struct Reading {
    /// Reads that failed before this one.
    failures: u32,
    /// Begun before the source changed.
    old: bool,
}

impl Loading {
    /// Starts the loaders. A brick id's volume is the index of its source.
    ///
    /// # Errors
    /// When the limits allow no work, or the machine gives no threads.
    pub fn new(sources: Vec<Arc<dyn BrickSource>>, limits: LoadingLimits) -> Result<Loading> {
        Loading::start(sources, limits, None)
    }

    /// The same with loaders that show every brick they read to `inspect`; what it says comes with the
    /// brick. Where it panics the read has failed.
    ///
    /// # Errors
    /// As [`Loading::new`].
    pub fn inspecting(
        sources: Vec<Arc<dyn BrickSource>>,
        limits: LoadingLimits,
        inspect: Inspect,
    ) -> Result<Loading> {
        Loading::start(sources, limits, Some(inspect))
    }

    fn start(
        sources: Vec<Arc<dyn BrickSource>>,
        limits: LoadingLimits,
        inspect: Option<Inspect>,
    ) -> Result<Loading> {
        limits.check()?;
        Ok(Loading {
            limits,
            wishes: WishList::default(),
            surveys: Surveys::default(),
            cache: Cache::new(limits.ram_bytes),
            reading: HashMap::new(),
            failed: HashSet::new(),
            loaders: Loaders::start(sources.into(), inspect, &limits)?,
            counts: LoadingStatistics::default(),
            done: None,
        })
    }

    /// Replaces the wish list. Of duplicates the smallest rank counts; a brick that is already being
    /// read, or read and not taken, is not read again. Wishes that the new list lacks are dropped as
    /// stale unless a loader has them: those are delivered once if their read succeeds or was the last
    /// attempt, and dropped as stale if not. Failed bricks and those beyond the bound are left out.
    pub fn wish(&mut self, wishes: &[Wish]) {
        let (failed, reading, cache) = (&self.failed, &self.reading, &self.cache);
        let left_out = self.wishes.replace(wishes, self.limits.wishes_max, |id| {
            if failed.contains(&id) {
                None
            } else if reading.contains_key(&id) {
                Some(Place::Reading)
            } else if cache.has(id) {
                Some(Place::Cached)
            } else {
                Some(Place::Unread)
            }
        });
        self.counts.stale += left_out.stale;
        self.counts.wishes_overflow += left_out.overflow;
        self.counts.wishes_refused += left_out.refused;
        self.hand_out();
    }

    /// Asks for what is known of blocks: each is delivered once an epoch, in the order asked, and goes
    /// before reads. One with an entry that could not be had may be asked for again after
    /// [`Loading::forget_failures`].
    pub fn survey(&mut self, blocks: &[Block]) {
        for &block in blocks {
            if !self.surveys.ask(block, self.limits.wishes_max) {
                self.counts.surveys_overflow += 1;
            }
        }
        self.hand_out();
    }

    /// The next delivery: wished bricks that are in the cache, by rank, then arrivals as they come.
    /// Nothing when the time has passed, or at once when nothing is under way.
    pub fn next(&mut self, timeout: Duration) -> Option<Delivery> {
        // A timeout beyond the end of time is none.
        let deadline = Instant::now().checked_add(timeout);
        loop {
            self.hand_out();
            if let Some(hit) = self.take_cached() {
                return Some(hit);
            }
            if self.outstanding() == 0 {
                return None;
            }
            // Whoever pauses alone must wake this loop: no arrival will.
            let due = self.wishes.first_due();
            let until = [deadline, due].into_iter().flatten().min();
            match self.loaders.next(until) {
                Some((arrival, job)) => {
                    if let (Some(done), Some(job)) = (&mut self.done, job) {
                        done.push(job);
                    }
                    let delivery = self.settle(arrival);
                    if delivery.is_some() {
                        self.hand_out();
                        return delivery;
                    }
                }
                None if deadline.is_some_and(|deadline| deadline <= Instant::now()) => return None,
                // Without an end of the wait there is no arrival because there is no loader.
                None if until.is_none() => return None,
                None => {}
            }
        }
    }

    /// Wishes, reads and surveys that have not come to their end; a read of an old epoch has when it
    /// came back.
    pub fn outstanding(&self) -> usize {
        let unlisted = self.reading.keys().filter(|&&id| !self.wishes.has(id)).count();
        self.wishes.len() + unlisted + self.surveys.outstanding()
    }

    /// Failed bricks may be wished again: their source has recovered.
    pub fn forget_failures(&mut self) {
        self.failed.clear();
        self.surveys.forget_failures();
    }

    /// Surveys of a channel may be asked for again, since what was made of them is forgotten. The source
    /// is the same: its bricks in the cache stay.
    pub fn forget_surveys(&mut self, volume: u16, channel: u16) {
        self.surveys.forget_channel(volume, channel);
    }

    /// The source of a volume has changed. Its bricks in the cache are dropped, its failures and
    /// surveys forgotten; what was read before is never delivered. What is still wished or asked for is
    /// read anew, after the old read has come back.
    pub fn new_epoch(&mut self, volume: u16) {
        self.cache.forget(volume);
        self.failed.retain(|id| id.volume != volume);
        self.wishes.start_over(volume);
        self.surveys.new_epoch(volume);
        for (id, reading) in &mut self.reading {
            reading.old |= id.volume == volume;
        }
        self.hand_out();
    }

    /// From now on keeps what loaders did and when, until it is taken.
    pub fn keep_jobs(&mut self) {
        self.done.get_or_insert_default();
        self.loaders.watch();
    }

    /// Jobs whose arrivals were taken in since the last call, and how many more there were.
    pub fn take_jobs(&mut self) -> (Vec<DoneJob>, u64) {
        self.done.as_mut().map(DoneJobs::take).unwrap_or_default()
    }

    /// Reads that loaders have, or whose arrivals were not taken in yet.
    pub fn reads_under_way(&self) -> usize {
        self.reading.len()
    }

    /// What was done so far.
    pub fn statistics(&self) -> LoadingStatistics {
        LoadingStatistics {
            cache_bytes: self.cache.bytes(),
            cache_bytes_max: self.cache.peak_bytes(),
            ..self.counts
        }
    }

    /// The best wish that the cache fulfils.
    fn take_cached(&mut self) -> Option<Delivery> {
        let id = self.wishes.first_cached()?;
        // Only arrivals drive bricks out, and they are taken in when no wish stands here.
        let bytes = self.cache.get(id).expect("the cache has what it was wished from");
        self.wishes.remove(id);
        self.counts.cache_hits += 1;
        Some(Delivery::Brick { id, bytes, from_cache: true, leaf_ranges: None })
    }

    /// Gives loaders what they may have: surveys, then wishes by rank.
    fn hand_out(&mut self) {
        self.wishes.wake(Instant::now());
        while self.reading.len() + self.surveys.under_way() < self.loaders.jobs_max() {
            if let Some(block) = self.surveys.first() {
                if !self.loaders.hand(Job::Survey(block)) {
                    return;
                }
                self.surveys.handed();
            } else if let Some((id, failures)) = self.wishes.first_unread() {
                if !self.loaders.hand(Job::Read(id)) {
                    return;
                }
                self.wishes.set(id, Place::Reading);
                self.reading.insert(id, Reading { failures, old: false });
                self.counts.reads += 1;
                self.counts.retries += u64::from(failures > 0);
            } else {
                return;
            }
        }
    }

    /// Takes an arrival in; what of it is delivered.
    fn settle(&mut self, arrival: Arrival) -> Option<Delivery> {
        match arrival {
            Arrival::Read(id, read) => self.settle_read(id, read),
            Arrival::Survey(block, entries) => self.settle_survey(block, entries),
        }
    }

    fn settle_read(&mut self, id: BrickId, read: Result<Read>) -> Option<Delivery> {
        let Reading { failures, old } = self.reading.remove(&id)?;
        self.counts.bytes_read += read.as_ref().map_or(0, |read| read.bytes.len() as u64);
        if old {
            self.counts.dropped_old_epoch += 1;
            self.wishes.set(id, Place::Unread);
            return None;
        }
        match read {
            Ok(Read { bytes, leaf_ranges }) => {
                self.cache.insert(id, Arc::clone(&bytes));
                self.wishes.remove(id);
                Some(Delivery::Brick { id, bytes, from_cache: false, leaf_ranges })
            }
            Err(why) => self.settle_failure(id, failures.saturating_add(1), why),
        }
    }

    fn settle_failure(&mut self, id: BrickId, failures: u32, why: Error) -> Option<Delivery> {
        if failures >= self.limits.attempts {
            self.wishes.remove(id);
            self.failed.insert(id);
            self.counts.failed += 1;
            return Some(Delivery::Failed { id, why });
        }
        let until = Instant::now() + self.limits.pause(failures);
        if !self.wishes.pause(id, failures, until) {
            self.counts.stale += 1;
        }
        None
    }

    fn settle_survey(
        &mut self,
        block: Block,
        entries: Vec<(BrickId, Result<BrickEntry>)>,
    ) -> Option<Delivery> {
        self.counts.surveys += 1;
        let whole = entries.iter().all(|(_, entry)| entry.is_ok());
        if self.surveys.arrived(block, whole) {
            return Some(Delivery::Surveyed { block, entries });
        }
        self.counts.dropped_old_epoch += 1;
        None
    }
}
