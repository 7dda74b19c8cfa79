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
use crate::render::{Addressing, Layout, LayoutChoice, Picture, SceneData, Settings};
use crate::scene::Overrides;
use crate::study::bench_scenes;
use crate::study::error_metrics::picture_error;
use crate::study::repeated::{Spread, Timer};
use crate::study::resident_frames::{ResidentScene, draw_in_turns};

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
    let steps = f64::from(effort.repeats + 1) * (SCENES.len() * FILTERS.len() * 3) as f64;
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
            let (mut ways, psnr_db) = ways(gpu, compiler, &data, layout)?;
            draw_in_turns(&mut ways, timer, effort.repeats, &mut step)?;
            cases.push(case(&ways, psnr_db, [scene, filter, layout.name()], goal));
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

/// The ways, drawn once each, and how far the paged picture is from the direct one.
fn ways(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    data: &SceneData,
    layout: Layout,
) -> Result<([ResidentScene; 3], Option<f64>)> {
    let way = |addressing, marks| {
        let settings = Settings {
            layout: LayoutChoice::Only(layout),
            addressing,
            // Against every sample: what the page table costs, and what it saves alone.
            skipping: addressing == Addressing::Paged,
            paging: PagingSettings { marks, ..PagingSettings::default() },
            ..Settings::default()
        };
        ResidentScene::new(gpu, compiler, data, &settings.checked()?)
    };
    let (direct, direct_picture) = way(Addressing::Direct, true)?;
    let (paged, paged_picture) = way(Addressing::Paged, true)?;
    let (unmarked, unmarked_picture) = way(Addressing::Paged, false)?;
    if unmarked_picture.pixels != paged_picture.pixels {
        return Err(Error::difference(
            "the picture without marks differs from the one with them: report this",
        ));
    }
    Ok(([direct, paged, unmarked], checked_psnr(&paged_picture, &direct_picture)?))
}

fn case(
    ways: &[ResidentScene; 3],
    psnr_db: Option<f64>,
    [scene, filter, layout]: [&'static str; 3],
    ratio_goal: f64,
) -> Case {
    let frames_ms = ways.each_ref().map(ResidentScene::frames_ms);
    let march_ms = ways.each_ref().map(|way| way.passes_ms(|pass| MARCH.contains(&pass)));
    let paged = &ways[PAGED];
    let device_ms = paged.passes_ms(|pass| pass != "upload");
    let management_ms = paged.passes_ms(|pass| MANAGEMENT.contains(&pass));
    let marks = frames_ms[PAGED].iter().zip(&frames_ms[UNMARKED]);
    let marks: Vec<f64> = marks.map(|(with, without)| (with - without) / with).collect();
    Case {
        scene,
        filter,
        layout,
        direct_ms: Spread::of(&frames_ms[DIRECT]),
        paged_ms: Spread::of(&frames_ms[PAGED]),
        ratio: Spread::of_ratios(&frames_ms[PAGED], &frames_ms[DIRECT]),
        ratio_goal,
        direct_march_ms: Spread::of(&march_ms[DIRECT]),
        paged_march_ms: Spread::of(&march_ms[PAGED]),
        march_ratio: Spread::of_ratios(&march_ms[PAGED], &march_ms[DIRECT]),
        management_ms: Spread::of(&management_ms),
        management_share: Spread::of_ratios(&management_ms, &device_ms),
        marks_share: Spread::of(&marks),
        psnr_db,
        direct_samples: ways[DIRECT].samples(),
        paged_samples: paged.samples(),
        bricks_resident: paged.first.bricks_uploaded,
        bricks_hidden: paged.first.bricks_hidden,
        bricks_uploaded: paged.bricks_uploaded(),
    }
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
