//! `ashfall bench octree`: what each way to cross what shows nothing costs.

use std::path::PathBuf;

use clap::Args;

use crate::cli::load::load_scene;
use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::{make_folder, print, write};
use crate::cli::scene_flags::pixels;
use crate::error::{Error, Result};
use crate::scene::Overrides;
use crate::study::octree_leaves::{LeafTable, leaf_name};
use crate::study::octree_price::{CaseRows, Effort, OctreeTable, Row, measure};
use crate::study::octree_scenes::{CASES, Case, Extent};

/// What each way to cross what shows nothing costs, in turns of the camera around the volume, once
/// everything is on the device: table 1 of the residency-octree paper (Herzberger and others 2023) as
/// ratios within one run.
///
/// Five traversals draw the same views in turns: "page-table-of-paper" leaves out a brick that shows
/// nothing of any channel; "page-table", ashfall's default, asks each channel by itself; "octree" has a
/// brick for each node and needs all its ancestors; "residency-octree" leaves out boxes down to 4 voxels,
/// and needs a brick only where such a box shows something; "auto" is this or our page table, whichever
/// marched a view's frames faster before those that count. All pictures must agree within 60 dB, or
/// it ends with 6, and no brick may be loaded while it is measured.
#[derive(Args)]
#[command(
    after_help = "Scenes: aneurism, aneurism-x4, bonsai, bonsai-x4, dna, files-x16 (of --scenes); computed-x4 and \
    computed-x16 (made in memory; without --scenes, or where --only names them); sparse and dense. x4 shows \
    one volume in four channels, each through a window of its own; x16 are such windows of several volumes, \
    shifted and smoothed.\n\n\"ms\" is a frame over all views and turns, by processor time where the device is \
    a CPU, else device time; \"/paper\" and \"/ours\" are ratios over the two page tables, of frames of one \
    view and turn; \"march\" is the ratio over the paper's page table of the passes that march alone, on \
    the device.\n\"bricks\" are different bricks from which a finished picture takes samples, in the mean \
    over the views, and their ratio: what the atlas must hold.\n\nAt edge 1024 dense takes some 10 GiB of \
    memory, and where a CPU is the device about ten minutes a turn; --edge 256 shows much of it in less."
)]
pub struct Arguments {
    /// Folder of scene files (aneurism.toml, bonsai.toml, dna_2_channels.toml, engine.toml); without, scenes
    /// made in memory alone are drawn.
    #[arg(long, value_name = "FOLDER")]
    scenes: Option<PathBuf>,
    /// Voxels along each axis of sparse and dense; computed-x4 and computed-x16 have a quarter of it.
    #[arg(long, default_value_t = 1024, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(16..=1024))]
    edge: u32,
    /// Voxels of all bricks along each axis.
    #[arg(long, default_value_t = 32, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(4..=128))]
    payload: u32,
    /// Picture size in pixels, across x down.
    #[arg(long, default_value = "384x384", value_name = "WxH", value_parser = pixels)]
    size: [u32; 2],
    /// Views of a turn of the camera.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=360))]
    views: u32,
    /// Turns of the camera that count; one more loads.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Draw these scenes alone; none: none, for --figure.
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = only)]
    only: Vec<Only>,
    /// Also measure leaves of 4 to 32 voxels against --channels (figure 10 of the paper), in three
    /// views of files-x16 or computed-x16; octree_leaves.csv and octree_leaves.svg go into this folder, which
    /// is made.
    #[arg(long, value_name = "FOLDER")]
    figure: Option<PathBuf>,
    /// Counts of channels of the figure, at most 16 each.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "1,2,4,8,16",
          value_parser = clap::value_parser!(u8).range(1..=16))]
    channels: Vec<u8>,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// A scene's name; nothing: none.
#[derive(Clone, Copy)]
struct Only(Option<Case>);

/// Measures, prints and writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { edge, payload, size, views, repeats, .. } = *arguments;
    let figure = arguments.figure.as_ref();
    figure.map_or(Ok(()), |folder| make_folder(folder))?;
    let of_files = arguments.scenes.is_some();
    let of_figure = if of_files { "files-x16" } else { "computed-x16" };
    let leaves_of = CASES.into_iter().find(|case| case.name == of_figure);
    let channels: Vec<usize> = arguments.channels.iter().map(|count| usize::from(*count)).collect();
    let effort = Effort {
        extent: Extent { edge, payload, size, views },
        repeats,
        cases: cases(arguments)?,
        leaves_of: leaves_of.filter(|_| figure.is_some()).map(|case| (case, &channels[..])),
    };
    let overrides = Overrides { size: Some(size), ..Overrides::default() };
    let folder = arguments.scenes.clone().unwrap_or_default();
    let load = |name: &str| load_scene(&folder.join(format!("{name}.toml")), &overrides);
    arguments.measuring.measure_under_bar(
        "bench octree",
        |gpu, compiler, progress| {
            let table = measure(gpu, compiler, &effort, &load, progress)?;
            if let (Some(folder), Some(leaves)) = (figure, &table.leaves) {
                write(&folder.join("octree_leaves.csv"), &leaves.csv())?;
                let chart = leaves.chart(table.clock, &table.device);
                write(&folder.join("octree_leaves.svg"), &chart)?;
            }
            Ok(table)
        },
        describe,
    )?;
    Ok(())
}

