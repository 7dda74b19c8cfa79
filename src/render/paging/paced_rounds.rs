//! What the loop tells its pacer, and what it heeds; nothing where rounds have no target.

use std::time::{Duration, Instant};

use crate::render::paging::pacer::{Measured, Paced, Pacer, Rung};
use crate::render::paging::rounds::Rounds;
use crate::render::renderer::{Renderer, Way};
use crate::trace::Counter;

/// A pacer, and what happened since the last picture.
pub struct Pace {
    pacer: Pacer,
    /// When the last picture was there, or its work began.
    since: Instant,
    /// It began before the view's first round.
    begun: bool,
    /// Milliseconds of the view's passes on the render queue, and of all copies, until then.
    render_ms: f64,
    copy_ms: f64,
    /// The host's time for staging since then.
    staging: Duration,
    /// Bricks staged since then.
    staged: u32,
}

/// How rounds keep to their time, after one of them.
#[derive(Clone, Debug)]
pub struct RoundPace {
    /// Of the view so far.
    pub paced: Paced,
    /// How coarse the next picture should be while something moves.
    pub rung: Rung,
}

impl Pace {
    /// Rounds are to take so long.
    pub fn new(target_ms: f64) -> Pace {
        Pace {
            pacer: Pacer::new(target_ms),
            since: Instant::now(),
            begun: false,
            render_ms: 0.0,
            copy_ms: 0.0,
            staging: Duration::ZERO,
            staged: 0,
        }
    }

    /// Bricks that may still be staged before the next picture.
    pub fn uploads_left(&self) -> u32 {
        self.pacer.uploads_max().saturating_sub(self.staged)
    }

    /// Slots that a round may be granted: twice what it may upload, so that loaders have work beyond it, but for
    /// what is on its way.
    pub fn grants_max(&self, on_its_way: u32) -> u32 {
        self.pacer.uploads_max().saturating_mul(2).saturating_sub(on_its_way)
    }

    /// A brick was staged in so long.
    pub fn staged(&mut self, took: Duration) {
        self.staging += took;
        self.staged += 1;
    }

    /// What the view came to.
    pub fn paced(&self) -> Paced {
        self.pacer.paced()
    }

    /// The same, and what is advised.
    pub fn told(&self) -> RoundPace {
        RoundPace { paced: self.paced(), rung: self.pacer.rung() }
    }

    pub fn pacer(&mut self) -> &mut Pacer {
        &mut self.pacer
    }
}

impl Renderer {
    /// Where rounds have a target: from now on it is this.
    pub fn target_round(&mut self, ms: f64) {
        if let Some(pace) = self.pace() {
            pace.pacer.aim_at(ms);
        }
    }

    /// Where rounds have a target: the work for the next picture begins now, with a change of scene before its
    /// first round.
    pub fn begin_frame(&mut self) {
        if let Some(pace) = self.pace() {
            (pace.since, pace.begun) = (Instant::now(), true);
        }
    }

    /// Where rounds have a target: the next pictures are as coarse as this, compared with those before.
    pub fn draw_at(&mut self, rung: Rung) {
        if let Some(pace) = self.pace() {
            pace.pacer.draw_at(rung);
        }
    }

    fn pace(&mut self) -> Option<&mut Pace> {
        match &mut self.way {
            Way::Paged(Some(paged)) => paged.pace.as_mut(),
            _ => None,
        }
    }
}

impl Rounds<'_, '_> {
    /// A view's first round is about to begin.
    pub(super) fn begin_pace(&mut self) {
        let Some(pace) = &mut self.paged.pace else { return };
        if !std::mem::take(&mut pace.begun) {
            pace.since = Instant::now();
        }
        (pace.render_ms, pace.copy_ms) =
            (self.statistics.gpu_ms_total(), self.paged.staging.copy_ms());
        (pace.staging, pace.staged) = (Duration::ZERO, 0);
    }

    /// A round's picture is there, or would be.
    pub(super) fn learn_pace(&mut self) {
        let Some(pace) = &mut self.paged.pace else { return };
        let (render_ms, copy_ms) = (self.statistics.gpu_ms_total(), self.paged.staging.copy_ms());
        let now = Instant::now();
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        pace.pacer.learn(&Measured {
            period_ms: ms(now - pace.since),
            render_ms: render_ms - pace.render_ms,
            copy_ms: copy_ms - pace.copy_ms,
            staging_ms: ms(pace.staging),
            bricks: pace.staged,
        });
        (pace.since, pace.render_ms, pace.copy_ms) = (now, render_ms, copy_ms);
        (pace.staging, pace.staged) = (Duration::ZERO, 0);
        if let Some(trace) = &self.paged.trace {
            trace.count(Counter::UploadsMax, pace.pacer.uploads_max().into());
        }
    }

    /// Whether a brick more may be staged before the next picture.
    pub(super) fn may_upload(&self) -> bool {
        self.paged.pace.as_ref().is_none_or(|pace| pace.uploads_left() > 0)
    }
}
