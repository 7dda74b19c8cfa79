//! How much a round may upload, and how coarse a picture that moves has to be, so that rounds keep to a time.
//!
//! A round takes what rays take, by the render queue's timestamps, and `host + slope * bricks` beside them. The
//! latter two are followed by a Kalman filter over rounds; copies' times from the transfer queue and staging's from the
//! host bound the slope on both sides, since rounds that are all alike do not tell one from the other. The budget
//! leaves room for the spread of what was measured, so that nineteen of twenty rounds are to hold, not the mean.
//!
//! # Units
//! Milliseconds; bricks.
//!
//! # Source
//! octreemizer-2002 section 6 names a limit on loading that follows the frame rate as future work. R. E. Kalman, "A
//! new approach to linear filtering and prediction problems", 1960.

use serde::Serialize;

use crate::trace::summary::Percentiles;

/// Bricks that a round may upload at least, so that it goes on whatever the target.
const UPLOADS_MIN: u32 = 4;
/// Of the first round, of which nothing is known.
const UPLOADS_FIRST: u32 = 16;
/// Bricks that a round may upload at most.
const UPLOADS_MAX: u32 = 4096;
/// Every so many rounds get this part of the budget: of rounds that are all alike nobody can tell what rays cost
/// and what bricks do.
const PROBE_EVERY: usize = 5;
const PROBE_PART: f64 = 0.5;
/// Where rays alone take longer than the target, bricks may take this part of their time.
const BEYOND_TARGET: f64 = 1.0;
/// Standard deviations of a round's time that are left free: 19 of 20 rounds hold.
const SPREAD: f64 = 1.65;
/// A picture gets finer again where it would take less than this part of the target.
const FINER_BELOW: f64 = 0.8;
/// Part of the target that a moving picture leaves for bricks.
const FOR_BRICKS: f64 = 0.2;

/// What one round took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    /// From the picture before to its own, ms on the wall.
    pub period_ms: f64,
    /// Of it on the render queue; 0 where that has no timestamps.
    pub render_ms: f64,
    /// Of copies that became known meanwhile, on the transfer queue; 0 as above.
    pub copy_ms: f64,
    /// Of the host for staging and handing over.
    pub staging_ms: f64,
    /// Bricks uploaded.
    pub bricks: u32,
}

/// How coarse a picture is while something moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Rung {
    /// Pixels so many times as wide and high; levels follow their size.
    pub wider: u32,
    /// Steps so many times as long.
    pub longer: u32,
}

/// From good to bad, by what they lose; `bench pacing` says how much, and what each costs.
pub const LADDER: [Rung; 7] = [
    Rung { wider: 1, longer: 1 },
    Rung { wider: 1, longer: 2 },
    Rung { wider: 1, longer: 4 },
    Rung { wider: 2, longer: 2 },
    Rung { wider: 2, longer: 4 },
    Rung { wider: 4, longer: 4 },
    Rung { wider: 8, longer: 4 },
];

impl Default for Rung {
    fn default() -> Rung {
        Rung::FINEST
    }
}

impl Rung {
    /// Of a picture at rest.
    pub const FINEST: Rung = LADDER[0];

    /// Samples, as a part of the finest picture's: what rays cost until that was measured.
    fn samples(self) -> f64 {
        1.0 / f64::from(self.wider * self.wider * self.longer)
    }

    fn index(self) -> usize {
        LADDER.iter().position(|rung| *rung == self).unwrap_or(0)
    }
}

