//! Frames of several scenes that are on the device already, drawn in turns: what disturbs the machine
//! disturbs all of them alike, and ratios are of frames of one turn.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::{Picture, Plan, Renderer, SceneData, Settings, Statistics};
use crate::study::repeated::Timer;

/// One scene, drawn again and again.
pub struct ResidentScene {
    renderer: Renderer,
    /// Views that are drawn, from the first on.
    views: usize,
    /// Of the frame that brought everything to the device.
    pub first: Statistics,
    frames: Vec<Frame>,
}

/// A frame that counts.
struct Frame {
    ms: f64,
    statistics: Statistics,
}

/// A frame that counts, as it was just drawn.
pub struct Drawn {
    /// Which of the scenes.
    pub scene: usize,
    /// Which view.
    pub view: usize,
    /// What it shows.
    pub picture: Picture,
}

impl ResidentScene {
    /// Makes what the scene's plan lists and draws its first view once, which brings everything to the
    /// device.
    ///
    /// # Errors
    /// Exit code 4 when the device does not hold all of it.
    pub fn new(
        gpu: &Arc<Gpu>,
        compiler: &ShaderCompiler,
        data: &SceneData,
        settings: &Settings,
    ) -> Result<(ResidentScene, Picture)> {
        let plan = Plan::new(gpu, compiler, data, settings)?;
        let mut renderer = Renderer::new(gpu, plan, data)?;
        let (picture, first) = renderer.draw(0, &mut |_| {})?;
        match first.converged {
            true => Ok((ResidentScene { renderer, views: 1, first, frames: Vec::new() }, picture)),
            false => Err(not_resident()),
        }
    }

    /// As [`ResidentScene::new`], of all views of the scene; `step` is told each that is drawn.
    ///
    /// # Errors
    /// As [`ResidentScene::new`].
    pub fn of_all_views(
        gpu: &Arc<Gpu>,
        compiler: &ShaderCompiler,
        data: &SceneData,
        settings: &Settings,
        step: &mut dyn FnMut(),
    ) -> Result<ResidentScene> {
        let (mut scene, _) = ResidentScene::new(gpu, compiler, data, settings)?;
        step();
        scene.views = data.scene.views.len();
        for view in 1..scene.views {
            let (_, statistics) = scene.renderer.draw(view, &mut |_| {})?;
            if !statistics.converged {
                return Err(not_resident());
            }
            step();
        }
        Ok(scene)
    }

    fn draw(&mut self, view: usize, timer: Timer) -> Result<(Frame, Picture)> {
        let ((picture, statistics), took) = timer.time(|| self.renderer.draw(view, &mut |_| {}))?;
        if statistics.bricks_uploaded > 0 {
            return Err(not_resident());
        }
        let ms = match timer.counts_processor() {
            true => took.ms,
            false => device_ms(&statistics, |pass| pass != "upload"),
        };
        Ok((Frame { ms, statistics }, picture))
    }

    /// Draws all views so often that what chooses by measurement has measured; none of it counts, and what
    /// one way needs beyond the other may come.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn settle(&mut self, turns: u32) -> Result<()> {
        (0..turns).try_for_each(|_| {
            (0..self.views).try_for_each(|view| self.renderer.draw(view, &mut |_| {}).map(|_| ()))
        })
    }

    /// What was built.
    pub fn plan(&self) -> &Plan {
        self.renderer.plan()
    }

    /// Each frame by the timer: processor time, else device time.
    pub fn frames_ms(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.ms).collect()
    }

    /// Each frame's time on the device in the passes that are wanted.
    pub fn passes_ms(&self, wanted: impl Fn(&str) -> bool) -> Vec<f64> {
        self.frames.iter().map(|frame| device_ms(&frame.statistics, &wanted)).collect()
    }

    /// Bricks that came in frames that count: none.
    pub fn bricks_uploaded(&self) -> u64 {
        self.frames.iter().map(|frame| frame.statistics.bricks_uploaded).sum()
    }

    /// What the statistics of its frames say, in the mean.
    pub fn mean(&self, figure: impl Fn(&Statistics) -> u64) -> f64 {
        let sum: u64 = self.frames.iter().map(|frame| figure(&frame.statistics)).sum();
        sum as f64 / self.frames.len() as f64
    }

    /// Samples of the last frame.
    pub fn samples(&self) -> u64 {
        self.frames.last().map_or(0, |frame| frame.statistics.samples)
    }
}

/// Draws the first view of each once to warm up, then of all in turns; `step` is told every frame.
///
/// # Errors
/// Exit code 4 when a brick had to come again, or the device is lost.
pub fn draw_in_turns(
    scenes: &mut [ResidentScene],
    timer: Timer,
    repeats: u32,
    mut step: impl FnMut(),
) -> Result<()> {
    for turn in 0..=repeats {
        for scene in &mut *scenes {
            let (frame, _) = scene.draw(0, timer)?;
            if turn > 0 {
                scene.frames.push(frame);
            }
            step();
        }
    }
    Ok(())
}

/// Draws all views of scenes that have as many, `turns` times: each view of all scenes before the next
/// view. Each has been drawn before, so that none warms up. `seen` is told every frame.
///
/// # Errors
/// As [`draw_in_turns`], and those of `seen`.
pub fn draw_views_in_turns(
    scenes: &mut [ResidentScene],
    timer: Timer,
    turns: u32,
    mut seen: impl FnMut(Drawn) -> Result<()>,
) -> Result<()> {
    let views = scenes.iter().map(|scene| scene.views).min().unwrap_or(0);
    for _ in 0..turns {
        for view in 0..views {
            for (number, scene) in scenes.iter_mut().enumerate() {
                let (frame, picture) = scene.draw(view, timer)?;
                scene.frames.push(frame);
                seen(Drawn { scene: number, view, picture })?;
            }
        }
    }
    Ok(())
}

fn device_ms(statistics: &Statistics, wanted: impl Fn(&str) -> bool) -> f64 {
    statistics.gpu_ms.iter().filter(|time| wanted(&time.pass)).map(|time| time.ms).sum()
}

fn not_resident() -> Error {
    Error::machine("the device does not hold all bricks at once: lower --edge")
}
