//! Time of a frame against leaf size and channels: figure 10 of residency-octree-2023.
//!
//! # Source
//! residency-octree-2023 section 8, "decoupling resolution levels from spatial subdivision".

use serde::Serialize;

use crate::error::Result;
use crate::render::paging::{PagingSettings, Traversal};
use crate::study::chart::{Panel, Series, svg_of};
use crate::study::octree_price::{Bench, octree_bytes};
use crate::study::octree_scenes::{Case, Extent, Load};
use crate::study::repeated::Spread;
use crate::study::resident_frames::ResidentScene;

/// Leaves that are asked for, in voxels.
pub const LEAVES: [[u32; 3]; 5] = [[4; 3], [8, 8, 4], [8; 3], [16; 3], [32; 3]];
/// Children along each axis.
const FAN_OUTS: [u32; 2] = [2, 4];
/// Views of the turn: twelve renderers in ten views would take longer than the table.
const VIEWS_MAX: u32 = 3;
/// What stands beside octrees, the first of which ratios are over.
const BESIDE: [Traversal; 2] = [Traversal::PageTableOfPaper, Traversal::PageTable];

/// One leaf size in so many channels.
#[derive(Clone, Debug, Serialize)]
pub struct LeafRow {
    /// Channels shown.
    pub channels: usize,
    /// Voxels of a leaf, as asked for.
    pub leaf: [u32; 3],
    /// A frame with fan-out 2.
    pub ms: Spread,
    /// The same over the paper's page table.
    pub over_page_table_of_paper: Spread,
    /// A frame with fan-out 4.
    pub fan_out_4_ms: Spread,
    /// Different bricks needed, fan-out 2, in the mean over the views.
    pub bricks_needed: f64,
    /// Samples of a frame, fan-out 2, in the mean.
    pub samples: f64,
    /// Device memory of the octree's words.
    pub octree_bytes: u64,
}

/// What has no leaves, in so many channels.
#[derive(Clone, Debug, Serialize)]
pub struct BesideRow {
    /// Channels shown.
    pub channels: usize,
    /// "page-table-of-paper" or "page-table".
    pub traversal: &'static str,
    /// A frame.
    pub ms: Spread,
    /// Different bricks needed, in the mean over the views.
    pub bricks_needed: f64,
}

/// All of one scene.
#[derive(Clone, Debug, Serialize)]
pub struct LeafTable {
    /// The scene whose first channels are shown.
    pub case: &'static str,
    /// Views of the turn.
    pub views: u32,
    /// By channels and leaf.
    pub rows: Vec<LeafRow>,
    /// By channels and traversal.
    pub beside: Vec<BesideRow>,
}

/// Measures every leaf size in the first channels of a scene, all in turns.
pub(super) fn leaves(
    bench: &mut Bench,
    case: &Case,
    channels: &[usize],
    extent: &Extent,
    load: Load,
) -> Result<LeafTable> {
    let views = extent.views.min(VIEWS_MAX);
    let whole = case.make(&Extent { views, ..*extent }, load)?;
    let mut ways =
        BESIDE.map(|traversal| PagingSettings { traversal, ..Default::default() }).to_vec();
    for leaf in LEAVES {
        ways.extend(FAN_OUTS.map(|fan_out| PagingSettings {
            traversal: Traversal::ResidencyOctree,
            leaf,
            fan_out,
            ..PagingSettings::default()
        }));
    }
    // One for all, so that channels alone change.
    let layout = whole.layout(ways.len());
    let (mut rows, mut beside) = (Vec::new(), Vec::new());
    for count in channels {
        let scene = whole.first_channels(*count);
        let measured = bench.measured(case.name, &scene, layout, &ways)?;
        bench.parts.0 += 1;
        let needed = |of: &ResidentScene| of.mean(|statistics| statistics.bricks_needed);
        let (pages, octrees) = measured.scenes.split_at(BESIDE.len());
        for (traversal, of) in BESIDE.iter().zip(pages) {
            beside.push(BesideRow {
                channels: scene.channels(),
                traversal: traversal.name(),
                ms: Spread::of(&of.frames_ms()),
                bricks_needed: needed(of),
            });
        }
        for (leaf, of) in LEAVES.into_iter().zip(octrees.chunks_exact(FAN_OUTS.len())) {
            let ms = of[0].frames_ms();
            rows.push(LeafRow {
                channels: scene.channels(),
                leaf,
                ms: Spread::of(&ms),
                over_page_table_of_paper: Spread::of_ratios(&ms, &pages[0].frames_ms()),
                fan_out_4_ms: Spread::of(&of[1].frames_ms()),
                bricks_needed: needed(&of[0]),
                samples: of[0].mean(|statistics| statistics.samples),
                octree_bytes: octree_bytes(of[0].plan()),
            });
        }
    }
    Ok(LeafTable { case: case.name, views, rows, beside })
}

