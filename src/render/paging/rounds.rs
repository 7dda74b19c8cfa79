//! The loop: a round on the device, then what it asked for, until no ray waits.

use std::ops::ControlFlow;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::gpu::{HostEvent, Record, Submitted, TimePoint};
use crate::loading::{Delivery, Wish};
use crate::passes::cache_buffers::RankOrder;
use crate::render::frame::Tile;
use crate::render::paging::paged::Paged;
use crate::render::paging::recording::Event;
use crate::render::paging::round::{Round, annotate_grants};
use crate::render::paging::script::Script;
use crate::render::paging::watching::Watch;
use crate::render::plan::Plan;
use crate::render::renderer::Renderer;
use crate::render::statistics::{Statistics, Unfinished};
use crate::residency::{Allowance, Report};
use crate::twins::cache::Progress;
use crate::twins::limits::RANK_NONE;

/// Rounds in which nothing at all changes, after which the loop says that it stands still.
const STILL_ROUNDS_MAX: u32 = 3;
/// Rounds in which bricks come and go and no ray moves, after which it says so too.
const RESTLESS_ROUNDS_MAX: u32 = 64;
/// How often one picture begins anew because a source that failed recovered.
const RECOVERIES_MAX: u32 = 3;
/// How long the host waits for deliveries at a time while the device works.
const GLANCE: Duration = Duration::from_micros(200);

/// Draws a tile of a view through the atlas; its pixels and samples are then in the buffers. False: another
/// scene has been left for the renderer or who watches broke off, and they are not.
pub fn draw(
    renderer: &Renderer,
    paged: &mut Paged,
    tile: Tile,
    statistics: &mut Statistics,
    records: &mut Vec<Record>,
    (progress, watch): (&mut dyn FnMut(f64), Option<&mut Watch>),
) -> Result<bool> {
    let mut rounds = Rounds {
        renderer,
        paged,
        tile,
        statistics,
        records,
        watch,
        forget: true,
        still: 0,
        restless: 0,
        farthest: 0,
        reloaded: 0,
        asked: Instant::now(),
        progressed: Instant::now(),
    };
    let marched_before = rounds.statistics.gpu_ms_of("march_bricks");
    let rounds_before = rounds.statistics.rounds;
    if !rounds.turn(progress)? {
        return Ok(false);
    }
    let marched_ms = rounds.statistics.gpu_ms_of("march_bricks") - marched_before;
    let one_round = rounds.statistics.rounds - rounds_before == 1;
    rounds.paged.tell_marched(tile, marched_ms, one_round);
    let _span = renderer.span("resolve");
    let submitted = renderer.submit_resolve(rounds.paged, tile)?;
    rounds.ended(submitted)?;
    Ok(true)
}

pub(super) struct Rounds<'a, 'w> {
    pub(super) renderer: &'a Renderer,
    pub(super) paged: &'a mut Paged,
    pub(super) tile: Tile,
    pub(super) statistics: &'a mut Statistics,
    records: &'a mut Vec<Record>,
    pub(super) watch: Option<&'a mut Watch<'w>>,
    forget: bool,
    still: u32,
    restless: u32,
    /// Greatest front so far: for progress.
    farthest: u32,
    /// Bricks uploaded again so far.
    reloaded: u64,
    asked: Instant,
    /// When a ray last moved or the device last learned something.
    progressed: Instant,
}