/// What a paced view came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Paced {
    /// Milliseconds that a round was to take.
    pub target_ms: f64,
    /// Rounds.
    pub rounds: u64,
    /// Of them, over the target.
    pub over_target: u64,
    /// Nineteen of twenty took no more.
    pub p95_ms: f64,
    /// 99 of a hundred.
    pub p99_ms: f64,
    /// The slowest.
    pub worst_ms: f64,
    /// Bricks that a round was allowed, at least and at last.
    pub uploads_max: [u32; 2],
    /// What rays and host take beside bricks, as it is reckoned at last.
    pub base_ms: f64,
    /// What a brick takes.
    pub brick_ms: f64,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Pacer {
    target_ms: f64,
    now: Rung,
    line: Option<Line>,
    /// Of rays alone, and the square of what rounds go beyond it; 0 without timestamps.
    render_ms: f64,
    render_noise: f64,
    /// A view begins, of whose rays nothing is known.
    jumped: bool,
    /// What rays cost at each rung, as a part of the finest's.
    costs: [f64; LADDER.len()],
    /// The rung of before, and the rays' time there, until a round was measured at this one.
    stepped: Option<(Rung, f64)>,
    /// Measured for one brick, staging and copy together.
    brick_ms_min: f64,
    /// Of this view's rounds.
    periods_ms: Vec<f64>,
    uploads_least: u32,
}

impl Pacer {
    /// Rounds are to take so long.
    pub fn new(target_ms: f64) -> Pacer {
        Pacer {
            target_ms,
            now: Rung::FINEST,
            line: None,
            render_ms: 0.0,
            render_noise: 0.0,
            jumped: true,
            costs: LADDER.map(Rung::samples),
            stepped: None,
            brick_ms_min: 0.0,
            periods_ms: Vec::new(),
            uploads_least: UPLOADS_MAX,
        }
    }

    /// Rounds are to take so long from now on.
    pub fn aim_at(&mut self, target_ms: f64) {
        self.target_ms = target_ms;
    }

    /// Another view begins: rays may take another time; a brick does not.
    pub fn begin_view(&mut self) {
        self.periods_ms.clear();
        self.uploads_least = UPLOADS_MAX;
        self.jumped = true;
        if let Some(line) = self.line.as_mut().filter(|_| self.render_ms == 0.0) {
            line.jumps();
        }
    }

    /// Learns from a round.
    pub fn learn(&mut self, of: &Measured) {
        let bricks = f64::from(of.bricks);
        if of.bricks >= UPLOADS_MIN {
            let one = (of.copy_ms + of.staging_ms) / bricks;
            let known = self.brick_ms_min > 0.0;
            self.brick_ms_min += if known { 0.2 * (one - self.brick_ms_min) } else { one };
        }
        if let Some((from, before_ms)) = self.stepped.take()
            && before_ms > 0.0
            && of.render_ms > 0.0
        {
            let measured = self.costs[from.index()] * of.render_ms / before_ms;
            let cost = &mut self.costs[self.now.index()];
            *cost = (0.5 * (*cost + measured)).min(1.0);
            self.costs[0] = 1.0;
            self.render_ms = of.render_ms;
        }
        if std::mem::take(&mut self.jumped) {
            self.render_ms = of.render_ms;
            self.render_noise = (NOISE_MIN * of.render_ms).powi(2);
        } else {
            let beyond = (of.render_ms - self.render_ms).max(NOISE_MIN * of.render_ms);
            // What the system held up for long is no reason to expect the next to be.
            let beyond = beyond.min(0.5 * self.render_ms);
            self.render_noise += 0.15 * (beyond * beyond - self.render_noise);
            self.render_ms += 0.5 * (of.render_ms - self.render_ms);
        }
        let rest_ms = (of.period_ms - of.render_ms).max(0.0);
        let one = self.brick_ms_min;
        let slopes = if one > 0.0 { [one, SLOPE_OVER * one] } else { [0.0, f64::INFINITY] };
        match &mut self.line {
            None => self.line = Some(Line::first(rest_ms, bricks)),
            Some(line) => line.observe(bricks, rest_ms, slopes),
        }
        self.periods_ms.push(of.period_ms);
        self.uploads_least = self.uploads_least.min(self.uploads_max());
    }

