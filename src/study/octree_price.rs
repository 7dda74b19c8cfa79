//! What each traversal of what shows nothing costs: table 1 of residency-octree-2023 as ratios within one
//! run, everything on the device already, over turns of the camera.
//!
//! # Invariants
//! All traversals draw a view before any draws the next, and each ratio is of frames of one view and turn.
//! No brick comes in a frame that counts. Every picture agrees with that of the first traversal.
//!
//! # Source
//! residency-octree-2023 section 8.

use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::{PagingSettings, Traversal};
use crate::render::{Addressing, LayoutChoice, Picture, Plan, Settings, peak_rss_bytes};
use crate::study::error_metrics::picture_error;
use crate::study::octree_leaves::{LeafTable, leaves};
use crate::study::octree_scenes::{Case, Extent, Load, TurningScene};
use crate::study::repeated::{Spread, Timer};
use crate::study::resident_frames::{Drawn, ResidentScene, draw_views_in_turns};

/// Below this two pictures do not show the same.
pub const PSNR_DB_MIN: f64 = 60.0;
/// All that are compared. Ratios are over the first, and over the second.
pub const TRAVERSALS: [Traversal; 5] = [
    Traversal::PageTableOfPaper,
    Traversal::PageTable,
    Traversal::Octree,
    Traversal::ResidencyOctree,
    Traversal::Auto,
];
/// Turns after which the automatic choice has timed both of its ways in every view.
const SETTLING_TURNS: u32 = 4;
/// Buffers that an octree takes on the device.
const OCTREE_BUFFERS: [&str; 2] = ["leaf_words", "level_leaves"];

/// How much is measured.
pub struct Effort<'a> {
    /// How large scenes are.
    pub extent: Extent,
    /// Turns of the camera that count.
    pub repeats: u32,
    /// Scenes of the table.
    pub cases: Vec<Case>,
    /// Scene of which leaves are measured too, in so many channels.
    pub leaves_of: Option<(Case, &'a [usize])>,
}

/// One scene through one traversal.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// How rays cross what shows nothing.
    pub traversal: &'static str,
    /// A frame, by the table's clock, over all views and turns.
    pub ms: Spread,
    /// The same over a frame of the paper's page table.
    pub over_page_table_of_paper: Spread,
    /// Over a frame of ours.
    pub over_page_table: Spread,
    /// Passes that march alone, on the device.
    pub march_ms: Spread,
    /// The same over the paper's page table.
    pub march_over_page_table_of_paper: Spread,
    /// Different bricks that rays of a finished picture take samples from, in the mean over the views.
    pub bricks_needed: f64,
    /// The same over the paper's page table.
    pub bricks_ratio: f64,
    /// Samples of a frame, in the mean.
    pub samples: f64,
    /// Device memory of the octree's words.
    pub octree_bytes: u64,
    /// Least of all pictures against the paper's page table; nothing: all are equal.
    pub psnr_db: Option<f64>,
    /// At most this is the goal of `over_page_table_of_paper`.
    pub time_goal: Option<f64>,
    /// And of `bricks_ratio`.
    pub bricks_goal: Option<f64>,
    /// What the paper measured of time, of a scene like this.
    pub paper_time: Option<f64>,
    /// And of bricks.
    pub paper_bricks: Option<f64>,
}

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct CaseRows {
    /// Its name.
    pub case: &'static str,
    /// Channels shown.
    pub channels: usize,
    /// Voxels along each axis.
    pub voxels: [u32; 3],
    /// How voxels lie on the device.
    pub layout: &'static str,
    /// Traversal by traversal.
    pub rows: Vec<Row>,
    /// Most resident memory of this process until it was measured, bytes.
    pub peak_rss_bytes: u64,
}

/// All scenes, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct OctreeTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "device": whose time `ms` counts.
    pub clock: &'static str,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Views of a turn.
    pub views: u32,
    /// Turns that count.
    pub repeats: u32,
    /// Pictures are at least so close.
    pub psnr_db_min: f64,
    /// Scene by scene.
    pub cases: Vec<CaseRows>,
    /// Time against leaf size and channels, where wanted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leaves: Option<LeafTable>,
}

