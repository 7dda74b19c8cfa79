//! Whether rounds keep to a target: step responses along one path, with the pacer and with constant budgets.
//!
//! The path: everything from nothing; a sudden zoom; the same from the side while the disk is slow; a second view
//! beside it; and a camera that turns. Each way begins with nothing on the device and nothing in RAM. What a coarser
//! picture costs in error is measured against the finished picture of the same view.
//!
//! # Units
//! Milliseconds on the wall: what somebody waits.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::error::Result;
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::{RoundPace, Rung};
use crate::render::{Picture, Plan, Renderer, SceneChange, SceneData, Settings};
use crate::scene::{Scene, View};
use crate::source::{BrickEntry, BrickSource, Description};
use crate::study::error_metrics::picture_error;
use crate::trace::summary::Percentiles;
use crate::volume::BrickId;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// What a frame is to take, ms.
    pub frame_ms: f64,
    /// Constant budgets to compare with, bricks a round.
    pub constants: Vec<u32>,
    /// What the slow disk takes for a brick more, ms.
    pub disk_ms: f64,
    /// How often the path is gone along; all frames count.
    pub repeats: u32,
}

/// One frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameRow {
    /// "paced", or the constant budget.
    pub way: String,
    /// Part of the path.
    pub step: &'static str,
    /// Which turn of the repeats, from 0.
    pub turn: u32,
    /// From the beginning of the path.
    pub at_ms: f64,
    /// Since the frame before.
    pub frame_ms: f64,
    /// Bricks uploaded in it.
    pub bricks: u64,
    /// Bricks that it might have uploaded.
    pub uploads_max: Option<u32>,
    /// What rays and host are reckoned to take of it, and a brick, ms.
    pub reckoned_ms: Option<[f64; 2]>,
    /// How coarse it was.
    pub rung: Rung,
    /// Of a frame that moves, against the finished picture; infinite where it is that.
    pub psnr_db: Option<f64>,
}

/// A part of the path, one way.
#[derive(Clone, Debug, Serialize)]
pub struct StepRow {
    /// "paced", or the constant budget.
    pub way: String,
    /// Part of the path.
    pub step: &'static str,
    /// Frames until it had converged, on average over turns.
    pub frames: f64,
    /// Milliseconds until then, likewise.
    pub ms: f64,
    /// Part of all frames that took longer than the target.
    pub over_target: f64,
    /// Nineteen of twenty frames took no more.
    pub p95_ms: f64,
    /// 99 of a hundred.
    pub p99_ms: f64,
    /// The slowest.
    pub worst_ms: f64,
    /// Mean of frames that move; nothing where none does.
    pub psnr_db: Option<f64>,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub struct PacingTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// What times are by: "wall".
    pub clock: &'static str,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// What a frame was to take, ms.
    pub target_ms: f64,
    /// How often the path was gone along.
    pub repeats: u32,
    /// By way, then by part of the path.
    pub steps: Vec<StepRow>,
    /// Frame by frame.
    #[serde(skip)]
    pub frames: Vec<FrameRow>,
}

/// Parts of the path, in order.
pub const STEPS: [&str; 5] = ["from nothing", "sudden zoom", "slow disk", "second view", "turning"];
/// Frames of the camera that turns, and how far each.
const TURNING_FRAMES: usize = 24;
const TURNING_DEGREES: f64 = 2.5;
/// The zoom goes to this part of the distance.
const ZOOM: f64 = 0.45;
/// Frames after which a step is given up.
const FRAMES_MAX: usize = 2000;

/// A disk that takes as long as it is told for every brick.
struct SlowDisk {
    source: Arc<dyn BrickSource>,
    delay_us: Arc<AtomicU64>,
}

impl BrickSource for SlowDisk {
    fn description(&self) -> &Description {
        self.source.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.source.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        std::thread::sleep(Duration::from_micros(self.delay_us.load(Ordering::Relaxed)));
        self.source.read(id, bytes)
    }
}

