//! `ashfall study --suite stability`: whether scenes at the edges of what numbers allow hold.

use std::path::Path;
use std::sync::Arc;

use clap::{Args, ValueEnum};

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::{make_folder, print, write, write_json};
use crate::cli::progress;
use crate::cli::scene_flags::shader_compiler;
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::study::stability::suite::{Choice, run as draw};

/// Flags of a study of one scene, which a suite does not take.
pub(super) const OF_A_SCENE: [&str; 51] = [
    "scene",
    "raw_size",
    "raw_type",
    "raw_endian",
    "spacing",
    "time",
    "segy_inline_byte",
    "segy_crossline_byte",
    "size",
    "background",
    "integrator",
    "step",
    "tolerance",
    "filter",
    "refine",
    "level_max",
    "level_loss",
    "early_stop",
    "atlas_mib",
    "ram_mib",
    "staging_mib",
    "view",
    "repeats",
    "error_max",
    "jobs",
    "only",
    "steps",
    "tolerances",
    "axis_step",
    "filters",
    "early_stops",
    "levels",
    "atlas_sizes",
    "streaming_bricks",
    "tile",
    "steps_per_dispatch",
    "submit_ms",
    "layout",
    "no_skipping",
    "addressing",
    "traversal",
    "leaf",
    "fan_out",
    "atlas_slots",
    "staging_bricks",
    "loaders",
    "copy_path",
    "lockstep",
    "free_running",
    "show_states",
    "patience",
];

/// Which suite, and what of it.
#[derive(Args)]
pub struct Flags {
    /// In place of a scene, draw scenes that come with the program and hold each to what must hold.
    #[arg(long, value_enum, conflicts_with_all = OF_A_SCENE, help_heading = "A suite in place of a scene")]
    suite: Option<Suite>,
    /// Themes: fields, transfers, values, places, cameras. Default: all.
    #[arg(
        long,
        value_name = "NAME",
        value_delimiter = ',',
        requires = "suite",
        conflicts_with = "scene",
        help_heading = "A suite in place of a scene"
    )]
    theme: Vec<String>,
    /// A case by its name in the table; may be given more than once. Default: all.
    #[arg(
        long,
        value_name = "NAME",
        requires = "suite",
        conflicts_with = "scene",
        help_heading = "A suite in place of a scene"
    )]
    case: Vec<String>,
    /// Multiply every case's bound by this: below 1, to see how much room the bounds leave.
    #[arg(
        long,
        value_name = "X",
        default_value_t = 1.0,
        requires = "suite",
        conflicts_with = "scene",
        allow_hyphen_values = true,
        help_heading = "A suite in place of a scene"
    )]
    bound_factor: f64,
}

/// The suites there are.
#[derive(Clone, Copy, ValueEnum)]
enum Suite {
    // Scenes at the edges of what numbers allow.
    Stability,
}

impl Flags {
    /// Whether a suite is asked for.
    pub fn named(&self) -> bool {
        self.suite.is_some()
    }
}

/// Draws the suite, prints and writes its table.
pub fn run(
    flags: &Flags,
    integrators: Vec<&'static str>,
    folder: Option<&Path>,
    measuring: &MeasuringFlags,
) -> Result<()> {
    let factor = flags.bound_factor;
    if !(factor.is_finite() && factor > 0.0) {
        return Err(Error::arguments(format!(
            "--bound-factor: must be above 0 and finite, got {factor}"
        )));
    }
    let choice = Choice { themes: flags.theme.clone(), cases: flags.case.clone(), integrators };
    let draws = choice.draws()?;
    if let Some(folder) = folder {
        make_folder(folder)?;
    }
    let measured = |gpu: &Arc<Gpu>| {
        let bar = progress::cases("stability");
        bar.set_length(draws.len() as u64);
        let table = draw(gpu, &shader_compiler(), &draws, factor, &mut |done, key| {
            bar.set_message(key.to_owned());
            bar.set_position(done as u64);
        });
        bar.finish_and_clear();
        let table = table?;
        if let Some(folder) = folder {
            write_json(&folder.join("stability.json"), &table)?;
            write(&folder.join("stability.csv"), &table.csv())?;
        }
        Ok(table)
    };
    measuring.measure(measured, |table| print(table.text()))?.held()
}
