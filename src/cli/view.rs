//! `ashfall view`: a scene in a window.

use std::path::PathBuf;

use clap::Args;

use crate::cli::output::write_json;
use crate::cli::scene_flags::{DeviceFlags, SceneFlags, WorkFlags, shader_compiler};
use crate::error::Result;
use crate::render::Addressing;
use crate::scene::Refine;
use crate::viewer::{self, Live, Request};

/// Look at a scene in a window, and steer the camera.
///
/// Drag to turn, right drag to move, wheel to come nearer; Tab takes the panels away. Pictures are whole
/// from the first on and get sharper while the camera rests (refine "substitute", bricks always in pages);
/// when all is there and nothing moves, the device rests too. --size is the picture's part of the window.
#[derive(Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Begin with this view; default: the scene's first.
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Save the scene as it is seen to this file, on Ctrl and S; default: its name with .view.toml, here.
    #[arg(long, value_name = "FILE")]
    save_as: Option<PathBuf>,
    /// Write what the window did as JSON when it is closed: frames, times, idle submits.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// Opens the window and waits until it is closed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut settings = arguments.work.settings()?;
    settings.addressing = Addressing::Paged;
    settings.tile = [viewer::PICTURE_EDGE_MAX; 2];
    settings.paging.lockstep = arguments.work.asks_lockstep();
    let mut data = arguments.scene.load()?;
    if let Some(view) = &arguments.view {
        super::render::keep_views(&mut data.scene.views, std::slice::from_ref(view))?;
    }
    data.scene.views.truncate(1);
    data.scene.quality.refine = Refine::Substitute;
    let gpu = arguments.device.open_for_windows()?;
    let file = &arguments.scene.scene;
    let title = file.file_name().unwrap_or_default().to_string_lossy();
    let beside = || {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        PathBuf::from(format!("{stem}.view.toml"))
    };
    let (scene, middle) = (data.scene.clone(), data.middle_world(0));
    let report = viewer::show(Request {
        title: format!("{title} - Ashfall"),
        save_as: arguments.save_as.clone().unwrap_or_else(beside),
        size: scene.picture.size,
        scene,
        middle,
        live: Live::new(&gpu, shader_compiler(), data, settings)?,
        gpu: gpu.clone(),
    })?;
    if let Some(file) = &arguments.report {
        write_json(file, &report)?;
    }
    DeviceFlags::heed_validation(&gpu)
}
