//! The viewer: the picture that follows what is wanted, and the real window on a virtual desktop.

mod binary;
mod common;
mod folder;

#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/desktop.rs"]
mod desktop;
#[path = "viewer/live.rs"]
mod live;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/pictures.rs"]
mod pictures;
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[path = "viewer/window.rs"]
mod window;
