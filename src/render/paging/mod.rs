//! Drawing through an atlas that holds a part of the volume: the paging loop's host side.
//!
//! `plan.rs` says what it takes, `paged.rs` holds the objects, `rounds.rs` turns the loop, `round.rs` submits one turn of it, `host_cache.rs`
//! keeps the books, `leaf_words.rs` those of the residency octree. `change.rs` goes from one scene to another.
//!
//! # Source
//! DESIGN section 5.

mod brick_numbers;
mod brick_texels;
mod change;
mod channel_levels;
mod host_cache;
mod leaf_words;
mod paced_rounds;
mod pacer;
mod paged;
mod placing;
mod plan;
mod planned_octree;
mod recording;
mod replaying;
mod round;
mod rounds;
mod script;
mod settings;
mod slot_map;
mod traversal_choice;
mod view_levels;
mod visibility;
mod watching;

pub use brick_numbers::{BrickNumbers, ChannelPlace};
pub use brick_texels::write_texels;
pub use leaf_words::{LeafChannel, LeafWords, LeafWork};
pub use paced_rounds::RoundPace;
pub use pacer::{LADDER, Measured, Paced, Pacer, Rung};
pub use planned_octree::PlannedOctree;
pub use settings::{CopyPath, LoadOrder, PagingSettings, Traversal};
pub use view_levels::{LevelChoice, ViewLevels};

pub(super) use paged::Paged;
pub(crate) use paged::StagedBrick;
pub(crate) use placing::Placing;
pub(super) use placing::slots_by_atlas;
pub(super) use plan::PagingPlan;
pub use recording::{RecordedOf, Recording};
pub(super) use rounds::draw;
pub use script::Replayed;
pub use slot_map::SlotBrick;
pub(super) use view_levels::longest_diagonal_world;
pub use visibility::{Judge, Shows};
pub(super) use watching::Watch;
pub use watching::{RoundCache, RoundPicture};
