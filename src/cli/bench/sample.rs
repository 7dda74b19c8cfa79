//! `ashfall bench sample`: what one sample costs on a device, and the error it was bought with.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::error::Result;
use crate::study::sample_price::{Effort, PriceTable, measure};

/// The price of one sample on this device: the loop alone, one texel, every filter and format, each
/// with its greatest error; and the caster's own price beside the bare ones.
#[derive(Args)]
pub struct Arguments {
    /// A small run, to see that it works; its figures mean little.
    #[arg(long)]
    small: bool,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    let effort = if arguments.small { Effort::SMALL } else { Effort::FULL };
    arguments.measuring.measure_under_bar(
        "bench sample",
        |gpu, compiler, progress| measure(gpu, compiler, &effort, progress),
        describe,
    )?;
    Ok(())
}

fn describe(table: &PriceTable) -> Result<()> {
    print(format_args!(
        "{} ({})\n{:.1} million samples a measurement, {} time, medians\n\n{:<28} {:>8} {:>15} {:>10} {:>10} {:>10}\n",
        table.device,
        table.driver,
        table.million_samples,
        table.clock,
        "one sample",
        "ns",
        "least to most",
        "over loop",
        "over bare",
        "error"
    ))?;
    for price in &table.prices {
        let [least, most] = price.ns_min_max;
        let over_bare = price.over_bare.map(|ratio| format!("{ratio:.2}")).unwrap_or_default();
        let error = price.error_max.map(|error| format!("{error:.1e}")).unwrap_or_default();
        print(format_args!(
            "{:<28} {:>8.2} {:>15} {:>10.2} {over_bare:>10} {error:>10}\n",
            price.what,
            price.ns,
            format!("{least:.2} to {most:.2}"),
            price.over_loop
        ))?;
    }
    Ok(())
}
