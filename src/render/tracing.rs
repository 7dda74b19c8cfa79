//! What drawing tells a trace, where there is one: one line in the loop for each of these.

use std::sync::Arc;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::{Staging, TimePoint};
use crate::loading::DoneWork;
use crate::render::paging::{Paged, StagedBrick, slots_by_atlas};
use crate::render::renderer::Renderer;
use crate::render::statistics::Statistics;
use crate::residency::{OfAtlas, Report};
use crate::trace::{BrickStep, Counter, Details, Guard, Trace, Track};
use crate::twins::publish::Update;
use crate::volume::BrickId;

impl Renderer {
    /// What the host does until this is dropped.
    pub(super) fn span(&self, name: &'static str) -> Option<Guard> {
        self.trace.as_ref().map(|trace| trace.begin(name, Details::None))
    }

    /// A round, until this is dropped.
    pub(super) fn round_span(&self) -> Option<Guard> {
        self.trace.as_ref().map(Trace::begin_round)
    }

    /// Adds the times of the last submit's passes, waiting for its end; each submit counts once.
    pub(super) fn add_times(&self, statistics: &mut Statistics) {
        // A lost device is met by whoever waits next.
        let taken = self.timestamps.as_ref().and_then(|timestamps| timestamps.take().ok());
        let Some(times) = taken.flatten() else { return };
        for (pass, ms) in times.step_ms() {
            statistics.add_step(pass, ms);
            if pass.starts_with("march") {
                self.submit_bound.learn(ms);
            }
        }
        if let Some(trace) = &self.trace {
            trace.steps(&times);
        }
    }
}

/// The voxels of a volume that is drawn directly are about to be copied.
pub(super) fn begin_uploads(trace: Option<&Arc<Trace>>, staging: &mut Staging) -> Option<Guard> {
    let trace = trace?;
    staging.keep_times();
    Some(trace.begin("upload", Details::None))
}

/// They were.
pub(super) fn end_uploads(
    trace: Option<&Arc<Trace>>,
    span: Option<Guard>,
    staging: &mut Staging,
    bytes: u64,
) {
    drop(span);
    if let Some(trace) = trace {
        staging.take_times().iter().for_each(|times| trace.steps(times));
        trace.count(Counter::BytesUploaded, bytes);
    }
}

impl Paged {
    /// A brick is staged, until this is dropped.
    pub(super) fn stage_span(&self, id: BrickId, voxels: &[u8]) -> Option<Guard> {
        let bytes = Some(voxels.len() as u64);
        self.trace.as_ref().map(|trace| trace.begin("stage", Details::Brick(id, bytes)))
    }

    /// Says how long staging waited for a half that a copy still read.
    pub(super) fn trace_half_wait(&self, waited: Option<[Instant; 2]>) {
        if let (Some(trace), Some(times)) = (&self.trace, waited) {
            trace.span(Track::Host, "wait for half", times, Details::None);
        }
    }

    /// Staged bricks were submitted; their times will come when the copy has ended.
    pub(super) fn trace_flush(&mut self, begin: Instant, point: TimePoint, staged: &[StagedBrick]) {
        let Some(trace) = &self.trace else { return };
        // One step per atlas, or one into the upload buffer.
        let count = |bricks: &[&StagedBrick]| {
            (bricks.len() as u64, bricks.iter().map(|brick| brick.bytes).sum::<u64>())
        };
        let all: Vec<&StagedBrick> = staged.iter().collect();
        let (bricks, bytes) = count(&all);
        let steps = match self.places() {
            true => vec![(bricks, bytes)],
            false => {
                let of_atlas = |(atlas, _): (usize, Vec<u32>)| {
                    let of_step = staged.iter().filter(|brick| brick.atlas == atlas);
                    count(&of_step.collect::<Vec<_>>())
                };
                slots_by_atlas(staged).into_iter().map(of_atlas).collect()
            }
        };
        let details = Details::Copy { time_point: point.value, bricks, bytes };
        trace.span(Track::Host, "flush", [begin, Instant::now()], details);
        let submitted = |brick: &StagedBrick| {
            let (time_point, bytes) = (point.value, brick.bytes);
            (brick.id, BrickStep::Submitted { time_point, bytes })
        };
        trace.bricks(staged.iter().map(submitted));
        trace.announce_copies(point.value, steps);
        trace.count(Counter::BytesUploaded, self.host.counts.uploaded_bytes + bytes);
        self.staging.take_times().iter().for_each(|times| trace.steps(times));
    }

