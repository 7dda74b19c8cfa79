//! `ashfall bench features`: what each feature costs, by taking it away from the fullest scene.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::cli::scene_flags::pixels;
use crate::error::Result;
use crate::study::feature_price::{Counts, FeatureTable, measure};
use crate::study::ladder::Extent;

/// What each feature costs: a scene that has all of them, against the same scene without the feature, in
/// Vulkan objects, passes, shader instructions, bytes, and the time of a frame.
///
/// The scene is made in memory: three channels (f32 with NaN voxels, u16, RGBA) of a hill each, in bricks
/// through an atlas, in two views. All scenes are made first and their bricks brought to the device; then
/// they draw their first view in turns. What means nothing without a feature goes with it: without
/// paging nothing is skipped, without voxels that vary little is left.
#[derive(Args)]
#[command(
    after_help = "Counts are what the fullest scene has more than the one without. Below 0: that one needs \
    more.\n\"time\" is a frame of the fullest over one without, by processor time where the device is a \
    CPU, else device time: 1.20 means that the feature makes frames 1.2 times as dear. Features that \
    change what is drawn (channels, levels, early stop) are in it with all they change.\n--json also \
    names what goes with each feature, and what comes instead."
)]
pub struct Arguments {
    /// Voxels along each axis of the volume.
    #[arg(long, default_value_t = 160, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(8..=512))]
    edge: u32,
    /// Voxels of its bricks along each axis.
    #[arg(long, default_value_t = 32, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(4..=128))]
    payload: u32,
    /// Picture size in pixels, across x down; a little fewer than voxels, so that levels are used.
    #[arg(long, default_value = "128x128", value_name = "WxH", value_parser = pixels)]
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
    let extent = Extent { edge, payload, size };
    arguments.measuring.measure_under_bar(
        "bench features",
        |gpu, compiler, progress| measure(gpu, compiler, &extent, repeats, progress),
        describe,
    )?;
    Ok(())
}

fn describe(table: &FeatureTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{edge} cubed in bricks of {} at {width} x {height}, {} time of a frame, medians of {}, everything resident\n\n{:<24} {:>7} {:>14} {:>8} {:>7} {:>8} {:>7} {:>9} {:>13} {:>10}\n",
        table.device,
        table.driver,
        table.payload,
        table.clock,
        table.repeats,
        "taken away",
        "time",
        "least to most",
        "objects",
        "passes",
        "buffers",
        "images",
        "bindings",
        "instructions",
        "KiB",
        edge = table.edge,
    ))?;
    for row in &table.features {
        let time = row.time_ratio;
        line(
            &format!("{}{}", row.feature, if row.and.is_empty() { "" } else { " *" }),
            &format!("{:.2}", time.median),
            &format!("{:.2} to {:.2}", time.least, time.most),
            &differences(&table.fullest, &row.without).map(|count| format!("{count:+}")),
        )?;
    }
    let ms = table.fullest_ms;
    let all = values(&table.fullest).map(|count| count.to_string());
    let spread = format!("{:.0} to {:.0}", ms.least, ms.most);
    line("the fullest, ms", &format!("{:.0}", ms.median), &spread, &all)?;
    print("\n* and what means nothing without it\n")
}

fn line(what: &str, time: &str, spread: &str, counts: &[String; 7]) -> Result<()> {
    let [objects, passes, buffers, images, bindings, instructions, kib] = counts;
    print(format_args!(
        "{what:<24} {time:>7} {spread:>14} {objects:>8} {passes:>7} {buffers:>8} {images:>7} {bindings:>9} {instructions:>13} {kib:>10}\n"
    ))
}

/// In the order of the table's columns; bytes in KiB.
fn values(counts: &Counts) -> [i64; 7] {
    [
        counts.objects as i64,
        counts.passes as i64,
        counts.buffers as i64,
        counts.images as i64,
        counts.bindings as i64,
        i64::from(counts.spirv_instructions),
        (counts.memory_bytes / 1024) as i64,
    ]
}

fn differences(fullest: &Counts, without: &Counts) -> [i64; 7] {
    let (more, less) = (values(fullest), values(without));
    std::array::from_fn(|column| more[column] - less[column])
}
