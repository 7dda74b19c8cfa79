//! What drawing through a page table costs over addressing voxels directly: the same frame, with
//! everything on the device already.
//!
//! # Invariants
//! No brick is uploaded in a frame that counts, and both pictures agree: otherwise there is no table.

use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::PagingSettings;
use crate::render::{
    Addressing, Layout, LayoutChoice, Picture, Plan, Renderer, SceneData, Settings, Statistics,
};
use crate::scene::Overrides;
use crate::study::bench_scenes;
use crate::study::error_metrics::picture_error;
use crate::study::repeated::{Spread, Timer};

/// Below this both pictures do not show the same.
const PSNR_DB_MIN: f64 = 90.0;
/// Passes that keep the cache.
const MANAGEMENT: [&str; 7] = ["publish", "tally", "choose", "count", "scan", "grant", "report"];
/// Passes that march rays.
const MARCH: [&str; 3] = ["cast", "march", "march_bricks"];
/// Share of the frame that management may take.
pub const MANAGEMENT_GOAL: f64 = 0.05;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Voxels along each axis.
    pub edge: u32,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Turns that count; one more comes before them.
    pub repeats: u32,
}

/// One scene with one filter.
#[derive(Clone, Debug, Serialize)]
pub struct Case {
    /// "dense" or "sparse".
    pub scene: &'static str,
    /// "exact" or "hardware".
    pub filter: &'static str,
    /// "plain" or "quads".
    pub layout: &'static str,
    /// A frame addressed directly, by the table's clock.
    pub direct_ms: Spread,
    /// A frame through the page table.
    pub paged_ms: Spread,
    /// Paged over direct, in turns.
    pub ratio: Spread,
    /// At most this is the goal.
    pub ratio_goal: f64,
    /// Passes that march alone, on the device.
    pub direct_march_ms: Spread,
    /// The same, paged.
    pub paged_march_ms: Spread,
    /// Paged over direct of these.
    pub march_ratio: Spread,
    /// Passes that keep the cache, on the device.
    pub management_ms: Spread,
    /// The same over all passes of the paged frame, on the device.
    pub management_share: Spread,
    /// What marking used slots costs, over the paged frame: by the difference to a variant without.
    pub marks_share: Spread,
    /// Of the paged picture against the direct one; nothing: they are equal.
    pub psnr_db: Option<f64>,
    /// Samples of a frame addressed directly.
    pub direct_samples: u64,
    /// Samples of a paged frame.
    pub paged_samples: u64,
    /// Bricks on the device.
    pub bricks_resident: u64,
    /// Bricks that were looked at and show nothing.
    pub bricks_hidden: u64,
    /// Bricks that came while it was measured: 0.
    pub bricks_uploaded: u64,
}

/// All cases, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct OverheadTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "device": whose time `direct_ms`, `paged_ms` and `ratio` count.
    pub clock: &'static str,
    /// Voxels along each axis.
    pub edge: u32,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Turns that count.
    pub repeats: u32,
    /// At most this share of the frame is management's goal.
    pub management_goal: f64,
    /// Scene by scene.
    pub cases: Vec<Case>,
}

type Make = fn(u32, u32, &Overrides) -> Result<SceneData>;
const SCENES: [(&str, Make, f64); 2] =
    [("dense", bench_scenes::dense, 1.10), ("sparse", bench_scenes::sparse, 0.5)];
const FILTERS: [(&str, Layout); 3] =
    [("exact", Layout::Quads), ("exact", Layout::Plain), ("hardware", Layout::Plain)];

/// Measures every case; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device lacks memory for all bricks or is lost, 6 when pictures differ.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<OverheadTable> {
    let timer = Timer::of(gpu);
    let steps = f64::from(effort.repeats + 1) * (SCENES.len() * FILTERS.len()) as f64;
    let mut done = 0.0;
    let mut step = || {
        done += 1.0;
        progress(done / steps);
    };
    let mut cases = Vec::new();
    for (scene, make, goal) in SCENES {
        for (filter, layout) in FILTERS {
            let overrides = Overrides {
                size: Some(effort.size),
                filter: Some(filter.to_owned()),
                ..Overrides::default()
            };
            let data = make(effort.edge, effort.payload, &overrides)?;
            let mut turns = Turns::new(gpu, compiler, &data, layout, timer)?;
            for turn in 0..=effort.repeats {
                turns.turn(turn > 0)?;
                step();
            }
            cases.push(turns.case(scene, filter, layout, goal));
        }
    }
    Ok(OverheadTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: timer.name("device"),
        edge: effort.edge,
        payload: effort.payload,
        size: effort.size,
        repeats: effort.repeats,
        management_goal: MANAGEMENT_GOAL,
        cases,
    })
}

/// The three ways to draw the frame, in this order.
const DIRECT: usize = 0;
const PAGED: usize = 1;
const UNMARKED: usize = 2;

/// Ways that take turns, so that what disturbs the machine disturbs all of them alike.
struct Turns {
    ways: [Renderer; 3],
    timer: Timer,
    first: Statistics,
    last: Vec<Statistics>,
    psnr_db: Option<f64>,
    frame_ms: [Vec<f64>; 3],
    device_ms: [Vec<f64>; 3],
    march_ms: [Vec<f64>; 3],
    management_ms: Vec<f64>,
    uploaded: u64,
}