/// Measures every scene; `progress` is told the finished part.
///
/// # Errors
/// Exit code 3 for a scene file that cannot be used, 4 when the device lacks memory for all bricks or is
/// lost, 6 when pictures differ.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    effort: &Effort,
    load: Load,
    progress: &mut dyn FnMut(f64),
) -> Result<OctreeTable> {
    let Effort { extent, repeats, .. } = *effort;
    let mut bench =
        Bench { gpu, compiler, timer: Timer::of(gpu), repeats, progress, parts: (0, 1) };
    let parts = effort.cases.len() + effort.leaves_of.map_or(0, |(_, channels)| channels.len());
    let mut cases = Vec::new();
    for (done, case) in effort.cases.iter().enumerate() {
        bench.parts = (done, parts);
        // Let go before the next is made.
        let scene = case.make(&extent, load)?;
        cases.push(bench.case(case, &scene, &extent)?);
    }
    let leaves = match effort.leaves_of {
        None => None,
        Some((case, channels)) => {
            bench.parts = (effort.cases.len(), parts);
            Some(leaves(&mut bench, &case, channels, &extent, load)?)
        }
    };
    Ok(OctreeTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: bench.timer.name("device"),
        payload: extent.payload,
        size: extent.size,
        views: extent.views,
        repeats,
        psnr_db_min: PSNR_DB_MIN,
        cases,
        leaves,
    })
}

/// What scenes are measured with.
pub(super) struct Bench<'a> {
    gpu: &'a Arc<Gpu>,
    compiler: &'a ShaderCompiler,
    timer: Timer,
    repeats: u32,
    progress: &'a mut dyn FnMut(f64),
    /// Scenes that are done, of so many.
    pub parts: (usize, usize),
}

/// One scene in several ways, measured.
pub(super) struct Measured {
    /// In the order of the ways.
    pub scenes: Vec<ResidentScene>,
    /// Least of each way's pictures against the first way's; nothing: all are equal.
    pub psnr_db: Vec<Option<f64>>,
}

impl Bench<'_> {
    /// Draws a scene in all `ways`, which are then on the device at once.
    pub fn measured(
        &mut self,
        name: &str,
        scene: &TurningScene,
        layout: LayoutChoice,
        ways: &[PagingSettings],
    ) -> Result<Measured> {
        let data = scene.data()?;
        let views = data.scene.views.len();
        let steps = (ways.len() * views * (self.repeats as usize + 1)) as f64;
        let (before, parts) = self.parts;
        let mut done = 0.0;
        let mut step = || {
            done += 1.0;
            (self.progress)((before as f64 + done / steps) / parts as f64);
        };
        let mut scenes = Vec::new();
        for paging in ways {
            let settings = Settings {
                layout,
                addressing: Addressing::Paged,
                // One tile: a brick that two tiles need is needed once.
                tile: data.scene.picture.size,
                paging: *paging,
                ..Settings::default()
            };
            let settings = settings.checked()?;
            let (gpu, compiler) = (self.gpu, self.compiler);
            let mut scene =
                ResidentScene::of_all_views(gpu, compiler, &data, &settings, &mut step)?;
            if paging.traversal == Traversal::Auto {
                scene.settle(SETTLING_TURNS)?;
            }
            scenes.push(scene);
        }
        let mut psnr_db = vec![None; ways.len()];
        let mut first: Option<Picture> = None;
        draw_views_in_turns(&mut scenes, self.timer, self.repeats, |drawn: Drawn| {
            step();
            match &first {
                Some(first) if drawn.scene > 0 => {
                    let found = psnr(&drawn.picture, first);
                    let least = psnr_db[drawn.scene].into_iter().chain(found);
                    psnr_db[drawn.scene] = least.reduce(f64::min);
                    let paging = &ways[drawn.scene];
                    unless_different(found, name, paging.traversal, drawn.view)
                }
                _ => {
                    first = Some(drawn.picture);
                    Ok(())
                }
            }
        })?;
        Ok(Measured { scenes, psnr_db })
    }

    fn case(&mut self, case: &Case, scene: &TurningScene, extent: &Extent) -> Result<CaseRows> {
        let ways = TRAVERSALS.map(|traversal| PagingSettings { traversal, ..Default::default() });
        let layout = scene.layout(ways.len());
        let measured = self.measured(case.name, scene, layout, &ways)?;
        let of_paper = &measured.scenes[0];
        let ours = &measured.scenes[1];
        let march = |scene: &ResidentScene| scene.passes_ms(|pass| pass == "march_bricks");
        let needed = |scene: &ResidentScene| scene.mean(|statistics| statistics.bricks_needed);
        let mut rows = Vec::new();
        for (number, traversal) in TRAVERSALS.into_iter().enumerate() {
            let of = &measured.scenes[number];
            let (ms, march_ms) = (of.frames_ms(), march(of));
            let goals = case.goals;
            let ours_alone = traversal == Traversal::Auto;
            let goal = |goal: Option<f64>| goal.filter(|_| ours_alone);
            let reached = extent.edge >= goals.edge_min;
            rows.push(Row {
                traversal: traversal.name(),
                ms: Spread::of(&ms),
                over_page_table_of_paper: Spread::of_ratios(&ms, &of_paper.frames_ms()),
                over_page_table: Spread::of_ratios(&ms, &ours.frames_ms()),
                march_ms: Spread::of(&march_ms),
                march_over_page_table_of_paper: Spread::of_ratios(&march_ms, &march(of_paper)),
                bricks_needed: needed(of),
                bricks_ratio: needed(of) / needed(of_paper),
                samples: of.mean(|statistics| statistics.samples),
                octree_bytes: octree_bytes(of.plan()),
                psnr_db: measured.psnr_db[number],
                time_goal: goal(goals.time).filter(|_| reached),
                bricks_goal: goal(goals.bricks).filter(|_| reached),
                paper_time: goal(goals.paper_time),
                paper_bricks: goal(goals.paper_bricks),
            });
        }
        let layout = of_paper.plan().layout.as_ref().map_or("none", |layout| layout.chosen);
        Ok(CaseRows {
            case: case.name,
            channels: scene.channels(),
            voxels: scene.size(),
            layout,
            rows,
            peak_rss_bytes: peak_rss_bytes(),
        })
    }
}