    /// Bricks that the next round may upload.
    pub fn uploads_max(&self) -> u32 {
        let Some(line) = &self.line else { return UPLOADS_FIRST };
        let base = self.render_ms + line.base;
        let room = self.target_ms - base - SPREAD * (self.render_noise + line.spread()).sqrt();
        // Rays that take as long as the target, or longer: there is nothing to hold.
        let beyond = (10.0 * (base / self.target_ms - 0.9)).clamp(0.0, 1.0);
        let room = room.max(beyond * BEYOND_TARGET * base);
        let least = self.periods_ms.len() % PROBE_EVERY == PROBE_EVERY - 1;
        let room = if least { room * PROBE_PART } else { room };
        ((room / line.slope) as u32).clamp(UPLOADS_MIN, UPLOADS_MAX)
    }

    /// The next pictures are as coarse as this: rays take as much less.
    pub fn draw_at(&mut self, rung: Rung) {
        let from = std::mem::replace(&mut self.now, rung);
        if from == rung {
            return;
        }
        let ratio = self.costs[rung.index()] / self.costs[from.index()];
        self.stepped = Some((from, self.render_ms));
        match &mut self.line {
            // Without timestamps rays are the most of it.
            Some(line) if self.render_ms == 0.0 => line.base *= ratio,
            _ => self.render_ms *= ratio,
        }
    }

    /// How coarse the next picture should be while something moves: as good as the target allows.
    pub fn rung(&self) -> Rung {
        let Some(line) = &self.line else { return LADDER[2] };
        let now = self.costs[self.now.index()];
        let [rays_ms, host_ms] = match self.render_ms > 0.0 {
            true => [self.render_ms, line.base],
            false => [line.base, 0.0],
        };
        let fits = |rung: &Rung| {
            let cost = self.costs[rung.index()];
            let ms = host_ms + rays_ms * cost / now;
            let part = if cost > now { FINER_BELOW } else { 1.0 };
            ms <= part * (1.0 - FOR_BRICKS) * self.target_ms
        };
        LADDER.into_iter().find(fits).unwrap_or(LADDER[LADDER.len() - 1])
    }

    /// What this view came to so far.
    pub fn paced(&self) -> Paced {
        let of = Percentiles::of(self.periods_ms.clone());
        let over = self.periods_ms.iter().filter(|ms| **ms > self.target_ms).count();
        Paced {
            target_ms: self.target_ms,
            rounds: of.count,
            over_target: over as u64,
            p95_ms: of.p95,
            p99_ms: of.p99,
            worst_ms: of.worst,
            uploads_max: [self.uploads_least.min(self.uploads_max()), self.uploads_max()],
            base_ms: self.line.as_ref().map_or(0.0, |line| self.render_ms + line.base),
            brick_ms: self.line.as_ref().map_or(0.0, |line| line.slope),
        }
    }
}

/// `base + slope * bricks`, with what is known of both: their covariance.
#[derive(Clone, Debug)]
struct Line {
    base: f64,
    slope: f64,
    /// Of base, of both, of slope.
    variance: [f64; 3],
    /// Of a round's time about the line.
    noise: f64,
    /// A view begins, of which the base is not known.
    jumped: bool,
}

/// Milliseconds that a brick is taken to cost before any was measured.
const SLOPE_FIRST: f64 = 0.25;
/// A brick costs at most so many times what copying and staging it were measured to take: loaders take from rays' cores
/// what nobody measures.
const SLOPE_OVER: f64 = 8.0;
/// Part of base and slope that they may drift by from one round to the next.
const DRIFT: f64 = 0.05;
/// Part of the base by which it may jump where a view begins.
const JUMP: f64 = 0.5;
/// Least noise, as a part of the base: no clock and no system is better.
const NOISE_MIN: f64 = 0.02;

impl Line {
    fn first(ms: f64, bricks: f64) -> Line {
        let base = (ms - SLOPE_FIRST * bricks).max(0.5 * ms);
        let variance = [(JUMP * base).powi(2), 0.0, SLOPE_FIRST.powi(2)];
        Line { base, slope: SLOPE_FIRST, variance, noise: (0.1 * base).powi(2), jumped: true }
    }

    fn jumps(&mut self) {
        self.jumped = true;
    }

