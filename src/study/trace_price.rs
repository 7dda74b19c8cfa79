//! What recording a trace costs: the same views drawn in turns with a trace, without one, and once more without one.
//!
//! # Definitions
//! - *On*: time with a trace over time without, of the same view in the same turn.
//! - *Noise*: the same of two that both draw without: what a ratio of 1 looks like on this machine.
//! - *Off*: how often a trace was told something while a frame was drawn, times what a place costs that finds none,
//!   over the frame's time. A trace that is none is an `Option` that is looked at.
//!
//! # Invariants
//! All three draw the same bytes: otherwise there is no table.

use std::hint::black_box;
use std::io::{self, Write};
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use crate::error::{Error, Exit, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::{Picture, Plan, Renderer, SceneData, Settings, Statistics};
use crate::study::repeated::{Spread, Timer, Took};
use crate::trace::{Details, Trace, TraceOptions, TraceSize};

/// Recording may cost this ratio.
pub const GOAL: f64 = 1.03;
/// Events that the trace keeps: the latest, so that late frames cost as much as early ones.
const EVENTS_KEPT: usize = 200_000;
/// Places without a trace, timed together; the least of so many turns counts.
const PLACES: u32 = 10_000_000;
const PLACE_TURNS: usize = 5;

/// What it costs.
#[derive(Clone, Debug, Serialize)]
pub struct TracePrice {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "wall": whose time the ratios count.
    pub clock: &'static str,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Views, each drawn in every turn.
    pub views: usize,
    /// Turns that count.
    pub repeats: u32,
    /// At most this is the goal of `ratio`.
    pub ratio_goal: f64,
    /// A view without a trace.
    pub off_ms: Spread,
    /// A view with one.
    pub on_ms: Spread,
    /// On over off, each of the same view and turn.
    pub ratio: Spread,
    /// The same on the wall, if that is not the clock.
    pub wall_ratio: Spread,
    /// Off over off, likewise.
    pub noise: Spread,
    /// The middle half of the ratios: what a repetition would likely say.
    pub ratio_middle_half: [f64; 2],
    /// Rounds of a frame, in the mean.
    pub rounds: f64,
    /// Bricks that came in a frame, in the mean.
    pub bricks_uploaded: f64,
    /// Events of a frame, in the mean.
    pub events: f64,
    /// Bytes of memory that these take.
    pub memory_bytes: f64,
    /// Bytes of the file that these take.
    pub file_bytes: f64,
    /// How often a trace was told something in a frame, in the mean.
    pub places: f64,
    /// Nanoseconds of a place that finds no trace.
    pub place_ns: f64,
    /// All of them over the frame's time, where there is no trace.
    pub off_share: f64,
}

/// The ways, in this order.
const OFF: usize = 0;
const ON: usize = 1;
const OFF_AGAIN: usize = 2;

/// Draws and reckons; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device does not hold three of the scene's atlases or is lost, 6 when pictures differ, 5 when
/// one stays unfinished.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    data: &SceneData,
    settings: &Settings,
    repeats: u32,
    progress: &mut dyn FnMut(f64),
) -> Result<TracePrice> {
    let timer = Timer::of(gpu);
    let options =
        TraceOptions { events_max: EVENTS_KEPT, keep_latest: true, ..TraceOptions::default() };
    let trace = Trace::new(gpu, options);
    let make = |trace| {
        let plan = Plan::new(gpu, compiler, data, settings)?;
        Renderer::traced(gpu, plan, data, trace)
    };
    let mut ways = [make(None)?, make(Some(&trace))?, make(None)?];
    let views = data.scene.views.len();
    let frames = f64::from(repeats + 1) * views as f64;
    let mut took: [Vec<Took>; 3] = Default::default();
    let mut sums = Sums::default();
    let mut before = TraceSize::default();
    for turn in 0..=repeats {
        // The first turn warms up.
        if turn == 1 {
            before = trace.size();
            sums = Sums::default();
            took = Default::default();
        }
        for view in 0..views {
            let mut pictures: [Option<Picture>; 3] = Default::default();
            // Each way goes first as often as the others.
            for place in 0..ways.len() {
                let way = (place + turn as usize + view) % ways.len();
                let ((picture, statistics), spent) =
                    timer.time(|| ways[way].draw(view, &mut |_| {}))?;
                took[way].push(spent);
                sums.add(way, &statistics)?;
                pictures[way] = Some(picture);
            }
            same_bytes(&pictures)?;
            progress((f64::from(turn) * views as f64 + (view + 1) as f64) / frames);
        }
    }
    let after = trace.size();
    let per_frame = |all: u64| all as f64 / took[ON].len().max(1) as f64;
    let (events, places) =
        (per_frame(after.events - before.events), per_frame(after.told - before.told));
    let ms = took.each_ref().map(|of| of.iter().map(|took| took.ms).collect::<Vec<f64>>());
    let wall = took.each_ref().map(|of| of.iter().map(|took| took.wall_ms).collect::<Vec<f64>>());
    let (off_ms, place_ns) = (Spread::of(&ms[OFF]), place_ns());
    let size = data.scene.picture.size;
    Ok(TracePrice {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: timer.name("wall"),
        size,
        views,
        repeats,
        ratio_goal: GOAL,
        off_ms,
        on_ms: Spread::of(&ms[ON]),
        ratio: Spread::of_ratios(&ms[ON], &ms[OFF]),
        wall_ratio: Spread::of_ratios(&wall[ON], &wall[OFF]),
        noise: Spread::of_ratios(&ms[OFF_AGAIN], &ms[OFF]),
        ratio_middle_half: middle_half(&ms[ON], &ms[OFF]),
        rounds: per_frame(sums.rounds),
        bricks_uploaded: per_frame(sums.bricks_uploaded),
        events,
        memory_bytes: events * after.event_bytes as f64,
        file_bytes: events * file_bytes_of_event(&trace)?,
        places,
        place_ns,
        off_share: places * place_ns * 1e-6 / off_ms.median,
    })
}

