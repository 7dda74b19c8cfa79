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
use crate::render::paging::round::{Round, annotate_grants};
use crate::render::paging::slot_map::SlotBrick;
use crate::render::plan::Plan;
use crate::render::renderer::{Picture, Renderer};
use crate::render::statistics::{Statistics, Unfinished};
use crate::residency::{Allowance, OfAtlas, Report};
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

/// A whole picture while it is refined by substitution.
pub struct RoundPicture {
    /// Number of the round, from 1.
    pub round: u64,
    /// Milliseconds on the wall from the view's beginning to the round's end.
    pub ms: f64,
    /// Bricks copied to the device before this round.
    pub bricks_uploaded: u64,
    /// How the cache stands.
    pub cache: RoundCache,
    /// What the round gave.
    pub picture: Picture,
}

/// The cache after a round. Counts are of the view so far, unless they say another thing.
#[derive(Clone, Debug, Default)]
pub struct RoundCache {
    /// Bricks in slots that rays of this round went through for the first time in the view.
    pub touched: u64,
    /// Bricks that rays of this round asked for in vain.
    pub missed: u64,
    /// Of them, without a slot yet.
    pub wanted: u64,
    /// Bricks that have a slot and have not come.
    pub pending: u64,
    /// Bricks that the source does not have, of all that were looked at.
    pub absent: u64,
    /// Bricks that show nothing.
    pub hidden: u64,
    /// Bricks of one value.
    pub constant: u64,
    /// Bricks that could not be read, in the epoch.
    pub failed: u64,
    /// Texel bytes copied.
    pub bytes_uploaded: u64,
    /// Bytes of reports read back, of this round.
    pub bytes_read_back: u64,
    /// Slots of each atlas, one after the other.
    pub slots_of_atlas: Vec<u32>,
    /// What they hold, as far as any was ever filled.
    pub slots: Vec<Option<SlotBrick>>,
    /// Number of this round in which slots count.
    pub round: u32,
}

/// Who looks at the pictures of rounds, and how long looking took.
pub struct Watch<'w> {
    begun: Instant,
    watching: Duration,
    tell: &'w mut dyn FnMut(RoundPicture) -> ControlFlow<()>,
    /// There is no picture then but that of the last round.
    pub broken_off: bool,
}