/// Goes along the path in every way; `progress` is told the finished part.
///
/// # Errors
/// As drawing does.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    data: &SceneData,
    settings: Settings,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<PacingTable> {
    let ways: Vec<Option<u32>> =
        std::iter::once(None).chain(effort.constants.iter().copied().map(Some)).collect();
    let mut finished = Vec::new();
    let mut frames: Vec<FrameRow> = Vec::new();
    let runs = ways.len() * effort.repeats as usize;
    for turn in 0..effort.repeats {
        for (at, constant) in ways.iter().enumerate() {
            let mut along = Along::begin(gpu, compiler, data, settings, effort, (*constant, turn))?;
            along.go(&mut finished)?;
            frames.append(&mut along.rows);
            progress((turn as usize * ways.len() + at + 1) as f64 / runs as f64);
        }
    }
    let steps = ways.iter().flat_map(|way| {
        let name = name_of(*way);
        STEPS.iter().map(move |step| (name.clone(), *step))
    });
    Ok(PacingTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: "wall",
        size: data.scene.picture.size,
        target_ms: effort.frame_ms,
        repeats: effort.repeats,
        steps: steps.map(|(way, step)| row(&frames, way, step, effort)).collect(),
        frames,
    })
}

fn name_of(constant: Option<u32>) -> String {
    constant.map_or("paced".to_owned(), |bricks| format!("{bricks} bricks"))
}

fn row(frames: &[FrameRow], way: String, step: &'static str, effort: &Effort) -> StepRow {
    let of_step: Vec<&FrameRow> =
        frames.iter().filter(|frame| frame.way == way && frame.step == step).collect();
    let ms: Vec<f64> = of_step.iter().map(|frame| frame.frame_ms).collect();
    let (over, all) =
        (ms.iter().filter(|ms| **ms > effort.frame_ms).count(), ms.iter().sum::<f64>());
    let of = Percentiles::of(ms);
    let turns = f64::from(effort.repeats.max(1));
    let db: Vec<f64> = of_step.iter().filter_map(|frame| frame.psnr_db).collect();
    StepRow {
        way,
        step,
        frames: of.count as f64 / turns,
        ms: all / turns,
        over_target: over as f64 / of.count.max(1) as f64,
        p95_ms: of.p95,
        p99_ms: of.p99,
        worst_ms: of.worst,
        psnr_db: (!db.is_empty()).then(|| db.iter().sum::<f64>() / db.len() as f64),
    }
}

/// One way along the path.
struct Along<'a> {
    gpu: &'a Arc<Gpu>,
    compiler: &'a ShaderCompiler,
    data: SceneData,
    settings: Settings,
    renderer: Renderer,
    delay_us: Arc<AtomicU64>,
    effort: &'a Effort,
    constant: Option<u32>,
    turn: u32,
    begun: Instant,
    last: Instant,
    uploaded: u64,
    rung: Rung,
    /// Of the frame that moves next, as the pacer advises.
    next_rung: Rung,
    uploads_max: Option<u32>,
    reckoned_ms: Option<[f64; 2]>,
    rows: Vec<FrameRow>,
}

