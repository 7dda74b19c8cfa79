//! The viewer: the picture that follows what is wanted, and the real window on a virtual desktop.

mod binary;
mod common;
mod folder;

#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/desktop.rs"]
mod desktop;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/files.rs"]
mod files;
#[path = "viewer/live.rs"]
mod live;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/many_windows.rs"]
mod many_windows;
#[path = "viewer/overview.rs"]
mod overview;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/pictures.rs"]
mod pictures;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/window.rs"]
mod window;