/// Those that are named; else of files or made in memory, and sparse and dense.
fn cases(arguments: &Arguments) -> Result<Vec<Case>> {
    let of_files = arguments.scenes.is_some();
    let wanted = |case: &Case| match arguments.only.is_empty() {
        true => case.of_files == of_files || case.is_always(),
        false => arguments.only.iter().flat_map(|only| only.0).any(|only| only.name == case.name),
    };
    let cases: Vec<Case> = CASES.into_iter().filter(wanted).collect();
    match cases.iter().find(|case| case.of_files && !of_files) {
        Some(case) => Err(Error::arguments(format!(
            "--only {}: is made of scene files: say in which folder with --scenes",
            case.name
        ))),
        None => Ok(cases),
    }
}

fn describe(table: &OctreeTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{width} x {height} in bricks of {}, {} time of a frame, medians of {} turns of {} views, everything resident\n",
        table.device, table.driver, table.payload, table.clock, table.repeats, table.views,
    ))?;
    for case in &table.cases {
        describe_case(case)?;
    }
    table.leaves.as_ref().map_or(Ok(()), describe_leaves)
}

fn describe_case(case: &CaseRows) -> Result<()> {
    let [x, y, z] = case.voxels;
    print(format_args!(
        "\n{}: {} channel{}, {x} x {y} x {z}, {}; {:.1} GiB of memory at most so far\n{:<20} {:>9} {:>7} {:>14} {:>6} {:>6} {:>9} {:>7} {:>10} {:>9} {:>6}  goals (paper)\n",
        case.case,
        case.channels,
        if case.channels == 1 { "" } else { "s" },
        case.layout,
        case.peak_rss_bytes as f64 / f64::from(1 << 30),
        "traversal",
        "ms",
        "/paper",
        "least to most",
        "/ours",
        "march",
        "bricks",
        "ratio",
        "Msamples",
        "octree KB",
        "dB",
    ))?;
    case.rows.iter().try_for_each(describe_row)
}

fn describe_row(row: &Row) -> Result<()> {
    let over = row.over_page_table_of_paper;
    let line = format!(
        "{:<20} {:>9.1} {:>7.3} {:>14} {:>6.3} {:>6.3} {:>9.1} {:>7.3} {:>10.2} {:>9.1} {:>6}  {}",
        row.traversal,
        row.ms.median,
        over.median,
        format!("{:.2} to {:.2}", over.least, over.most),
        row.over_page_table.median,
        row.march_over_page_table_of_paper.median,
        row.bricks_needed,
        row.bricks_ratio,
        row.samples * 1e-6,
        row.octree_bytes as f64 * 1e-3,
        row.psnr_db.map_or("equal".to_owned(), |psnr_db| format!("{psnr_db:.1}")),
        goals(row),
    );
    print(format_args!("{}\n", line.trim_end()))
}

/// "ms 0.55 (0.55), bricks 0.27 (0.30)", as far as there are some.
fn goals(row: &Row) -> String {
    let parts =
        [("ms", row.time_goal, row.paper_time), ("bricks", row.bricks_goal, row.paper_bricks)];
    let words = parts.into_iter().filter_map(|(what, goal, paper)| {
        let paper = paper.map(|paper| format!("({paper:.2})"));
        let goal = goal.map(|goal| format!("{goal:.2}"));
        let known: Vec<String> = goal.into_iter().chain(paper).collect();
        (!known.is_empty()).then(|| format!("{what} {}", known.join(" ")))
    });
    words.collect::<Vec<_>>().join(", ")
}

fn describe_leaves(leaves: &LeafTable) -> Result<()> {
    print(format_args!(
        "\nleaves, in the first channels of {}, {} views\n{:>8} {:<20} {:>9} {:>7} {:>10} {:>9} {:>9}\n",
        leaves.case,
        leaves.views,
        "channels",
        "leaf",
        "ms",
        "/paper",
        "fan-out 4",
        "bricks",
        "octree KB",
    ))?;
    let mut channels = None;
    for row in &leaves.rows {
        if channels.replace(row.channels) != Some(row.channels) {
            for beside in leaves.beside.iter().filter(|of| of.channels == row.channels) {
                print(format_args!(
                    "{:>8} {:<20} {:>9.1} {:>7} {:>10} {:>9.1}\n",
                    beside.channels,
                    beside.traversal,
                    beside.ms.median,
                    "",
                    "",
                    beside.bricks_needed,
                ))?;
            }
        }
        print(format_args!(
            "{:>8} {:<20} {:>9.1} {:>7.3} {:>10.1} {:>9.1} {:>9.1}\n",
            row.channels,
            leaf_name(row.leaf),
            row.ms.median,
            row.over_page_table_of_paper.median,
            row.fan_out_4_ms.median,
            row.bricks_needed,
            row.octree_bytes as f64 * 1e-3,
        ))?;
    }
    Ok(())
}

fn only(text: &str) -> std::result::Result<Only, String> {
    let found = CASES.into_iter().find(|case| case.name == text);
    match (text, found) {
        ("none", _) => Ok(Only(None)),
        (_, Some(case)) => Ok(Only(Some(case))),
        _ => Err(format!("expected none, {}", CASES.map(|case| case.name).join(", "))),
    }
}
