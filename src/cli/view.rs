//! `ashfall view`: a scene in a window.

use std::path::PathBuf;

use clap::Args;

use crate::cli::output::write_json;
use crate::cli::picture_file::{write_picture, write_whole};
use crate::cli::render::file_of_view;
use crate::cli::scene_flags::{DeviceFlags, SceneFlags, WorkFlags, shader_compiler};
use crate::cli::stereo_flags::StereoFlags;
use crate::cli::trace_file::write_trace;
use crate::error::{Error, Result};
use crate::render::Addressing;
use crate::scene::{Refine, Wall};
use crate::viewer::error_meter::ErrorMeter;
use crate::viewer::{self, FileNames, Files, Live, PanelsAtFirst, Request, Screens};

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
    /// Panels at first: some, all of them opened, or none (Tab brings them).
    #[arg(long, value_name = "some|all|none", default_value = "some", value_parser = panels)]
    panels: PanelsAtFirst,
    /// Write what the window did as JSON when it is closed: frames, times, idle submits.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// What a round may take, milliseconds: uploads follow what is measured, and while something moves steps get up to
    /// 4 times as long and pixels up to 8 times as wide.
    #[arg(long, value_name = "MS", default_value_t = 120.0)]
    frame_ms: f64,
    /// Panels and their text so many times as large; default: what WINIT_X11_SCALE_FACTOR says, else 1.
    #[arg(long, value_name = "FACTOR")]
    panel_scale: Option<f32>,
    /// A window for each screen of a wall (.toml, see docs/VIEWER.md), and one to steer with.
    #[arg(long, value_name = "FILE", conflicts_with = "stereo", help_heading = "Wall")]
    wall: Option<PathBuf>,
    #[command(flatten)]
    stereo: StereoFlags,
    #[command(flatten)]
    device: DeviceFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// Opens the window and waits until it is closed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let panel_scale = panel_scale(arguments)?;
    if !(arguments.frame_ms > 0.0 && arguments.frame_ms.is_finite()) {
        let given = arguments.frame_ms;
        return Err(Error::arguments(format!("--frame-ms: must be above 0, got {given}")));
    }
    count_pixels();
    let mut settings = arguments.work.settings()?;
    settings.addressing = Addressing::Paged;
    settings.tile = [viewer::PICTURE_EDGE_MAX; 2];
    settings.paging.lockstep = arguments.work.asks_lockstep();
    settings.paging.frame_us =
        Some((arguments.frame_ms * 1e3).clamp(1.0, f64::from(u32::MAX)) as u32);
    let mut data = arguments.scene.load()?;
    let kept = data.scene.views.clone();
    if let Some(view) = &arguments.view {
        super::render::keep_views(&mut data.scene.views, std::slice::from_ref(view))?;
    }
    let first = data.scene.views[0].clone();
    if arguments.view.is_some() {
        // The others stay as they were kept.
        data.scene.views = kept;
        data.scene.views.sort_by_key(|view| view.name != first.name);
    }
    data.scene.quality.refine = Refine::Substitute;
    let screens = match (&arguments.wall, arguments.stereo.screens(&first)?) {
        (Some(file), _) => Screens::Wall(Wall::load(file)?),
        (None, Some(eyes)) => eyes,
        (None, None) => Screens::One,
    };
    let gpu = arguments.device.open_for_windows()?;
    let file = &arguments.scene.scene;
    let title = file.file_name().unwrap_or_default().to_string_lossy();
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let named = |ending: &str| PathBuf::from(format!("{stem}.{ending}"));
    let scene = data.scene.clone();
    let report = viewer::show(Request {
        title: format!("{title} - Ashfall"),
        names: FileNames {
            scene: arguments.save_as.clone().unwrap_or_else(|| named("view.toml")),
            picture: named("png"),
            trace: named("trace.json"),
        },
        files: Files {
            picture: write_picture,
            text: write_whole,
            trace: write_trace,
            of_frame: |path, frame| file_of_view(path, frame, 2),
        },
        size: scene.picture.size,
        middle: data.middle_world(0),
        levels: data.volumes[0].source.description().levels.count() as u8,
        screens,
        meter: ErrorMeter::new(data.again(scene.clone())?)?,
        scene,
        live: Live::new(&gpu, shader_compiler(), data, settings)?,
        gpu: gpu.clone(),
        panels: arguments.panels,
        panel_scale,
        frame_ms: arguments.frame_ms,
    })?;
    if let Some(file) = &arguments.report {
        write_json(file, &report)?;
    }
    DeviceFlags::heed_validation(&gpu)
}

/// Where winit reads how many pixels a point has.
const SCALE_OF_WINIT: &str = "WINIT_X11_SCALE_FACTOR";

fn panel_scale(arguments: &Arguments) -> Result<f32> {
    let of_desktop = || std::env::var(SCALE_OF_DESKTOP).ok()?.parse().ok();
    let scale = arguments.panel_scale.or_else(of_desktop).unwrap_or(1.0);
    match (0.25..=8.0).contains(&scale) {
        true => Ok(scale),
        false => Err(Error::arguments(format!("--panel-scale: must be 0.25 to 8, got {scale}"))),
    }
}

/// What the desktop's scale was before [`count_pixels`].
const SCALE_OF_DESKTOP: &str = "ASHFALL_DESKTOP_SCALE";

/// Has X11 count in pixels: egui-ash 0.4 paints panels right only where a point is a pixel, times egui's own zoom,
/// which [`panel_scale`] sets. The process becomes itself anew, since threads may read the environment already.
fn count_pixels() {
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::process::CommandExt;

        let scale = std::env::var(SCALE_OF_WINIT).unwrap_or_default();
        let Some(program) = std::env::current_exe().ok().filter(|_| scale != "1") else { return };
        let mut command = std::process::Command::new(program);
        command.args(std::env::args_os().skip(1)).env(SCALE_OF_WINIT, "1");
        if !scale.is_empty() {
            command.env(SCALE_OF_DESKTOP, scale);
        }
        // Where that cannot be, panels are as egui-ash paints them.
        let _ = command.exec();
    }
}

fn panels(text: &str) -> std::result::Result<PanelsAtFirst, String> {
    match text {
        "some" => Ok(PanelsAtFirst::Some),
        "all" => Ok(PanelsAtFirst::All),
        "none" => Ok(PanelsAtFirst::None),
        _ => Err("expected some, all or none".to_owned()),
    }
}