impl Rounds<'_, '_> {
    /// False: another scene waits to be taken up, or who watches has seen enough.
    fn turn(&mut self, progress: &mut dyn FnMut(f64)) -> Result<bool> {
        let plan = &self.renderer.plan;
        let substitute = self.substitute();
        self.paged.look_through(self.tile.view as usize)?;
        if let Some(submitted) = self.renderer.submit_forget(self.paged)? {
            self.ended(submitted)?;
        }
        self.script_tile()?;
        self.begin_pace();
        let mut first = true;
        let mut recoveries = 0;
        loop {
            if self.renderer.next_scene.is_left() {
                self.script_breaks()?;
                return Ok(false);
            }
            if self.renderer.epoch.load(Ordering::Acquire) != self.paged.epoch {
                self.script_breaks()?;
                self.paged.epoch = self.renderer.epoch.load(Ordering::Acquire);
                self.paged.new_epoch(&self.renderer.gpu)?;
                self.begin_anew();
                first = true;
            }
            let _round = self.renderer.round_span();
            let point = self.round(first || substitute)?;
            first = false;
            let waiting = self.renderer.span("wait");
            if self.is_replay() {
                self.replay_arrivals()?;
                self.renderer.gpu.wait(point)?;
            } else if plan.settings.paging.lockstep {
                self.renderer.gpu.wait(point)?;
            } else {
                // Beside the device: loaders deliver, and copies go out, while it marches.
                while self.may_upload()
                    && self.paged.loading.outstanding() > 0
                    && !self.renderer.gpu.has_reached(point)
                {
                    self.take_deliveries(GLANCE)?;
                }
                self.renderer.gpu.wait(point)?;
            }
            drop(waiting);
            let report = self.take_report(point)?;
            self.statistics.rounds += 1;
            self.show_progress(&report, progress);
            if substitute {
                self.script_frame()?;
            }
            let seen =
                if substitute { self.show_picture(&report)? } else { ControlFlow::Continue(()) };
            self.learn_pace();
            let finished = self.is_finished(&report, substitute);
            if seen.is_break() {
                // The next picture will want much of the same.
                if !finished {
                    self.ask(&report)?;
                }
                return Ok(false);
            }
            if finished {
                // What was recorded failed in the same way when it is replayed.
                if self.has_script() || recoveries == RECOVERIES_MAX || !self.source_recovers()? {
                    self.script_end()?;
                    return Ok(true);
                }
                recoveries += 1;
                self.begin_anew();
                first = true;
                continue;
            }
            self.ask(&report)?;
            if plan.settings.paging.lockstep {
                // Everything that slots are kept for comes, and is copied.
                let _span = self.renderer.span("load");
                self.wait_while(|paged| paged.host.bound_count() > paged.staged_count())?;
                self.flush()?;
            } else if report.progress.moved == 0 {
                // Nothing to march until something comes.
                let _span = self.renderer.span("load");
                self.take_deliveries(Duration::from_millis(2))?;
            }
            if self.is_replay() {
                if self.replay_stops()? {
                    return Ok(true);
                }
            } else if self.stands_still(&report)? {
                self.script_end()?;
                return Ok(true);
            }
        }
    }

    /// Rays begin anew; bricks count anew.
    fn begin_anew(&mut self) {
        self.forget = true;
        self.statistics.bricks_needed = 0;
        self.paged.host.begin_view();
    }

    /// Whether bricks failed and one of them can be read now: then all of them are tried again.
    fn source_recovers(&mut self) -> Result<bool> {
        let Some(id) = self.paged.host.failures().keys().next().copied() else { return Ok(false) };
        self.paged.loading.forget_failures();
        self.paged.loading.wish(&[Wish { id, rank: 0 }]);
        self.asked = Instant::now();
        while !self.gave_up()? {
            match self.paged.loading.next(Duration::from_millis(50)) {
                Some(delivery) if delivery.is_brick(id) => {
                    self.paged.forget_failures();
                    // Its voxels are in the RAM cache now, from which nobody inspects them again.
                    self.paged.learn(&delivery);
                    return Ok(true);
                }
                Some(Delivery::Failed { id: failed, .. }) if failed == id => break,
                None if self.paged.loading.outstanding() == 0 => break,
                None => {}
                // Of before: each comes once, and is not to be lost.
                Some(other) => self.take(other)?,
            }
        }
        Ok(false)
    }

    fn substitute(&self) -> bool {
        self.paged.plan.residency.ranks.order == RankOrder::Substitute
    }

    /// Submits one round.
    fn round(&mut self, first: bool) -> Result<TimePoint> {
        let _span = self.renderer.span("submit");
        let plan: &Plan = &self.renderer.plan;
        let allowances: Vec<_> = (0..self.paged.plan.residency.atlases.len())
            .map(|atlas| self.allowance(atlas))
            .collect();
        let portion = self.portion()?;
        let round = Round {
            tile: self.tile,
            first,
            forget: std::mem::take(&mut self.forget),
            allowances: &allowances,
            level: self.paged.plan.views[self.tile.view as usize].in_use[0],
            portion,
        };
        let keep = plan.settings.paging.keep_records;
        let (statistics, records) = (&mut *self.statistics, &mut *self.records);
        let renderer = self.renderer;
        let several = portion.dispatches > portion.per_submit;
        let point = self.renderer.submit_round(self.paged, &round, |submitted| {
            // One set of timestamps: they are read before the next submit writes them.
            if several {
                renderer.add_times(statistics);
            }
            if keep {
                records.push(submitted.record);
            }
            Ok(())
        })?;
        Ok(point)
    }

