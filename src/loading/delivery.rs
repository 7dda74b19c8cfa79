//! What goes in and comes out: wishes and deliveries.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::loading::Block;
use crate::source::BrickEntry;
use crate::volume::{BrickId, ValueRange};

/// A brick that somebody waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wish {
    /// Which; its volume is the index of the source.
    pub id: BrickId,
    /// Smaller is sooner.
    pub rank: u64,
}

/// What [`Loading::next`](crate::loading::Loading::next) gives.
#[derive(Clone, Debug, PartialEq)]
pub enum Delivery {
    /// A wished brick.
    Brick {
        /// Which.
        id: BrickId,
        /// Its voxels, apron included, as `BrickSource::read` gives them.
        bytes: Arc<[u8]>,
        /// Whether nothing had to be read for this wish.
        from_cache: bool,
        /// What [`Inspect`](crate::loading::Inspect) says of the voxels. Nothing where nobody asks, nor from
        /// the cache: it was said with the delivery that followed the read, in the same epoch.
        leaf_ranges: Option<Vec<ValueRange>>,
    },
    /// A wished brick that could not be read, however often it was tried. Said once an epoch.
    Failed {
        /// Which.
        id: BrickId,
        /// What the last attempt said.
        why: Error,
    },
    /// What the source knows of a block's bricks without reading voxels.
    Surveyed {
        /// Which.
        block: Block,
        /// Every brick of the block, x fastest, then y, then z. Where the block lies outside of every
        /// volume: its first brick with the reason.
        entries: Vec<(BrickId, Result<BrickEntry>)>,
    },
}

impl Delivery {
    /// Whether it brings this brick's voxels.
    pub fn is_brick(&self, wanted: BrickId) -> bool {
        matches!(self, Delivery::Brick { id, .. } if *id == wanted)
    }
}
