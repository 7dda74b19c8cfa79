//! What a window is opened with.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::Picture;
use crate::scene::Scene;
use crate::trace::Trace;
use crate::viewer::Live;
use crate::viewer::error_meter::ErrorMeter;
use crate::viewer::panels::{FileNames, PanelsAtFirst};
use crate::viewer::screens::Screens;

/// What a window is opened for.
pub struct Request {
    /// Its title.
    pub title: String,
    /// The scene whose first view it begins with.
    pub scene: Scene,
    /// Which pictures its camera's view becomes.
    pub screens: Screens,
    /// The middle of the volume, world: the camera turns around it.
    pub middle: glam::DVec3,
    /// Levels of the volume.
    pub levels: u8,
    /// Opened to present.
    pub gpu: Arc<Gpu>,
    /// Draws the scene's volume.
    pub live: Live,
    /// Compares pictures with the reference.
    pub meter: ErrorMeter,
    /// Where files go, unless another name is typed.
    pub names: FileNames,
    /// How they are written.
    pub files: Files,
    /// Pixels of its picture at first.
    pub size: [u32; 2],
    /// Milliseconds that a round may take, as `live` was told: steps get longer and pixels wider while something moves.
    pub frame_ms: f64,
    /// Panels and their text are so many times as large.
    pub panel_scale: f32,
    /// Which panels are there at first.
    pub panels: PanelsAtFirst,
}

/// How files are written: each whole under its name, or not at all.
#[derive(Clone, Copy)]
pub struct Files {
    /// A picture, by the ending of its name.
    pub picture: fn(&Path, &Picture) -> Result<()>,
    /// A text.
    pub text: fn(&Path, &str) -> Result<()>,
    /// What happened.
    pub trace: fn(&Path, &Trace) -> Result<()>,
    /// The name of a picture of a path, by that of all of them and the frame's.
    pub of_frame: fn(&Path, &str) -> PathBuf,
}