impl<'w> Watch<'w> {
    /// From now on.
    pub fn new(tell: &'w mut dyn FnMut(RoundPicture) -> ControlFlow<()>) -> Watch<'w> {
        Watch { begun: Instant::now(), watching: Duration::ZERO, tell, broken_off: false }
    }

    fn ms(&self) -> f64 {
        self.begun.elapsed().saturating_sub(self.watching).as_secs_f64() * 1e3
    }
}

struct Rounds<'a, 'w> {
    renderer: &'a Renderer,
    paged: &'a mut Paged,
    tile: Tile,
    statistics: &'a mut Statistics,
    records: &'a mut Vec<Record>,
    watch: Option<&'a mut Watch<'w>>,
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
        let mut first = true;
        let mut recoveries = 0;
        loop {
            if self.renderer.next_scene.is_left() {
                return Ok(false);
            }
            if self.renderer.epoch.load(Ordering::Acquire) != self.paged.epoch {
                self.paged.epoch = self.renderer.epoch.load(Ordering::Acquire);
                self.paged.new_epoch(&self.renderer.gpu)?;
                self.begin_anew();
                first = true;
            }
            let _round = self.renderer.round_span();
            let point = self.round(first || substitute)?;
            first = false;
            let waiting = self.renderer.span("wait");
            if plan.settings.paging.lockstep {
                self.renderer.gpu.wait(point)?;
            } else {
                // Beside the device: loaders deliver, and copies go out, while it marches.
                while self.paged.loading.outstanding() > 0 && !self.renderer.gpu.has_reached(point)
                {
                    self.take_deliveries(GLANCE)?;
                }
                self.renderer.gpu.wait(point)?;
            }
            drop(waiting);
            let report = self.take_report(point)?;
            self.statistics.rounds += 1;
            self.show_progress(&report, progress);
            let seen =
                if substitute { self.show_picture(&report)? } else { ControlFlow::Continue(()) };
            let finished = self.is_finished(&report, substitute);
            if seen.is_break() {
                // The next picture will want much of the same.
                if !finished {
                    self.ask(&report)?;
                }
                return Ok(false);
            }
            if finished {
                if recoveries == RECOVERIES_MAX || !self.source_recovers()? {
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
            if self.stands_still(&report) {
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
        while !self.gave_up() {
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
        let round = Round {
            tile: self.tile,
            first,
            forget: std::mem::take(&mut self.forget),
            allowances: &allowances,
            level: self.paged.plan.views[self.tile.view as usize].in_use[0],
        };
        let keep = plan.settings.paging.keep_records;
        let (statistics, records) = (&mut *self.statistics, &mut *self.records);
        let renderer = self.renderer;
        let several = plan.march_dispatches() > crate::render::plan::DISPATCHES_PER_SUBMIT;
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
        let budget = self.renderer.plan.settings.paging.grants_per_round.unwrap_or(u32::MAX);
        Allowance { grants_max: most.saturating_sub(held + bound).min(budget), live_max, held }
    }

    fn take_report(&mut self, point: TimePoint) -> Result<Report> {
        let _span = self.renderer.span("report");
        self.renderer.add_times(self.statistics);
        let report = self.paged.residency.report()?;
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
        self.bind_and_wish();
        Ok(())
    }

    fn bind_and_wish(&mut self) {
        let _span = self.renderer.span("bind");
        let paging = &self.renderer.plan.settings.paging;
        let Paged { host, description, loading, .. } = &mut *self.paged;
        host.bind(!paging.lockstep, |level| description.grid(level));
        // Beyond the slots kept: into the RAM cache, so that loaders are not idle.
        let ahead = if paging.lockstep { 0 } else { 2 * paging.loader_count() };
        loading.wish(&host.wishes(ahead));
    }

    /// Lockstep: takes what comes while something is `missing` and on its way, and patience lasts.
    fn wait_while(&mut self, missing: impl Fn(&Paged) -> bool) -> Result<()> {
        self.asked = Instant::now();
        while missing(self.paged) && self.paged.loading.outstanding() > 0 {
            if !self.deliver(Duration::from_millis(50))? && self.gave_up() {
                break;
            }
        }
        Ok(())
    }

    /// Free-running: whatever has come, waiting `timeout` for the first of it.
    fn take_deliveries(&mut self, timeout: Duration) -> Result<()> {
        let mut wait = timeout;
        let mut came = false;
        while self.deliver(wait)? {
            came = true;
            wait = Duration::ZERO;
        }
        if came {
            // First what has come, so that it is not wished for again.
            self.flush()?;
            self.bind_and_wish();
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let keep = self.renderer.plan.settings.paging.keep_records;
        self.paged.flush(&self.renderer.gpu, keep.then_some(&mut *self.records))
    }

    /// Takes one delivery; false when none came in time.
    fn deliver(&mut self, timeout: Duration) -> Result<bool> {
        let Some(delivery) = self.paged.loading.next(timeout) else { return Ok(false) };
        self.paged.trace_loading();
        self.asked = Instant::now();
        self.take(delivery)?;
        Ok(true)
    }

    fn take(&mut self, delivery: Delivery) -> Result<()> {
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
    fn gave_up(&mut self) -> bool {
        if self.asked.elapsed() < self.renderer.plan.settings.paging.patience {
            return false;
        }
        let given_up = self.paged.host.give_up();
        self.statistics.unfinished = Some(Unfinished::Starved { bricks: given_up.len() as u64 });
        true
    }

    fn stands_still(&mut self, report: &Report) -> bool {
        if self.statistics.unfinished.is_some() {
            return true;
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
            return true;
        }
        if underway
            && !self.renderer.plan.settings.paging.lockstep
            && self.asked.elapsed() > patience
            && self.gave_up()
        {
            return true;
        }
        let granted: usize = report.atlases.iter().map(|atlas| atlas.grants.len()).sum();
        if self.still >= STILL_ROUNDS_MAX && granted == 0 {
            self.statistics.unfinished =
                Some(Unfinished::Full { slots: self.paged.plan.residency.slots().into() });
        } else if self.restless >= RESTLESS_ROUNDS_MAX {
            self.statistics.unfinished =
                Some(Unfinished::Restless { rounds: RESTLESS_ROUNDS_MAX.into() });
        }
        self.statistics.unfinished.is_some()
    }

    fn show_progress(&mut self, report: &Report, progress: &mut dyn FnMut(f64)) {
        let front = report.progress.front;
        if front != RANK_NONE {
            self.farthest = self.farthest.max(front);
        }
        let ranks = self.paged.plan.views[self.tile.view as usize].ranks;
        progress(f64::from(self.farthest) / f64::from(ranks));
    }

    /// How the cache stands after a round.
    fn cache(&self, report: &Report) -> RoundCache {
        let host = &self.paged.host;
        let sum =
            |of: &dyn Fn(&OfAtlas) -> u32| report.atlases.iter().map(|a| u64::from(of(a))).sum();
        let atlases = self.paged.plan.residency.atlases.iter();
        let (slots, round) = host.slots.now();
        RoundCache {
            touched: sum(&|atlas| atlas.answer.touched),
            missed: sum(&|atlas| atlas.answer.wished),
            wanted: host.wanted().len() as u64,
            pending: host.bound_count() as u64,
            absent: host.counts.absent,
            hidden: host.counts.hidden,
            constant: host.counts.constant,
            failed: host.failures().len() as u64,
            bytes_uploaded: host.counts.uploaded_bytes,
            bytes_read_back: report.bytes,
            slots_of_atlas: atlases.map(|atlas| atlas.layout.slot_count()).collect(),
            slots,
            round,
        }
    }

    /// Hands a round's picture to who watches. What that takes is no part of the loop's time.
    fn show_picture(&mut self, report: &Report) -> Result<ControlFlow<()>> {
        let ms = match &self.watch {
            Some(watch) => watch.ms(),
            None => return Ok(ControlFlow::Continue(())),
        };
        let begun = Instant::now();
        let submitted = self.renderer.submit_resolve(self.paged, self.tile)?;
        self.ended(submitted)?;
        let size = self.renderer.plan.pixels[self.tile.view as usize].size;
        let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
        self.renderer.collect(self.tile, &mut pixels)?;
        let mut flow = ControlFlow::Continue(());
        let cache = self.cache(report);
        if let Some(watch) = &mut self.watch {
            let (round, uploaded) = (self.statistics.rounds, self.paged.host.counts.uploaded);
            let picture = Picture { size, pixels };
            flow =
                (watch.tell)(RoundPicture { round, ms, bricks_uploaded: uploaded, cache, picture });
            watch.watching += begun.elapsed();
            watch.broken_off = flow.is_break();
        }
        Ok(flow)
    }

    fn ended(&mut self, submitted: Submitted) -> Result<()> {
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
