//! `ashfall bench trace`: what recording a trace costs, and what it costs to be able to.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::cli::scene_flags::{SceneFlags, WorkFlags};
use crate::cli::views_flags::ViewsFlags;
use crate::error::{Error, Result};
use crate::render::Addressing;
use crate::study::trace_price::{TracePrice, measure};

/// What `--trace` costs: the scene's views drawn in turns with a trace and without one, and what it costs that there
/// could be one.
///
/// Three renderers draw every view, one with a trace and two without, each first in its turn as often as the others.
/// All pictures must have the same bytes. Nothing is loaded at the beginning; in an atlas that holds all, later turns
/// draw what is there, in a smaller one (--atlas-mib) bricks come and go all the time.
#[derive(Args)]
#[command(
    after_help = "Times are processor time where the device is a CPU, else time on the wall. \"off\": how often a \
    trace was told something in a frame, times the cost of a place that finds none, as a part of the frame.\n\
    Drawn in bricks, unless --addressing direct.\nGoal: ratio 1.03."
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    #[command(flatten)]
    views: ViewsFlags,
    /// Turns that count; one more warms up.
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut settings = arguments.work.settings()?;
    let mut data = arguments.scene.load()?;
    let pictures = arguments.views.apply(&mut data, arguments.scene.overrides().size)?;
    if !pictures.are_plain() {
        return Err(Error::arguments(
            "bench trace times views as they are drawn: leave out --stereo and --wall",
        ));
    }
    match settings.addressing {
        Addressing::Direct => data.check_memory()?,
        _ => settings.addressing = Addressing::Paged,
    }
    let repeats = arguments.repeats;
    arguments.measuring.measure_under_bar(
        "bench trace",
        |gpu, compiler, progress| measure(gpu, compiler, &data, &settings, repeats, progress),
        describe,
    )?;
    Ok(())
}

fn describe(price: &TracePrice) -> Result<()> {
    let [width, height] = price.size;
    let [low, high] = price.ratio_middle_half;
    print(format_args!(
        "{} ({})\n{} views of {width} x {height}, {} time, {} turns; equal pictures\n\n",
        price.device, price.driver, price.views, price.clock, price.repeats
    ))?;
    print(format_args!(
        "on:    {:.3} of the time without, half of them from {low:.3} to {high:.3} (all: {:.3} to {:.3}), goal {:.2}; on the wall {:.3}\n",
        price.ratio.median,
        price.ratio.least,
        price.ratio.most,
        price.ratio_goal,
        price.wall_ratio.median
    ))?;
    print(format_args!(
        "noise: {:.3} of two without (all: {:.3} to {:.3})\n",
        price.noise.median, price.noise.least, price.noise.most
    ))?;
    print(format_args!(
        "frame: {:.2} ms without, {:.2} with; {:.1} rounds, {:.1} bricks, {:.0} events: {:.0} bytes of memory, {:.0} of the file\n",
        price.off_ms.median,
        price.on_ms.median,
        price.rounds,
        price.bricks_uploaded,
        price.events,
        price.memory_bytes,
        price.file_bytes
    ))?;
    print(format_args!(
        "off:   {:.0} places a frame, {:.2} ns each without a trace: {:.5} % of the frame\n",
        price.places,
        price.place_ns,
        100.0 * price.off_share
    ))
}
