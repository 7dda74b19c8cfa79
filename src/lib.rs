//! Ashfall draws volumes that fit in no memory: an out-of-core volume renderer on Vulkan.
//!
//! Start at [`scene`] for what can be drawn, at [`render`] for how a frame is made, and at
//! `docs/ARCHITECTURE.md` for the rooms and what is deliberately absent from each.

pub mod cli;
pub mod error;
pub mod gpu;
pub mod import;
pub mod loading;
pub mod passes;
pub mod reference;
pub mod render;
pub mod residency;
pub mod scene;
pub mod source;
pub mod store;
pub mod study;
pub mod trace;
pub mod twins;
pub mod viewer;
pub mod volume;
