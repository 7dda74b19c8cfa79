//! What each chunk of slots and wishes adds to the lists that grant writes.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::{CacheBuffers, RankShape, binds};
use crate::twins::cache::CacheRound;

/// The variant of a ranking.
pub fn variant(shape: RankShape) -> Variant {
    shape.variant("count")
}

/// `order`: which of the two usage orders is this round's.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    order: usize,
    cache: &CacheRound,
) {
    let mut dispatch = recorder
        .compute(pipeline)
        .read("choice", &buffers.choice)
        .read("usage_order", &buffers.usage_order[order])
        .read("slot_owner", &buffers.slot_owner)
        .read("slot_used", &buffers.slot_used)
        .read("wished", &buffers.wished)
        .write("chunk_counts", &buffers.chunk_counts);
    if binds(pipeline, "levels") {
        dispatch = dispatch.uniform("levels", &buffers.levels);
    }
    if binds(pipeline, "progress") {
        dispatch = dispatch.read("progress", &buffers.progress);
    }
    if let Some(needed) = buffers.slot_needed.as_ref().filter(|_| binds(pipeline, "slot_needed")) {
        dispatch = dispatch.read("slot_needed", needed);
    }
    if let Some(weight) = buffers.wish_weight.as_ref().filter(|_| binds(pipeline, "wish_weight")) {
        dispatch = dispatch.read("wish_weight", weight);
    }
    dispatch.push(cache).threads([cache.chunks(), 1, 1]);
}
