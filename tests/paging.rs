//! Drawing in bricks through an atlas, end to end: the same bytes whatever the atlas holds, each brick
//! loaded about once, an end in every case, and an honest word where the picture lacks something.
//!
//! Longer variants: `cargo test --test paging -- --include-ignored`.

mod binary;
mod common;
mod folder;

#[path = "paging/channel_levels.rs"]
mod channel_levels;
#[path = "paging/epochs.rs"]
mod epochs;
#[path = "paging/faults.rs"]
mod faults;
#[path = "paging/level_borders.rs"]
mod level_borders;
#[path = "paging/loads_once.rs"]
mod loads_once;
#[path = "paging/made_volumes.rs"]
mod made_volumes;
#[path = "paging/pacing.rs"]
mod pacing;
#[path = "paging/papers_order.rs"]
mod papers_order;
#[path = "paging/plan.rs"]
mod plan;
#[path = "paging/recovery.rs"]
mod recovery;
#[path = "paging/replay.rs"]
mod replay;
#[path = "paging/replay_files.rs"]
mod replay_files;
#[path = "paging/same_bytes.rs"]
mod same_bytes;
#[path = "paging/sample_rates.rs"]
mod sample_rates;
#[path = "paging/scene_changes.rs"]
mod scene_changes;
#[path = "paging/substitute.rs"]
mod substitute;
#[path = "paging/topologies.rs"]
mod topologies;
#[path = "paging/two_queues.rs"]
mod two_queues;
#[path = "paging/worlds.rs"]
mod worlds;
