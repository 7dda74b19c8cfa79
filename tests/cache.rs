//! The cache: its twins against a naive model, its shaders against the twins over long random runs,
//! rays through bricks that come and go, and what is claimed of ranks.
//!
//! Long runs: `cargo test --test cache -- --include-ignored`. A failure names seed and round.

mod common;
mod random;
mod truth;

#[path = "cache/brick_scene.rs"]
mod brick_scene;
#[path = "cache/faults.rs"]
mod faults;
#[path = "cache/forget.rs"]
mod forget;
#[path = "cache/host.rs"]
mod host;
#[path = "cache/invariants.rs"]
mod invariants;
#[path = "cache/leaves.rs"]
mod leaves;
#[path = "cache/marching.rs"]
mod marching;
#[path = "cache/marching_faults.rs"]
mod marching_faults;
#[path = "cache/model.rs"]
mod model;
#[path = "cache/on_device.rs"]
mod on_device;
#[path = "cache/rank_order.rs"]
mod rank_order;
#[path = "cache/sequences.rs"]
mod sequences;
#[path = "cache/twin_round.rs"]
mod twin_round;
#[path = "cache/view_levels.rs"]
mod view_levels;
#[path = "twins/views.rs"]
mod views;
#[path = "cache/world.rs"]
mod world;
