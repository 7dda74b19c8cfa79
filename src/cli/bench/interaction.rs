//! `ashfall bench interaction`: how soon a picture follows a hand.

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::print;
use crate::cli::scene_flags::{SceneFlags, shader_compiler};
use crate::error::Result;
use crate::render::{Addressing, Settings};
use crate::scene::Refine;
use crate::viewer::PICTURE_EDGE_MAX;
use crate::viewer::interaction::{Effort, InteractionTable, measure};

/// How soon a picture follows a camera that moves, as in `ashfall view` but for the window itself, by the size
/// of the atlas.
///
/// The camera turns around the volume's middle, a step as soon as the picture of the one before is there, and
/// rests at the end until the picture is finished. Each atlas begins with nothing loaded. Pictures are drawn at
/// their full size all along; the window draws smaller ones while something moves.
#[derive(Args)]
#[command(
    after_help = "Times are milliseconds on the wall: what a user waits. \"rounds\" is how many end between a \
    step and its first picture, at most: the one under way, and its own."
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Atlases, MiB, one after the other.
    #[arg(long, value_name = "MIB", value_delimiter = ',', default_value = "8,16,64,512",
          value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    atlases: Vec<u64>,
    /// Steps of the path.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    steps: u32,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut data = arguments.scene.load()?;
    data.scene.views.truncate(1);
    data.scene.quality.refine = Refine::Substitute;
    let mut settings = Settings {
        addressing: Addressing::Paged,
        tile: [PICTURE_EDGE_MAX; 2],
        ..Settings::default()
    };
    settings.paging.lockstep = false;
    let effort = Effort { steps: arguments.steps, atlases_mib: arguments.atlases.clone() };
    arguments.measuring.measure_under_bar(
        "bench interaction",
        |gpu, _, progress| measure(gpu, &shader_compiler, &data, settings, &effort, progress),
        describe,
    )?;
    Ok(())
}

fn describe(table: &InteractionTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{width} x {height}, {} steps, ms on the wall\n\n{:>9} {:>9} {:>9} {:>7} {:>7} {:>7} {:>9} {:>11} {:>7} {:>7}\n",
        table.device,
        table.driver,
        table.steps,
        "atlas MiB",
        "first",
        "step",
        "p95",
        "worst",
        "rounds",
        "round max",
        "converged",
        "rounds",
        "read",
    ))?;
    for row in &table.rows {
        print(format_args!(
            "{:>9} {:>9.0} {:>9.0} {:>7.0} {:>7.0} {:>7} {:>9.0} {:>11.0} {:>7} {:>7}\n",
            row.atlas_mib,
            row.first_picture_ms,
            row.step_ms,
            row.step_p95_ms,
            row.step_worst_ms,
            row.rounds_to_picture_max,
            row.round_worst_ms,
            row.converged_ms,
            row.converged_rounds,
            row.bricks_read,
        ))?;
    }
    Ok(())
}