/// "4", or "8x8x4".
pub fn leaf_name([x, y, z]: [u32; 3]) -> String {
    if x == y && y == z { x.to_string() } else { format!("{x}x{y}x{z}") }
}

impl LeafTable {
    /// Of the same channels, a traversal without leaves.
    fn beside_ms(&self, channels: usize, traversal: &str) -> Option<f64> {
        let mut rows = self.beside.iter();
        let row = rows.find(|row| row.channels == channels && row.traversal == traversal);
        row.map(|row| row.ms.median)
    }

    /// The rows as comma-separated values, with a line of names.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "channels,leaf,ms,ms_least,ms_most,fan_out_4_ms,page_table_of_paper_ms,page_table_ms,over_page_table_of_paper,bricks_needed,samples,octree_bytes\n",
        );
        for row in &self.rows {
            let [of_paper, ours] = BESIDE.map(|traversal| {
                let ms = self.beside_ms(row.channels, traversal.name());
                ms.map(|ms| format!("{ms:.3}")).unwrap_or_default()
            });
            text += &format!(
                "{},{},{:.3},{:.3},{:.3},{:.3},{of_paper},{ours},{:.4},{:.1},{:.0},{}\n",
                row.channels,
                leaf_name(row.leaf),
                row.ms.median,
                row.ms.least,
                row.ms.most,
                row.fan_out_4_ms.median,
                row.over_page_table_of_paper.median,
                row.bricks_needed,
                row.samples,
                row.octree_bytes,
            );
        }
        text
    }

    /// One panel for each fan-out: milliseconds over channels, a line for each leaf, and page tables.
    pub fn chart(&self, clock: &str, device: &str) -> String {
        type Value = fn(&LeafRow) -> f64;
        let values: [(u32, Value); 2] =
            [(2, |row| row.ms.median), (4, |row| row.fan_out_4_ms.median)];
        let panel = |(fan_out, value): (u32, Value)| {
            let of_leaf = |leaf: [u32; 3]| {
                let rows = self.rows.iter().filter(|row| row.leaf == leaf);
                Series {
                    name: format!("leaf {}", leaf_name(leaf)),
                    points: rows.map(|row| (row.channels as f64, Some(value(row)))).collect(),
                    ..Series::default()
                }
            };
            let of_pages = |traversal: Traversal| {
                let rows = self.beside.iter().filter(|row| row.traversal == traversal.name());
                Series {
                    name: traversal.name().to_owned(),
                    points: rows.map(|row| (row.channels as f64, Some(row.ms.median))).collect(),
                    ..Series::default()
                }
            };
            Panel {
                title: format!("residency-octree, fan-out {fan_out}"),
                y_label: format!("ms, {clock} time"),
                series: LEAVES.map(of_leaf).into_iter().chain(BESIDE.map(of_pages)).collect(),
                ..Panel::default()
            }
        };
        let title = format!("ashfall bench octree, {}, {device}", self.case);
        svg_of(&title, "channels", "not measured", 2, &values.map(panel), [420.0, 340.0])
    }
}
