//! The window: a picture that follows the camera, panels beside it, and no work at all while nothing changes.
//!
//! [`Live`] draws on a thread of its own; the window's thread turns input into scenes that it wants, and
//! shows what was drawn last. Windows and panels are egui-ash's, surfaces and submits ours
//! ([`crate::gpu::Windows`]).

mod camera;
#[cfg(feature = "viewer")]
mod commands;
#[cfg(feature = "viewer")]
mod distances;
pub mod error_meter;
pub mod interaction;
mod live;
pub mod overview;
#[cfg(feature = "viewer")]
mod painting;
#[cfg(feature = "viewer")]
mod panels;
#[cfg(feature = "viewer")]
mod path_walk;
#[cfg(feature = "viewer")]
mod report;
#[cfg(feature = "viewer")]
mod request;
pub mod screens;
#[cfg(feature = "viewer")]
mod side_windows;
#[cfg(feature = "viewer")]
mod steering;
#[cfg(feature = "viewer")]
mod window;

pub use camera::{Along, Camera};
pub use live::{Live, Shown, Wanted};
pub use screens::{EyesLayout, Screens};
/// Pixels along an edge of a window's picture, at most: one tile holds it.
pub const PICTURE_EDGE_MAX: u32 = 4096;

#[cfg(feature = "viewer")]
pub use panels::{FileNames, PanelsAtFirst};
#[cfg(feature = "viewer")]
pub use report::Report;
#[cfg(feature = "viewer")]
pub use request::{Files, Request};
#[cfg(feature = "viewer")]
pub use window::show;