impl<'a> Along<'a> {
    fn begin(
        gpu: &'a Arc<Gpu>,
        compiler: &'a ShaderCompiler,
        data: &SceneData,
        mut settings: Settings,
        effort: &'a Effort,
        (constant, turn): (Option<u32>, u32),
    ) -> Result<Along<'a>> {
        let delay_us = Arc::<AtomicU64>::default();
        let mut slow = data
            .again(Scene { views: vec![data.scene.views[0].clone(); 2], ..data.scene.clone() })?;
        let source = slow.volumes[0].source.clone();
        slow.volumes[0].source = Arc::new(SlowDisk { source, delay_us: delay_us.clone() });
        settings.paging.grants_per_round = constant;
        // Of each of two views; a step with one view sets its own.
        let us = (effort.frame_ms * 1e3) as u32;
        settings.paging.frame_us = constant.is_none().then_some(us);
        let plan = Plan::new(gpu, compiler, &slow, &settings)?;
        let renderer = Renderer::new(gpu, plan, &slow)?;
        let now = Instant::now();
        Ok(Along {
            gpu,
            compiler,
            data: slow,
            settings,
            renderer,
            delay_us,
            effort,
            constant,
            turn,
            begun: now,
            last: now,
            uploaded: 0,
            rung: Rung::FINEST,
            next_rung: Rung::FINEST,
            uploads_max: None,
            reckoned_ms: None,
            rows: Vec::new(),
        })
    }

    /// All of the path; `finished` are the pictures of the turning camera's views, drawn once.
    fn go(&mut self, finished: &mut Vec<Picture>) -> Result<()> {
        let middle = self.data.middle_world(0);
        let far = self.data.scene.views[0].clone();
        let near = View { eye: middle + (far.eye - middle) * ZOOM, ..far.clone() };
        let side = near.turned(middle, 35.0);
        let second = near.turned(middle, 43.0);
        let turning: Vec<View> = (1..=TURNING_FRAMES)
            .map(|frame| far.turned(middle, TURNING_DEGREES * frame as f64))
            .collect();
        if finished.is_empty() {
            *finished = self.finished_pictures(&turning)?;
        }
        (self.begun, self.last) = (Instant::now(), Instant::now());
        self.renderer.target_round(self.effort.frame_ms);
        for (step, view) in STEPS.into_iter().zip([&far, &near]) {
            self.change([view, view], Rung::FINEST)?;
            self.until_converged(step)?;
        }
        self.delay_us.store((self.effort.disk_ms * 1e3) as u64, Ordering::Relaxed);
        self.change([&side, &side], Rung::FINEST)?;
        self.until_converged(STEPS[2])?;
        self.delay_us.store(0, Ordering::Relaxed);
        self.renderer.target_round(self.effort.frame_ms / 2.0);
        self.change([&side, &second], Rung::FINEST)?;
        self.two_until_converged(STEPS[3])?;
        self.renderer.target_round(self.effort.frame_ms);
        // The camera is back where it turns from before anybody looks.
        self.change([&far, &far], Rung::FINEST)?;
        self.until_converged("back")?;
        for (view, finished) in turning.iter().zip(finished.iter()) {
            let rung = if self.constant.is_none() { self.next_rung } else { Rung::FINEST };
            self.change([view, view], rung)?;
            let picture = self.one_round(0)?;
            self.frame(STEPS[4], Instant::now());
            let truth: Vec<[f64; 4]> =
                finished.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
            let shown = as_large(&picture, finished.size);
            let error = picture_error(&shown, &truth);
            if let Some(row) = self.rows.last_mut() {
                row.psnr_db = Some(error.whole.psnr_db);
            }
            // Looking at it is no part of the path.
            self.last = Instant::now();
        }
        self.rows.retain(|row| row.step != "back");
        Ok(())
    }

    fn finished_pictures(&self, views: &[View]) -> Result<Vec<Picture>> {
        let mut settings = self.settings;
        settings.paging.frame_us = None;
        settings.paging.grants_per_round = None;
        let scene = Scene { views: views.to_vec(), ..self.data.scene.clone() };
        let data = self.data.again(scene)?;
        let plan = Plan::new(self.gpu, self.compiler, &data, &settings)?;
        let mut renderer = Renderer::new(self.gpu, plan, &data)?;
        (0..views.len()).map(|view| Ok(renderer.draw(view, &mut |_| {})?.0)).collect()
    }

    /// Another scene is looked at, as coarse as `rung`.
    fn change(&mut self, views: [&View; 2], rung: Rung) -> Result<()> {
        self.renderer.begin_frame();
        let mut scene = self.data.scene.clone();
        scene.views = views.map(View::clone).to_vec();
        scene.picture.size = scene.picture.size.map(|edge| edge.div_ceil(rung.wider).max(1));
        scene.quality.step *= f64::from(rung.longer);
        let data = self.data.again(scene)?;
        let change = SceneChange::new(self.gpu, self.compiler, self.renderer.plan(), data)?;
        self.renderer.change(change)?;
        self.renderer.draw_at(rung);
        self.rung = rung;
        Ok(())
    }

    /// A frame was there at some moment.
    fn frame(&mut self, step: &'static str, at: Instant) {
        let ms = |since: Instant| (at - since).as_secs_f64() * 1e3;
        self.rows.push(FrameRow {
            way: name_of(self.constant),
            step,
            turn: self.turn,
            at_ms: ms(self.begun),
            frame_ms: ms(self.last),
            bricks: self.uploaded,
            uploads_max: self.constant.or(self.uploads_max),
            reckoned_ms: self.reckoned_ms,
            rung: self.rung,
            psnr_db: None,
        });
        self.last = at;
    }

    fn heed(&mut self, pace: Option<&RoundPace>) {
        if let Some(pace) = pace {
            self.next_rung = pace.rung;
            self.uploads_max = Some(pace.paced.uploads_max[1]);
            self.reckoned_ms = Some([pace.paced.base_ms, pace.paced.brick_ms]);
        }
    }

    fn until_converged(&mut self, step: &'static str) -> Result<()> {
        let mut rounds = Vec::new();
        self.renderer.draw_watched(0, &mut |round| {
            rounds.push((Instant::now(), round.bricks_uploaded, round.pace));
            match rounds.len() < FRAMES_MAX {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        })?;
        let mut before = 0;
        for (at, uploaded, pace) in rounds {
            self.heed(pace.as_ref());
            self.uploaded = uploaded - before;
            before = uploaded;
            self.frame(step, at);
        }
        Ok(())
    }

    /// One round of each, until both have converged: two eyes, or two windows.
    fn two_until_converged(&mut self, step: &'static str) -> Result<()> {
        let mut done = [false; 2];
        for _ in 0..FRAMES_MAX {
            let mut uploaded = 0;
            for (view, done) in done.iter_mut().enumerate() {
                if !*done {
                    let mut of_round = None;
                    let whole = self.renderer.draw_watched(view, &mut |round| {
                        of_round = Some(round);
                        ControlFlow::Break(())
                    })?;
                    *done = whole.is_some();
                    if let Some(round) = of_round {
                        self.heed(round.pace.as_ref());
                        uploaded += round.bricks_uploaded;
                        *done |= round.cache.missed == 0;
                    }
                }
            }
            self.uploaded = uploaded;
            self.frame(step, Instant::now());
            if done == [true; 2] {
                break;
            }
        }
        Ok(())
    }

    fn one_round(&mut self, view: usize) -> Result<Picture> {
        let mut drawn = None;
        let whole = self.renderer.draw_watched(view, &mut |round| {
            drawn = Some(round);
            ControlFlow::Break(())
        })?;
        if let Some(round) = &drawn {
            self.heed(round.pace.as_ref());
            self.uploaded = round.bricks_uploaded;
        }
        match (whole, drawn) {
            (Some((picture, _)), _) => Ok(picture),
            (None, Some(round)) => Ok(round.picture),
            (None, None) => unreachable!("a drawing ends with a picture or with a round"),
        }
    }
}

