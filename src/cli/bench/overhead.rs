//! `ashfall bench overhead`: what the page table costs over direct addressing.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::cli::scene_flags::pixels;
use crate::error::Result;
use crate::study::overhead::{Effort, OverheadTable, measure};

/// What drawing through a page table costs over addressing voxels directly, once everything is on the
/// device: the same frame both ways, in turns, with each filter.
///
/// The dense scene shows every brick and stops no ray, so there the page table can only cost; in the
/// sparse scene most bricks show nothing, and the page table says so before they are sampled. Both
/// pictures must agree within 90 dB, and no brick may be loaded while it is measured.
#[derive(Args)]
#[command(
    after_help = "Times of frames are processor time where the device is a CPU, else device time; march and \
    management are device time. \"marks\" is what noting each used slot costs: the difference to a shader \
    variant without, which nothing else uses.\nGoals: ratio 1.10 dense, 0.5 sparse; management 5 %."
)]
pub struct Arguments {
    /// Voxels along each axis of the volume.
    #[arg(long, default_value_t = 256, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(8..=1024))]
    edge: u32,
    /// Voxels of its bricks along each axis.
    #[arg(long, default_value_t = 32, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(4..=128))]
    payload: u32,
    /// Picture size in pixels, across x down.
    #[arg(long, default_value = "512x512", value_name = "WxH", value_parser = pixels)]
    size: [u32; 2],
    /// Turns of which the median counts; one more warms up.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { edge, payload, size, repeats, .. } = *arguments;
    let effort = Effort { edge, payload, size, repeats };
    arguments.measuring.measure_under_bar(
        "bench overhead",
        |gpu, compiler, progress| measure(gpu, compiler, &effort, progress),
        describe,
    )?;
    Ok(())
}

fn describe(table: &OverheadTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{edge} cubed in bricks of {payload} at {width} x {height}, {} time of a frame, medians of {}, everything resident\n\n{:<24} {:>9} {:>9} {:>6} {:>14} {:>6} {:>6} {:>8} {:>7} {:>8}\n",
        table.device,
        table.driver,
        table.clock,
        table.repeats,
        "scene, filter, layout",
        "direct ms",
        "paged ms",
        "ratio",
        "least to most",
        "goal",
        "march",
        "managing",
        "marks",
        "PSNR dB",
        edge = table.edge,
        payload = table.payload,
    ))?;
    for case in &table.cases {
        let psnr = case.psnr_db.map_or("equal".to_owned(), |psnr| format!("{psnr:.1}"));
        print(format_args!(
            "{:<24} {:>9.1} {:>9.1} {:>6.2} {:>14} {:>6.2} {:>6.2} {:>6.2} % {:>5.1} % {psnr:>8}\n",
            format!("{}, {}, {}", case.scene, case.filter, case.layout),
            case.direct_ms.median,
            case.paged_ms.median,
            case.ratio.median,
            format!("{:.2} to {:.2}", case.ratio.least, case.ratio.most),
            case.ratio_goal,
            case.march_ratio.median,
            case.management_share.median * 100.0,
            case.marks_share.median * 100.0,
        ))?;
    }
    print(format_args!(
        "\n\"march\": the ratio of passes that march alone, on the device; goal of managing: {:.0} %\n",
        table.management_goal * 100.0
    ))
}