/// What frames with a trace did.
#[derive(Default)]
struct Sums {
    rounds: u64,
    bricks_uploaded: u64,
}

impl Sums {
    fn add(&mut self, way: usize, statistics: &Statistics) -> Result<()> {
        if let Some(why) = statistics.lacks() {
            let message = format!("a view {why}: it cannot be timed");
            return Err(Error { exit: Exit::Incomplete, message });
        }
        if way == ON {
            self.rounds += statistics.rounds;
            self.bricks_uploaded += statistics.bricks_uploaded;
        }
        Ok(())
    }
}

fn same_bytes(pictures: &[Option<Picture>; 3]) -> Result<()> {
    let bits = |picture: &Picture| -> Vec<[u32; 4]> {
        picture.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    };
    let [off, on, again] = pictures.each_ref().map(|picture| picture.as_ref().map(bits));
    match off == on && off == again {
        true => Ok(()),
        false => Err(Error::difference("a trace changed the picture: report this")),
    }
}

/// The lower and the upper quartile of the ratios.
fn middle_half(above: &[f64], below: &[f64]) -> [f64; 2] {
    let mut ratios: Vec<f64> =
        above.iter().zip(below).map(|(above, below)| above / below).collect();
    ratios.sort_by(f64::total_cmp);
    let last = ratios.len().saturating_sub(1) as f64;
    [0.25, 0.75].map(|part| ratios.get((last * part).round() as usize).copied().unwrap_or(f64::NAN))
}

/// Of the events that are kept, in the mean, names and flows included.
fn file_bytes_of_event(trace: &Trace) -> Result<f64> {
    let mut counted = Counted::default();
    trace
        .write(&mut counted)
        .map_err(|why| Error { exit: Exit::Bug, message: format!("counting bytes: {why}") })?;
    let kept = trace.size().events.min(EVENTS_KEPT as u64);
    Ok(counted.bytes as f64 / kept.max(1) as f64)
}

/// Takes bytes and keeps their number.
#[derive(Default)]
struct Counted {
    bytes: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Nanoseconds of a span that would begin and end where there is no trace.
fn place_ns() -> f64 {
    let trace: Option<Arc<Trace>> = None;
    let turn = |_| {
        let begin = Instant::now();
        for _ in 0..PLACES {
            // As `Renderer::span`: the compiler may not know that there is none.
            let span = black_box(&trace).as_ref().map(|trace| trace.begin("round", Details::None));
            black_box(&span);
        }
        begin.elapsed().as_nanos() as f64 / f64::from(PLACES)
    };
    (0..PLACE_TURNS).map(turn).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_half_leaves_a_quarter_at_each_end() {
        let above = [1.0, 2.0, 3.0, 4.0, 100.0];
        assert_eq!(middle_half(&above, &[1.0; 5]), [2.0, 4.0]);
        assert!(middle_half(&[], &[])[0].is_nan());
    }

    #[test]
    fn a_picture_that_differs_in_one_bit_is_noticed() {
        let picture =
            |red: f32| Some(Picture { size: [1, 1], pixels: vec![[red, f32::NAN, 0.0, 1.0]] });
        assert!(same_bytes(&[picture(0.5), picture(0.5), picture(0.5)]).is_ok());
        let why = same_bytes(&[picture(0.0), picture(-0.0), picture(0.0)]).expect_err("a bit");
        assert_eq!(why.exit, Exit::Difference);
        assert!(same_bytes(&[picture(0.5), picture(0.5), picture(0.6)]).is_err());
    }

    #[test]
    fn a_place_without_a_trace_takes_nanoseconds() {
        let ns = place_ns();
        assert!(ns > 0.0 && ns < 1000.0, "{ns}");
    }
}
