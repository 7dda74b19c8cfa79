//! `ashfall plan`: what a scene needs on a device, before anything is made.

use clap::Args;

use crate::cli::output::{print, print_json};
use crate::cli::scene_flags::{DeviceFlags, SceneFlags, WorkFlags, shader_compiler};
use crate::error::Result;
use crate::render::Addressing;
use crate::study::layout_price;

/// Say what a scene needs on a device: every object, pass, shader variant and byte, and what is left
/// out and why. Makes no picture.
///
/// Nothing of the plan is made, but how voxels lie may be chosen by a measurement on the device, whose own
/// objects are gone when it ends; --layout plain or quads does without.
#[derive(Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// Prints the plan.
pub fn run(arguments: &Arguments) -> Result<()> {
    let settings = arguments.work.settings()?;
    let data = arguments.scene.load()?;
    // Before a device is looked for: drawing directly takes every voxel.
    if settings.addressing == Addressing::Direct {
        data.check_memory()?;
    }
    let gpu = arguments.device.open()?;
    let plan = layout_price::plan(&gpu, &shader_compiler(), &data, &settings)?;
    if arguments.json {
        print_json(&plan)?;
    } else {
        print(&plan)?;
    }
    DeviceFlags::heed_validation(&gpu)
}