impl Turns {
    /// Makes the ways and draws each once, which brings every brick to the device.
    fn new(
        gpu: &Arc<Gpu>,
        compiler: &ShaderCompiler,
        data: &SceneData,
        layout: Layout,
        timer: Timer,
    ) -> Result<Turns> {
        let renderer = |addressing, marks| {
            let settings = Settings {
                layout: LayoutChoice::Only(layout),
                addressing,
                // Against every sample: what the page table costs, and what it saves alone.
                paging: PagingSettings {
                    marks,
                    skipping: addressing == Addressing::Paged,
                    ..PagingSettings::default()
                },
                ..Settings::default()
            };
            Renderer::new(gpu, Plan::new(gpu, compiler, data, &settings.checked()?)?, data)
        };
        let mut ways = [
            renderer(Addressing::Direct, true)?,
            renderer(Addressing::Paged, true)?,
            renderer(Addressing::Paged, false)?,
        ];
        let (direct, _) = ways[DIRECT].draw(0, &mut |_| {})?;
        let (paged, first) = ways[PAGED].draw(0, &mut |_| {})?;
        let (unmarked, other) = ways[UNMARKED].draw(0, &mut |_| {})?;
        if !(first.converged && other.converged) {
            return Err(not_resident());
        }
        if unmarked.pixels != paged.pixels {
            return Err(Error::difference(
                "the picture without marks differs from the one with them: report this",
            ));
        }
        Ok(Turns {
            ways,
            timer,
            first,
            last: Vec::new(),
            psnr_db: checked_psnr(&paged, &direct)?,
            frame_ms: Default::default(),
            device_ms: Default::default(),
            march_ms: Default::default(),
            management_ms: Vec::new(),
            uploaded: 0,
        })
    }

    fn turn(&mut self, counts: bool) -> Result<()> {
        self.last.clear();
        for (index, way) in self.ways.iter_mut().enumerate() {
            let ((_, statistics), took) = self.timer.time(|| way.draw(0, &mut |_| {}))?;
            if index != DIRECT && statistics.bricks_uploaded > 0 {
                return Err(not_resident());
            }
            if counts {
                let device_ms = of_passes(&statistics, |pass| pass != "upload");
                let processor = self.timer.counts_processor();
                self.frame_ms[index].push(if processor { took.ms } else { device_ms });
                self.device_ms[index].push(device_ms);
                self.march_ms[index].push(of_passes(&statistics, |pass| MARCH.contains(&pass)));
                if index == PAGED {
                    let managing = of_passes(&statistics, |pass| MANAGEMENT.contains(&pass));
                    self.management_ms.push(managing);
                    self.uploaded += statistics.bricks_uploaded;
                }
            }
            self.last.push(statistics);
        }
        Ok(())
    }

    fn case(self, scene: &'static str, filter: &'static str, layout: Layout, goal: f64) -> Case {
        let marks = self.frame_ms[PAGED].iter().zip(&self.frame_ms[UNMARKED]);
        let marks: Vec<f64> = marks.map(|(with, without)| (with - without) / with).collect();
        Case {
            scene,
            filter,
            layout: layout.name(),
            direct_ms: Spread::of(&self.frame_ms[DIRECT]),
            paged_ms: Spread::of(&self.frame_ms[PAGED]),
            ratio: Spread::of_ratios(&self.frame_ms[PAGED], &self.frame_ms[DIRECT]),
            ratio_goal: goal,
            direct_march_ms: Spread::of(&self.march_ms[DIRECT]),
            paged_march_ms: Spread::of(&self.march_ms[PAGED]),
            march_ratio: Spread::of_ratios(&self.march_ms[PAGED], &self.march_ms[DIRECT]),
            management_ms: Spread::of(&self.management_ms),
            management_share: Spread::of_ratios(&self.management_ms, &self.device_ms[PAGED]),
            marks_share: Spread::of(&marks),
            psnr_db: self.psnr_db,
            direct_samples: self.last[DIRECT].samples,
            paged_samples: self.last[PAGED].samples,
            bricks_resident: self.first.bricks_uploaded,
            bricks_hidden: self.first.bricks_hidden,
            bricks_uploaded: self.uploaded,
        }
    }
}

fn of_passes(statistics: &Statistics, wanted: impl Fn(&str) -> bool) -> f64 {
    statistics.gpu_ms.iter().filter(|time| wanted(&time.pass)).map(|time| time.ms).sum()
}

fn not_resident() -> Error {
    Error::machine("the device does not hold all bricks at once: lower --edge")
}

fn checked_psnr(paged: &Picture, direct: &Picture) -> Result<Option<f64>> {
    let wide: Vec<[f64; 4]> = direct.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    let psnr_db = picture_error(&paged.pixels, &wide).whole.psnr_db;
    if psnr_db < PSNR_DB_MIN {
        return Err(Error::difference(format!(
            "the paged picture is {psnr_db:.1} dB from the direct one, at least {PSNR_DB_MIN} are wanted: report this"
        )));
    }
    Ok(psnr_db.is_finite().then_some(psnr_db))
}
