//! The residency octree: its twin against a naive model over long random runs, rays through its nodes
//! against the voxels themselves, the host's books of it, its shader against the twin, and what exact ranges are for.
//!
//! Long runs: `cargo test --test octree -- --include-ignored`. A failure names seed and step.

mod common;
mod random;
mod truth;

#[path = "octree/early_stop.rs"]
mod early_stop;
#[path = "octree/faults.rs"]
mod faults;
#[path = "octree/host.rs"]
mod host;
#[path = "octree/host_model.rs"]
mod host_model;
#[path = "octree/model.rs"]
mod model;
#[path = "octree/narrow_windows.rs"]
mod narrow_windows;
#[path = "octree/on_device.rs"]
mod on_device;
#[path = "octree/sequences.rs"]
mod sequences;
#[path = "cache/faults.rs"]
mod shader_faults;
#[path = "octree/shapes.rs"]
mod shapes;
#[path = "octree/state.rs"]
mod state;
#[path = "octree/walks.rs"]
mod walks;
#[path = "octree/world.rs"]
mod world;