    /// `slopes`: no brick costs less, and none more.
    fn observe(&mut self, bricks: f64, ms: f64, slopes: [f64; 2]) {
        let [mut of_base, mut of_both, mut of_slope] = self.variance;
        let drift = if std::mem::take(&mut self.jumped) { JUMP } else { DRIFT };
        of_base += (drift * self.base).powi(2);
        of_slope += (DRIFT * self.slope).powi(2);
        let off = ms - (self.base + self.slope * bricks);
        let with_base = of_base + of_both * bricks;
        let with_slope = of_both + of_slope * bricks;
        let expected = with_base + with_slope * bricks;
        let least = (NOISE_MIN * self.base).powi(2).max(1e-4);
        let all = expected + self.noise;
        let [gain_base, gain_slope] = [with_base / all, with_slope / all];
        self.base += gain_base * off;
        self.slope += gain_slope * off;
        of_base -= gain_base * with_base;
        of_both -= gain_base * with_slope;
        of_slope -= gain_slope * with_slope;
        self.variance = [of_base, of_both, of_slope];
        // Where the base was not known, nothing is said of what rounds spread by; nor by one that was quicker, or
        // that the system held up for long.
        if drift < JUMP {
            let surprise = if off > 0.0 { off * off - expected } else { 0.0 };
            let surprise = surprise.clamp(least, 16.0 * self.noise.max(least));
            self.noise = (0.85 * self.noise + 0.15 * surprise).max(least);
        }
        self.base = self.base.max(0.0);
        self.slope = self.slope.clamp(slopes[0], slopes[1]).max(1e-3);
    }