/// A coarse picture as a window shows it: every pixel as large as it stands for.
fn as_large(picture: &Picture, size: [u32; 2]) -> Vec<[f32; 4]> {
    let from = |at: u32, axis: usize| {
        let [of, to] = [picture.size[axis], size[axis]].map(u64::from);
        (u64::from(at) * of / to) as usize
    };
    let rows = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    rows.map(|(x, y)| picture.pixels[from(y, 1) * picture.size[0] as usize + from(x, 0)]).collect()
}

/// Frames as comma-separated values, with a line of names.
pub fn csv(table: &PacingTable) -> String {
    let mut text = String::from(
        "way,step,turn,at_ms,frame_ms,target_ms,bricks,uploads_max,base_ms,brick_ms,wider,longer,psnr_db\n",
    );
    for row in &table.frames {
        text += &format!(
            "{},{},{},{:.3},{:.3},{},{},{},{},{},{},{}\n",
            row.way,
            row.step,
            row.turn,
            row.at_ms,
            row.frame_ms,
            table.target_ms,
            row.bricks,
            row.uploads_max.map(|bricks| bricks.to_string()).unwrap_or_default(),
            row.reckoned_ms.map_or(",".to_owned(), |[base, brick]| format!("{base:.2},{brick:.3}")),
            row.rung.wider,
            row.rung.longer,
            row.psnr_db.map(|db| format!("{db:.2}")).unwrap_or_default(),
        );
    }
    text
}
