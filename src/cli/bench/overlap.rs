//! `ashfall bench overlap`: how much of the transfer rendering hides.

use clap::Args;

use crate::cli::output::{print, print_json};
use crate::cli::progress::Progress;
use crate::cli::scene_flags::{SceneFlags, shader_compiler};
use crate::error::{Error, Exit, Result};
use crate::gpu::{Instance, Validation};
use crate::render::{Addressing, Settings};
use crate::scene::Refine;
use crate::study::overlap::{Effort, OverlapTable, measure};

/// How much of the transfer rendering hides: by queue topology, copy path and staging halves.
///
/// One orbit around the volume, drawn free running through a small atlas, by every topology that the device offers:
/// one queue, two of one family, a family that only copies with concurrent sharing, the same with an upload buffer
/// that is handed over by release and acquire. All pictures have to have the same bytes.
#[derive(Args)]
#[command(
    after_help = "\"overlap\" is the part of the copies' time beside which rays were marched, by the queues' timestamps; \
    with one queue for both there is none by nature. \"copied\" is 10^9 bytes of texels a second of the copies' time, \
    \"of plain\" that over one plain copy of a staging half on the same queue: the bus. \"waited\" is how long rendering \
    waited for bricks or loaders. Refinement is exact: the error is 0."
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Views of the orbit.
    #[arg(long, default_value_t = 11, value_parser = clap::value_parser!(u32).range(1..=128))]
    views: u32,
    /// Degrees between two of them.
    #[arg(long, default_value_t = 3.0, allow_hyphen_values = true)]
    degrees: f64,
    /// Turns that count, of which medians are taken; one more comes before them.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Index in `ashfall devices`, or part of the name; default: the most capable one.
    #[arg(long, env = "ASHFALL_DEVICE", help_heading = "Device")]
    device: Option<String>,
    /// Let the validation layers watch, synchronization included; any message ends with exit code 1.
    #[arg(long, help_heading = "Device")]
    validate: bool,
}

/// MiB of the atlas, unless --atlas-mib says another number.
const ATLAS_MIB: u64 = 8;

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    if !arguments.degrees.is_finite() {
        return Err(Error::arguments(format!(
            "--degrees: must be a number, got {}",
            arguments.degrees
        )));
    }
    let mut data = arguments.scene.load()?;
    data.scene.quality.refine = Refine::Exact;
    if arguments.scene.overrides().atlas_mib.is_none() {
        data.scene.memory.atlas_mib = ATLAS_MIB;
    }
    let mut settings = Settings { addressing: Addressing::Paged, ..Settings::default() };
    settings.paging.lockstep = false;
    let settings = settings.checked()?;
    let effort =
        Effort { views: arguments.views, degrees: arguments.degrees, repeats: arguments.repeats };
    let instance =
        Instance::new(if arguments.validate { Validation::On } else { Validation::Off })?;
    let progress = Progress::start("bench overlap");
    let table = measure(
        (&instance, arguments.device.as_deref()),
        &shader_compiler(),
        &data,
        settings,
        &effort,
        &mut |part| progress.set(part),
    )?;
    drop(progress);
    if arguments.json {
        print_json(&table)?
    } else {
        describe(&table)?
    }
    match instance.messages().first() {
        Some(first) => {
            Err(Error { exit: Exit::Bug, message: format!("validation said: {}", first.text) })
        }
        None => Ok(()),
    }
}

fn describe(table: &OverlapTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{} views at {width} x {height}, medians of {}; every picture has the same bytes ({})\n\n{:<16} {:<12} {:>6} {:>8} {:>7} {:>8} {:>8} {:>9} {:>9} {:>7}\n",
        table.device,
        table.driver,
        table.views,
        table.repeats,
        table.pictures,
        "queues",
        "path",
        "halves",
        "ms",
        "ratio",
        "overlap",
        "copied",
        "of plain",
        "waited",
        "bricks",
    ))?;
    for row in &table.rows {
        let or_none = |text: Option<String>| text.unwrap_or_else(|| "none".to_owned());
        print(format_args!(
            "{:<16} {:<12} {:>6} {:>8.0} {:>7.3} {:>8} {:>8} {:>9} {:>9.1} {:>7}\n",
            row.queues,
            row.path,
            row.halves,
            row.ms.median,
            row.over_first.median,
            or_none(row.overlap.map(|of| format!("{:.1} %", 100.0 * of.median))),
            or_none(row.copied_gb_per_second.map(|of| format!("{:.2}", of.median))),
            or_none(row.over_plain_copy.map(|of| format!("{of:.2}"))),
            row.waited_ms.median,
            row.bricks,
        ))?;
    }
    for not_run in &table.not_run {
        print(format_args!("not run: {}: {}\n", not_run.what, not_run.why))?;
    }
    Ok(())
}