    /// Variance of a round's time where few bricks come.
    fn spread(&self) -> f64 {
        self.variance[0].max(0.0) + self.noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine whose rounds take what a formula says, and a noise that repeats.
    fn run(
        pacer: &mut Pacer,
        rounds: u32,
        wanted: &mut u32,
        ms: impl Fn(u32) -> f64,
        delivered: u32,
    ) -> Vec<(u32, f64)> {
        (0..rounds)
            .map(|round| {
                let bricks = pacer.uploads_max().min(*wanted).min(delivered);
                *wanted -= bricks;
                let wobble = 1.0 + 0.03 * f64::from(round * 7919 % 13) / 13.0;
                let period_ms = ms(bricks) * wobble;
                let of_bricks = 0.25 * (ms(bricks) - ms(0));
                pacer.learn(&Measured {
                    period_ms,
                    render_ms: ms(0),
                    copy_ms: of_bricks / 2.0,
                    staging_ms: of_bricks / 2.0,
                    bricks,
                });
                (bricks, period_ms)
            })
            .collect()
    }

    #[test]
    fn rounds_keep_to_the_target_and_use_it() {
        for slope in [0.1, 0.4, 2.0] {
            let mut pacer = Pacer::new(33.0);
            let mut wanted = 100_000;
            let ran = run(&mut pacer, 120, &mut wanted, |n| 12.0 + slope * f64::from(n), 4096);
            let late = &ran[20..];
            let over = late.iter().filter(|(_, ms)| *ms > 33.0).count();
            assert!(over <= late.len() / 20, "slope {slope}: {over} of {} over", late.len());
            let mean = late.iter().map(|(_, ms)| ms).sum::<f64>() / late.len() as f64;
            assert!(mean > 24.0, "slope {slope}: {mean} ms of 33 used");
        }
    }

    #[test]
    fn a_sudden_zoom_is_followed_within_a_few_rounds() {
        let mut pacer = Pacer::new(40.0);
        let mut wanted = 1_000_000;
        run(&mut pacer, 60, &mut wanted, |n| 8.0 + 0.3 * f64::from(n), 4096);
        pacer.begin_view();
        let ran = run(&mut pacer, 40, &mut wanted, |n| 26.0 + 0.3 * f64::from(n), 4096);
        let over = ran.iter().filter(|(_, ms)| *ms > 40.0).count();
        assert!(over <= 5, "{over} rounds over: {ran:?}");
        assert!(ran[6..].iter().all(|(_, ms)| *ms < 42.0), "{ran:?}");
    }

    #[test]
    fn after_a_slow_disk_no_burst_comes() {
        let mut pacer = Pacer::new(40.0);
        let mut wanted = 1_000_000;
        run(&mut pacer, 40, &mut wanted, |n| 10.0 + 0.3 * f64::from(n), 4096);
        let slow = run(&mut pacer, 60, &mut wanted, |n| 10.0 + 0.3 * f64::from(n), 3);
        assert!(slow.iter().all(|(bricks, _)| *bricks <= 3));
        let ran = run(&mut pacer, 40, &mut wanted, |n| 10.0 + 0.3 * f64::from(n), 4096);
        let over = ran.iter().filter(|(_, ms)| *ms > 40.0).count();
        assert!(over <= 3, "{over} rounds over: {ran:?}");
    }

    #[test]
    fn beyond_the_target_it_still_goes_on() {
        let mut pacer = Pacer::new(10.0);
        let mut wanted = 1_000_000;
        let ran = run(&mut pacer, 60, &mut wanted, |n| 100.0 + 0.5 * f64::from(n), 4096);
        let last = ran[ran.len() - 1].0;
        assert!((80..=300).contains(&last), "about as long as the rays: {last} bricks");
    }

    #[test]
    fn what_moves_gets_as_coarse_as_it_must_and_no_coarser() {
        let mut pacer = Pacer::new(50.0);
        let mut wanted = 0;
        run(&mut pacer, 10, &mut wanted, |_| 30.0, 0);
        assert_eq!(pacer.rung(), Rung::FINEST);
        pacer.begin_view();
        run(&mut pacer, 10, &mut wanted, |_| 150.0, 0);
        assert_eq!(pacer.rung(), LADDER[2]);
        // As coarse as that, it takes a quarter: no reason to go back and forth.
        pacer.draw_at(LADDER[2]);
        assert_eq!(pacer.rung(), LADDER[2]);
        pacer.begin_view();
        run(&mut pacer, 10, &mut wanted, |_| 37.5, 0);
        assert_eq!(pacer.rung(), LADDER[2]);
        pacer.begin_view();
        run(&mut pacer, 10, &mut wanted, |_| 4.0, 0);
        assert_eq!(pacer.rung(), Rung::FINEST);
    }

    #[test]
    fn what_a_rung_costs_is_learned() {
        let mut pacer = Pacer::new(50.0);
        let mut wanted = 0;
        run(&mut pacer, 10, &mut wanted, |_| 100.0, 0);
        // Half the samples take four fifths of the time here.
        pacer.draw_at(LADDER[1]);
        run(&mut pacer, 6, &mut wanted, |_| 80.0, 0);
        pacer.draw_at(LADDER[0]);
        run(&mut pacer, 6, &mut wanted, |_| 100.0, 0);
        pacer.draw_at(LADDER[1]);
        run(&mut pacer, 6, &mut wanted, |_| 80.0, 0);
        pacer.draw_at(LADDER[0]);
        run(&mut pacer, 6, &mut wanted, |_| 100.0, 0);
        pacer.aim_at(88.0);
        assert_eq!(
            pacer.rung(),
            LADDER[2],
            "{:?}: 80 of 88 ms leave nothing for bricks",
            pacer.costs
        );
        pacer.aim_at(110.0);
        assert_eq!(pacer.rung(), LADDER[1], "{:?}", pacer.costs);
    }

    #[test]
    fn a_first_round_that_compiles_is_forgotten() {
        let mut pacer = Pacer::new(50.0);
        pacer.learn(&Measured { period_ms: 900.0, render_ms: 20.0, ..Measured::default() });
        let mut wanted = 1_000_000;
        let ran = run(&mut pacer, 8, &mut wanted, |n| 20.0 + 0.2 * f64::from(n), 4096);
        assert!(ran[4].0 > 50, "{ran:?}");
    }

    #[test]
    fn the_ladder_goes_down() {
        for pair in LADDER.windows(2) {
            let ratio = pair[1].samples() / pair[0].samples();
            assert!((0.25..=0.5).contains(&ratio), "{pair:?}");
        }
    }
}