    /// The passes that place staged bricks are recorded and submitted, until this is dropped.
    pub(super) fn place_span(&self) -> Option<Guard> {
        let trace = self.trace.as_ref().filter(|_| self.places())?;
        Some(trace.begin("place", Details::None))
    }

    /// Something happens to bricks now.
    pub(super) fn trace_bricks(&self, bricks: impl Iterator<Item = (BrickId, BrickStep)>) {
        if let Some(trace) = &self.trace {
            trace.bricks(bricks);
        }
    }

    /// Rays asked for bricks that are not there, and slots of others were given to the host for them.
    pub(super) fn trace_wanted(&mut self) {
        let evicted = self.host.slots.take_evicted();
        let Some(trace) = &self.trace else { return };
        let step = BrickStep::Evicted(self.residency.round());
        trace.bricks(evicted.into_iter().map(|id| (id, step)));
        trace.wanted(self.host.wanted());
    }

    /// The round that begins makes bricks visible.
    pub(super) fn trace_published(&self, updates: &[Update]) {
        let published = BrickStep::Published(self.residency.round());
        let bricks = updates.iter().filter_map(|update| self.host.published(update));
        self.trace_bricks(bricks.map(|id| (id, published)));
    }

    /// A round has told how it stands.
    pub(super) fn trace_report(&mut self, report: &Report) -> Result<()> {
        let Some(trace) = &self.trace else { return Ok(()) };
        if let Some(used) = self.residency.used()? {
            let round = self.residency.round();
            let sampled = self.host.slots.newly_sampled(&used, round);
            trace.bricks(sampled.into_iter().map(|id| (id, BrickStep::Sampled(round))));
        }
        let all: u32 = self.plan.residency.slots();
        let sum = |of: &dyn Fn(&OfAtlas) -> u32| -> u64 {
            report.atlases.iter().map(|atlas| u64::from(of(atlas))).sum()
        };
        let (touched, missed) =
            (sum(&|atlas| atlas.answer.touched), sum(&|atlas| atlas.answer.wished));
        trace.count(Counter::SlotsFree, u64::from(all) - self.host.slots.used() as u64);
        trace.count(Counter::BricksTouched, touched);
        trace.count(Counter::BricksMissed, missed);
        trace.count(Counter::BytesReadBack, report.bytes);
        let granted: usize = report.atlases.iter().map(|atlas| atlas.grants.len()).sum();
        trace.count(Counter::RaysWaiting, report.progress.waiting.into());
        trace.count(Counter::BricksBound, self.host.bound_count() as u64);
        trace.count(Counter::SlotsGranted, granted as u64);
        Ok(())
    }

    /// Something came from the loaders.
    pub(super) fn trace_loading(&mut self) {
        let Some(trace) = &self.trace else { return };
        let (jobs, dropped) = self.loading.take_jobs();
        for job in jobs {
            let track = Track::Loader(job.loader as u32);
            let details = match job.work {
                DoneWork::Read { id, bytes } => Details::Brick(id, bytes),
                DoneWork::Survey { block, bricks } => Details::Block(block.first(), bricks),
            };
            job.parts().for_each(|(name, times)| trace.span(track, name, times, details));
        }
        trace.count_dropped(dropped);
        trace.count(Counter::RamCacheBytes, self.loading.statistics().cache_bytes);
    }

    /// A view is finished, and its copies have ended.
    pub(super) fn trace_end(&mut self) {
        self.trace_loading();
        let Some(trace) = &self.trace else { return };
        self.staging.take_times().iter().for_each(|times| trace.steps(times));
        trace.count(Counter::BytesUploaded, self.host.counts.uploaded_bytes);
        trace.count(Counter::BricksBound, self.host.bound_count() as u64);
        trace.reads_under_way(self.loading.reads_under_way() as u64);
    }
}
