//! How soon a picture follows a hand, by the size of the atlas: a camera goes along a path, as fast as its
//! pictures come, and rests at the end.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::{SceneData, Settings};
use crate::scene::CameraPath;
use crate::viewer::{Camera, Live, Shown};

/// What is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Steps of the path: the scene's, or a turn around the volume's middle by a degree and a half each, and a
    /// little nearer.
    pub steps: u32,
    /// Atlases, MiB.
    pub atlases_mib: Vec<u64>,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub struct InteractionTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Steps of the path.
    pub steps: u32,
    /// By the size of the atlas.
    pub rows: Vec<InteractionRow>,
}

/// With one atlas; times are milliseconds on the wall.
#[derive(Clone, Debug, Serialize)]
pub struct InteractionRow {
    /// Device memory for voxels, MiB at most.
    pub atlas_mib: u64,
    /// From the first wish to its first picture: nothing was there before.
    pub first_picture_ms: f64,
    /// From a step of the path to the first picture of it: the middle one.
    pub step_ms: f64,
    /// The 95th of 100.
    pub step_p95_ms: f64,
    /// The slowest.
    pub step_worst_ms: f64,
    /// Rounds from a step to its first picture, at most: the one under way, and its own.
    pub rounds_to_picture_max: u64,
    /// The slowest round along the path.
    pub round_worst_ms: f64,
    /// From the last step to the finished picture.
    pub converged_ms: f64,
    /// In so many rounds.
    pub converged_rounds: u64,
    /// Bricks read along the path and after it.
    pub bricks_read: u64,
}

/// How long the path waits between two looks.
const GLANCE: Duration = Duration::from_micros(500);

/// Measures every atlas, one after the other, each from nothing. `compiler` makes one for each thread.
///
/// # Errors
/// As drawing does.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &dyn Fn() -> ShaderCompiler,
    data: &SceneData,
    settings: Settings,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<InteractionTable> {
    let mut rows = Vec::new();
    for (at, atlas_mib) in effort.atlases_mib.iter().enumerate() {
        let mut scene = data.scene.clone();
        scene.memory.atlas_mib = *atlas_mib;
        let live = Live::new(gpu, compiler(), data.again(scene)?, settings)?;
        let part = |of_row: f64| (at as f64 + of_row) / effort.atlases_mib.len() as f64;
        rows.push(along_path(&live, data, *atlas_mib, effort.steps, &mut |of| progress(part(of)))?);
    }
    let facts = gpu.facts();
    Ok(InteractionTable {
        device: facts.name.clone(),
        driver: facts.driver.clone(),
        size: data.scene.picture.size,
        steps: effort.steps,
        rows,
    })
}

fn along_path(
    live: &Live,
    data: &SceneData,
    atlas_mib: u64,
    steps: u32,
    progress: &mut dyn FnMut(f64),
) -> Result<InteractionRow> {
    let mut scene = data.scene.clone();
    scene.memory.atlas_mib = atlas_mib;
    let middle = data.middle_world(0);
    let mut camera = Camera::new(scene.views[0].clone(), middle);
    // A scene that says a path is gone along it.
    let frames = match scene.path.clone() {
        None => Vec::new(),
        Some(path) => CameraPath { frames: steps + 1, ..path }
            .frames(&scene.views, middle)
            .map_err(|why| Error::input(format!("[path]: {why}")))?,
    };
    let mut waits = Vec::new();
    let mut row = InteractionRow {
        atlas_mib,
        first_picture_ms: 0.0,
        step_ms: 0.0,
        step_p95_ms: 0.0,
        step_worst_ms: 0.0,
        rounds_to_picture_max: 0,
        round_worst_ms: 0.0,
        converged_ms: 0.0,
        converged_rounds: 0,
        bricks_read: 0,
    };
    let mut last_wish = Instant::now();
    let mut last = Shown::default();
    for step in 0..=steps {
        if let Some(frame) = frames.get(step as usize) {
            camera.go_to(frame.clone(), middle);
        } else if step > 0 {
            camera.orbit(1.5f64.to_radians(), 0.3f64.to_radians());
            camera.zoom(1.01);
        }
        scene.views = vec![camera.view().clone()];
        last_wish = Instant::now();
        let wanted = live.want(scene.clone());
        let before = last.number;
        last = look(live, |shown| shown.scene >= wanted)?;
        let ms = last_wish.elapsed().as_secs_f64() * 1e3;
        match step {
            0 => row.first_picture_ms = ms,
            _ => {
                waits.push(ms);
                row.rounds_to_picture_max = row.rounds_to_picture_max.max(last.number - before);
                row.round_worst_ms = row.round_worst_ms.max(last.round_ms);
            }
        }
        progress(f64::from(step) / f64::from(steps + 1));
    }
    let shown = live.converged();
    if let Some(why) = shown.error {
        return Err(why);
    }
    row.converged_ms = last_wish.elapsed().as_secs_f64() * 1e3;
    row.converged_rounds = shown.number - last.number;
    let loading = shown.statistics.and_then(|statistics| statistics.loading);
    row.bricks_read = loading.map_or(0, |loading| loading.reads);
    waits.sort_by(f64::total_cmp);
    let of = |part: usize| waits.get((waits.len().saturating_sub(1)) * part / 100).copied();
    row.step_ms = of(50).unwrap_or(0.0);
    row.step_p95_ms = of(95).unwrap_or(0.0);
    row.step_worst_ms = of(100).unwrap_or(0.0);
    Ok(row)
}

/// Waits for a picture of which this holds.
fn look(live: &Live, holds: impl Fn(&Shown) -> bool) -> Result<Shown> {
    loop {
        let shown = live.shown();
        if let Some(why) = shown.error {
            return Err(why);
        }
        if holds(&shown) {
            return Ok(shown);
        }
        std::thread::sleep(GLANCE);
    }
}
