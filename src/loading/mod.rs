//! Bricks on demand: a wish list, a RAM cache and loader threads. No Vulkan.
//!
//! [`Loading`] belongs to one thread, the owner, which says what it wishes and takes what comes;
//! loaders read beside it. Owner and loaders share two channels and nothing else, so every rule
//! (rank, staleness, epochs, retries) is plain code of one thread.
//!
//! # Invariants
//! - At most [`JOBS_PER_LOADER`] jobs per loader are under way, counted from the hand-over until the
//!   owner has taken the arrival. Both channels are that long, so no send ever blocks.
//! - No brick is read twice at the same time.
//! - A wish ends once: as a [`Delivery`], or dropped and counted.
//! - What a source gave before [`Loading::new_epoch`] is never delivered after it.
//!
//! # Bounds
//! The cache holds at most [`LoadingLimits::ram_bytes`] of voxels. Beside it stand, in voxels:
//! [`JOBS_PER_LOADER`] bricks (or surveyed blocks) per loader, read and not yet taken, with what was learned of them, and one buffer
//! per loader of at most twice the largest brick. A delivery is its taker's; an evicted brick is freed
//! with its last delivery. Wishes and surveys that wait are [`LoadingLimits::wishes_max`] each; more
//! are counted. Names of failed bricks and surveyed blocks are kept for the epoch, without voxels.

mod block;
mod cache;
mod delivery;
mod done;
mod job;
mod limits;
mod loaders;
mod owner;
mod statistics;
mod surveys;
mod wishes;

pub use block::{BLOCK_EDGE, Block};
pub use delivery::{Delivery, Wish};
pub use done::{DoneJob, DoneWork, Moments};
pub use job::Inspect;
pub use limits::{LOADERS_MAX, LoadingLimits, PAUSE_MAX};
pub use loaders::{JOBS_PER_LOADER, PATIENCE};
pub use owner::Loading;
pub use statistics::LoadingStatistics;