/// Device memory of the octree's words; 0 where there is no octree.
pub(super) fn octree_bytes(plan: &Plan) -> u64 {
    let of_octree = plan.buffers.iter().filter(|buffer| OCTREE_BUFFERS.contains(&buffer.name));
    of_octree.map(|buffer| buffer.bytes).sum()
}

/// In dB, of colour or of the worst alpha, whichever is worse; nothing: equal.
fn psnr(picture: &Picture, first: &Picture) -> Option<f64> {
    if picture.pixels == first.pixels {
        return None;
    }
    let wide: Vec<[f64; 4]> = first.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    let error = picture_error(&picture.pixels, &wide);
    let psnr_db = error.whole.psnr_db.min(-20.0 * error.alpha_max.log10());
    (psnr_db < f64::INFINITY).then_some(psnr_db)
}

fn unless_different(
    psnr_db: Option<f64>,
    case: &str,
    traversal: Traversal,
    view: usize,
) -> Result<()> {
    match psnr_db {
        Some(psnr_db) if psnr_db < PSNR_DB_MIN => Err(Error::difference(format!(
            "{case}: view {view} through {} is {psnr_db:.1} dB from the one through {}, at least {PSNR_DB_MIN} are wanted: report this",
            traversal.name(),
            TRAVERSALS[0].name()
        ))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_differ_end_with_6() {
        let picture = |value| Picture { size: [1, 1], pixels: vec![value] };
        let grey = picture([0.5, 0.5, 0.5, 1.0]);
        let check = |other: [f32; 4]| {
            let found = psnr(&picture(other), &grey);
            unless_different(found, "case", Traversal::Octree, 0).map(|()| found)
        };
        assert_eq!(check([0.5, 0.5, 0.5, 1.0]).ok(), Some(None));
        assert!(check([0.5005, 0.5, 0.5, 1.0]).is_ok_and(|found| found.is_some()));
        for bad in [[0.6, 0.5, 0.5, 1.0], [0.5, 0.5, 0.5, 0.9], [f32::NAN, 0.5, 0.5, 1.0]] {
            let why = check(bad).err().map(|why| why.exit);
            assert_eq!(why, Some(crate::error::Exit::Difference), "{bad:?}");
        }
    }
}
