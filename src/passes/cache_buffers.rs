//! Buffers of the cache, as the passes that manage it share them, and their variants.

use crate::gpu::{Buffer, ComputePipeline, Dispatch, Variant};

/// How wishes and slots are ranked: shapes every pass that ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RankShape {
    /// Levels of the volume.
    pub levels: u32,
    /// How wishes and slots are ranked.
    pub order: RankOrder,
}

/// What bricks are ranked by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RankOrder {
    /// Wishes and slots by the bricks between them and the eye: exact refinement.
    Guarded,
    /// Wishes by weight; slots by use, but what this round used stays: substitute refinement.
    Substitute,
    /// Wishes by how many rays wait, slots by use alone, as in the papers: to show where it stands still.
    Papers,
}

impl RankOrder {
    /// Whether wishes have weights.
    pub fn weighs(self) -> bool {
        self != RankOrder::Guarded
    }
}

impl RankShape {
    /// A variant of `shader`, which ranks.
    pub fn variant(self, shader: &'static str) -> Variant {
        let variant = Variant::plain(shader).define("LEVELS", self.levels);
        match self.order {
            RankOrder::Guarded => variant,
            RankOrder::Substitute => variant.define("WEIGHTS", 1).define("SUBSTITUTE", 1),
            RankOrder::Papers => variant.define("WEIGHTS", 1).define("PAPERS", 1),
        }
    }
}

/// Every buffer of the cache. All atlases share them.
pub struct CacheBuffers {
    /// `[entry]` state and slot.
    pub page_table: Buffer,
    /// `[slot]` entry whose brick the slot holds.
    pub slot_owner: Buffer,
    /// `[slot]` round in which a ray last used it.
    pub slot_used: Buffer,
    /// `[slot]` round in which a waiting ray last needed it; guarded order alone.
    pub slot_needed: Option<Buffer>,
    /// `[slot]` least recently used first; this round's and the next one's, taking turns.
    pub usage_order: [Buffer; 2],
    /// `[word]` one bit per entry.
    pub wished: Buffer,
    /// `[entry]` what the brick would add; where wishes have weights.
    pub wish_weight: Option<Buffer>,
    /// `[word]` one bit per entry that rays have used.
    pub touched: Buffer,
    /// Front of the rays.
    pub progress: Buffer,
    /// `[rank]`
    pub wishes_of_rank: Buffer,
    /// `[rank]`
    pub live_of_rank: Buffer,
    /// Before anything is chosen.
    pub tallies: Buffer,
    /// How many slots are granted.
    pub choice: Buffer,
    /// `[chunk]`
    pub chunk_counts: Buffer,
    /// `[atlas]` what the host is told.
    pub answers: Buffer,
    /// `[grant]` slots for the host.
    pub grants: Buffer,
    /// `[request]` entry and rank.
    pub requests: Buffer,
    /// `[update]` what the host learned; written while the device does something else, taking turns.
    pub updates: [Buffer; 2],
    /// `[level]` of the view.
    pub levels: Buffer,
}

impl CacheBuffers {
    /// Binds what the variant of a pass that ranks reads to rank by.
    pub(super) fn bind_ranking<'a, 'r>(
        &'r self,
        mut dispatch: Dispatch<'a, 'r>,
        pipeline: &ComputePipeline,
    ) -> Dispatch<'a, 'r> {
        if binds(pipeline, "levels") {
            dispatch = dispatch.uniform("levels", &self.levels);
        }
        if binds(pipeline, "progress") {
            dispatch = dispatch.read("progress", &self.progress);
        }
        match self.slot_needed.as_ref().filter(|_| binds(pipeline, "slot_needed")) {
            Some(needed) => dispatch.read("slot_needed", needed),
            None => dispatch,
        }
    }

    /// Binds weights of wishes to a pass whose variants only read them; grant forgets some.
    pub(super) fn read_weights<'a, 'r>(
        &'r self,
        dispatch: Dispatch<'a, 'r>,
        pipeline: &ComputePipeline,
    ) -> Dispatch<'a, 'r> {
        match self.wish_weight.as_ref().filter(|_| binds(pipeline, "wish_weight")) {
            Some(weight) => dispatch.read("wish_weight", weight),
            None => dispatch,
        }
    }
}

/// Whether the pipeline's variant binds something of this name.
pub(super) fn binds(pipeline: &ComputePipeline, name: &str) -> bool {
    pipeline.reflection().bindings.iter().any(|binding| binding.name == name)
}
