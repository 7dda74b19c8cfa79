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
    /// Of the frame that brought everything to the device.
    pub first: Statistics,
    frames: Vec<Frame>,
}

/// A frame that counts.
struct Frame {
    ms: f64,
    statistics: Statistics,
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
            true => Ok((ResidentScene { renderer, first, frames: Vec::new() }, picture)),
            false => Err(not_resident()),
        }
    }

    fn draw(&mut self, timer: Timer) -> Result<Frame> {
        let ((_, statistics), took) = timer.time(|| self.renderer.draw(0, &mut |_| {}))?;
        if statistics.bricks_uploaded > 0 {
            return Err(not_resident());
        }
        let ms = match timer.counts_processor() {
            true => took.ms,
            false => device_ms(&statistics, |pass| pass != "upload"),
        };
        Ok(Frame { ms, statistics })
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

    /// Samples of the last frame.
    pub fn samples(&self) -> u64 {
        self.frames.last().map_or(0, |frame| frame.statistics.samples)
    }
}

/// Draws each once to warm up, then all in turns; `step` is told every frame.
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
            let frame = scene.draw(timer)?;
            if turn > 0 {
                scene.frames.push(frame);
            }
            step();
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
