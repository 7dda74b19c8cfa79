//! `ashfall bench upload`: how fast bricks come to the device, over memcpy.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::error::Result;
use crate::study::upload_price::{Effort, UploadTable, measure};

/// How fast bricks come to the device: bytes of texels a second over those of memcpy, measured in the
/// same turns.
///
/// The host turns voxels into texels in a staging half (host); the transfer role copies them into slots,
/// or into an upload buffer from which a compute pass places them (copy); and in a frame one half is
/// filled while the other is on its way (both). Beside them: as many bytes as one region, what an image
/// costs that needs no bricks.
#[derive(Args)]
#[command(
    after_help = "Straight: copied from the staging half into slots. Placed: copied into the upload buffer and \
    stored into slots by a compute pass; left out where a device's shaders cannot store such texels.\nTime is processor time where the \
    device is a CPU, else time on the wall; \"wall\" is always the latter, and tells what working side by \
    side is worth."
)]
pub struct Arguments {
    /// Voxels of a brick along each axis, without apron; any number of them.
    #[arg(long, value_name = "VOXELS", value_delimiter = ',', default_value = "16,32,64",
          value_parser = clap::value_parser!(u32).range(1..=254))]
    payload: Vec<u32>,
    /// Texels moved in one turn.
    #[arg(long, default_value_t = 64, value_name = "MIB",
          value_parser = clap::value_parser!(u32).range(1..=512))]
    mib: u32,
    /// Both staging halves together.
    #[arg(long, default_value_t = 16, value_name = "MIB",
          value_parser = clap::value_parser!(u32).range(1..=1024))]
    staging_mib: u32,
    /// Turns of which the median counts; one more warms up.
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    let effort = Effort {
        payloads: arguments.payload.clone(),
        mib: arguments.mib,
        staging_mib: arguments.staging_mib,
        repeats: arguments.repeats,
    };
    arguments.measuring.measure_under_bar(
        "bench upload",
        |gpu, compiler, progress| measure(gpu, compiler, &effort, progress),
        describe,
    )?;
    Ok(())
}

fn describe(table: &UploadTable) -> Result<()> {
    print(format_args!(
        "{} ({})\nbytes of texels a second over memcpy's, {} time, medians of {} (least to most)\n\n{:<30} {:>11} {:>20} {:>20} {:>20} {:>6} {:>20}\n",
        table.device,
        table.driver,
        table.clock,
        table.repeats,
        "path, payload, voxels, layout",
        "memcpy GB/s",
        "host",
        "copy",
        "both",
        "wall",
        "one region",
    ))?;
    for row in &table.rows {
        let ratio = |rate: &crate::study::upload_price::Rate| {
            let over = rate.over_memcpy;
            format!("{:.2} ({:.2} to {:.2})", over.median, over.least, over.most)
        };
        print(format_args!(
            "{:<30} {:>11.2} {:>20} {:>20} {:>20} {:>6.2} {:>20}\n",
            format!("{}, {}, {}, {}", row.path, row.payload, row.voxels, row.layout),
            row.memcpy.gb_per_second.median,
            ratio(&row.host),
            ratio(&row.copy),
            ratio(&row.together),
            row.together.wall_over_memcpy.median,
            ratio(&row.one_region),
        ))?;
    }
    for left in &table.left_out {
        print(format_args!("left out: {} for {}: {}\n", left.path, left.texels, left.why))?;
    }
    Ok(())
}