    /// What one round may take of an atlas: no more slots than staging, loaders and guard can use.
    fn allowance(&self, atlas: usize) -> Allowance {
        let slots = self.paged.plan.residency.atlases[atlas].layout.slot_count();
        let held = self.paged.host.pool_count(atlas);
        let channels = self.paged.plan.residency.atlases[atlas].shape.channels;
        let lockstep = self.renderer.plan.settings.paging.lockstep;
        let bound = self.paged.host.bound_count() as u32;
        // Free-running, rays use what is there while other slots are filled.
        let most = if lockstep { slots } else { (slots / 2).max(channels) };
        let live_max = if self.substitute() { slots } else { (slots / 2).max(channels) };
        let budget = match (self.is_forced(), &self.paged.pace) {
            (true, _) => 0,
            (false, Some(pace)) => pace.grants_max(held + bound),
            _ => self.renderer.plan.settings.paging.grants_per_round.unwrap_or(u32::MAX),
        };
        Allowance { grants_max: most.saturating_sub(held + bound).min(budget), live_max, held }
    }

    fn take_report(&mut self, point: TimePoint) -> Result<Report> {
        let _span = self.renderer.span("report");
        self.renderer.add_times(self.statistics);
        self.paged.staging.measure_ended()?;
        let report = self.paged.residency.report()?;
        let report = self.script_report(report)?;
        if self.renderer.plan.settings.paging.keep_records {
            let grants: Vec<_> =
                report.atlases.iter().flat_map(|atlas| atlas.grants.iter().copied()).collect();
            grants.iter().for_each(|slot| _ = self.paged.readable.remove(slot));
            annotate_grants(self.records, &grants);
            self.records.push(Record::of_host(vec![HostEvent::Waited(point)]));
        }
        for atlas in &report.atlases {
            self.statistics.bricks_needed += u64::from(atlas.answer.touched);
        }
        self.statistics.bytes_read_back += report.bytes;
        self.paged.trace_report(&report)?;
        Ok(report)
    }

    fn is_finished(&mut self, report: &Report, substitute: bool) -> bool {
        let Progress { waiting, running, .. } = report.progress;
        let wished: u32 = report.atlases.iter().map(|atlas| atlas.answer.wished).sum();
        self.statistics.rays_waiting = u64::from(waiting);
        let finished = waiting == 0 && running == 0 && (!substitute || wished == 0);
        self.statistics.converged = finished;
        finished
    }

    /// Turns what the round reported into surveys, slots kept and wishes.
    fn ask(&mut self, report: &Report) -> Result<()> {
        let mut blocks = self.paged.host.take_report(report);
        if self.substitute() {
            let floor = self.paged.host.floor_wanted();
            blocks.extend(self.paged.host.want_first(floor));
        }
        self.paged.trace_wanted();
        self.paged.loading.survey(&blocks);
        if self.renderer.plan.settings.paging.lockstep {
            let _span = self.renderer.span("survey");
            self.wait_while(|paged| paged.host.surveys_pending() > 0)?;
        }
        self.script_bound()?;
        self.bind_and_wish();
        Ok(())
    }

    pub(super) fn bind_and_wish(&mut self) {
        let _span = self.renderer.span("bind");
        let paging = &self.renderer.plan.settings.paging;
        let Paged { host, description, loading, script, .. } = &mut *self.paged;
        host.bind(!paging.lockstep, |level| description.grid(level));
        // Beyond the slots kept: into the RAM cache, so that loaders are not idle.
        let ahead = if paging.lockstep { 0 } else { 2 * paging.loader_count() };
        match script {
            Some(Script::Replay(replay)) => loading.wish(&replay.upcoming()),
            _ => loading.wish(&host.wishes(ahead)),
        }
    }

    /// Lockstep: takes what comes while something is `missing` and on its way, and patience lasts.
    fn wait_while(&mut self, missing: impl Fn(&Paged) -> bool) -> Result<()> {
        if self.is_replay() {
            return self.replay_arrivals();
        }
        self.asked = Instant::now();
        while missing(self.paged) && self.paged.loading.outstanding() > 0 {
            if !self.deliver(Duration::from_millis(50))? && self.gave_up()? {
                break;
            }
        }
        Ok(())
    }

    /// Free-running: whatever has come, waiting `timeout` for the first of it.
    fn take_deliveries(&mut self, timeout: Duration) -> Result<()> {
        if self.is_replay() {
            return self.replay_arrivals();
        }
        let mut wait = timeout;
        let mut came = false;
        while self.may_upload() && self.deliver(wait)? {
            came = true;
            wait = Duration::ZERO;
        }
        if came {
            // First what has come, so that it is not wished for again.
            self.script(|| Event::Turn)?;
            self.flush()?;
            self.bind_and_wish();
        }
        Ok(())
    }

    pub(super) fn flush(&mut self) -> Result<()> {
        let keep = self.renderer.plan.settings.paging.keep_records;
        self.paged.flush(&self.renderer.gpu, keep.then_some(&mut *self.records))
    }

    /// Takes one delivery; false when none came in time.
    fn deliver(&mut self, timeout: Duration) -> Result<bool> {
        let Some(delivery) = self.paged.loading.next(timeout) else { return Ok(false) };
        self.paged.trace_loading();
        self.asked = Instant::now();
        self.script(|| Event::of_delivery(&delivery))?;
        self.take(delivery)?;
        Ok(true)
    }

    pub(super) fn take(&mut self, delivery: Delivery) -> Result<()> {
        self.paged.learn(&delivery);
        match delivery {
            Delivery::Surveyed { block, entries } => {
                let joint = self.paged.joint.clone();
                self.paged.host.take_survey(block, &entries, joint.as_deref());
            }
            Delivery::Failed { id, why } => self.paged.host.failed(id, why),
            Delivery::Brick { id, bytes, .. } => {
                let Some(slot) = self.paged.host.slot_of(id) else {
                    self.paged.host.came_ahead(id);
                    return Ok(());
                };
                if !self.paged.stage(id, slot, &bytes)? {
                    self.flush()?;
                    self.paged.stage(id, slot, &bytes)?;
                }
            }
        }
        Ok(())
    }

    /// Nothing has come for longer than patience lasts: what is on its way is given up.
    fn gave_up(&mut self) -> Result<bool> {
        if self.asked.elapsed() < self.renderer.plan.settings.paging.patience {
            return Ok(false);
        }
        self.script(|| Event::GaveUp)?;
        self.give_up();
        Ok(true)
    }

    pub(super) fn give_up(&mut self) {
        let given_up = self.paged.host.give_up();
        self.statistics.unfinished = Some(Unfinished::Starved { bricks: given_up.len() as u64 });
    }

    fn stands_still(&mut self, report: &Report) -> Result<bool> {
        if self.statistics.unfinished.is_some() {
            return Ok(true);
        }
        let underway = self.paged.loading.outstanding() > 0 || self.paged.host.has_updates();
        let moved = report.progress.moved > 0 && !self.substitute();
        self.still = if moved || underway { 0 } else { self.still + 1 };
        // Bricks that had been there before, and no ray moved: they come and go.
        let counts = &self.paged.host.counts;
        let reloaded = counts.uploaded - counts.distinct;
        let again = reloaded > std::mem::replace(&mut self.reloaded, reloaded);
        self.restless = match (moved || self.substitute(), again) {
            (true, _) => 0,
            (false, true) => self.restless + 1,
            (false, false) => self.restless,
        };
        if moved || self.paged.host.has_updates() {
            self.progressed = Instant::now();
        }
        let patience = self.renderer.plan.settings.paging.patience;
        if !underway && self.progressed.elapsed() > patience {
            let bricks = self.paged.host.bound_count() as u64;
            self.statistics.unfinished = Some(Unfinished::Starved { bricks });
            return Ok(true);
        }
        if underway
            && !self.renderer.plan.settings.paging.lockstep
            && self.asked.elapsed() > patience
            && self.gave_up()?
        {
            return Ok(true);
        }
        let granted: usize = report.atlases.iter().map(|atlas| atlas.grants.len()).sum();
        if self.still >= STILL_ROUNDS_MAX && granted == 0 {
            self.statistics.unfinished =
                Some(Unfinished::Full { slots: self.paged.plan.residency.slots().into() });
        } else if self.restless >= RESTLESS_ROUNDS_MAX {
            self.statistics.unfinished =
                Some(Unfinished::Restless { rounds: RESTLESS_ROUNDS_MAX.into() });
        }
        Ok(self.statistics.unfinished.is_some())
    }

    fn show_progress(&mut self, report: &Report, progress: &mut dyn FnMut(f64)) {
        let front = report.progress.front;
        if front != RANK_NONE {
            self.farthest = self.farthest.max(front);
        }
        let ranks = self.paged.plan.views[self.tile.view as usize].ranks;
        progress(f64::from(self.farthest) / f64::from(ranks));
    }

    pub(super) fn ended(&mut self, submitted: Submitted) -> Result<()> {
        let _span = self.renderer.span("wait");
        self.renderer.gpu.wait(submitted.point)?;
        self.renderer.add_times(self.statistics);
        if self.renderer.plan.settings.paging.keep_records {
            self.records.push(submitted.record);
            self.records.push(Record::of_host(vec![HostEvent::Waited(submitted.point)]));
        }
        Ok(())
    }
}
