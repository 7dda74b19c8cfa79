//! Gives slots to the host, least recently used first, and lists what it should load.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::{CacheBuffers, RankShape, binds};
use crate::twins::cache::CacheRound;

/// The variant of a ranking.
pub fn variant(shape: RankShape) -> Variant {
    shape.variant("grant")
}

/// `order`: which of the two usage orders is this round's; the other one is made.
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
        .read("chunk_counts", &buffers.chunk_counts)
        .read("usage_order", &buffers.usage_order[order])
        .read("slot_used", &buffers.slot_used)
        .write("usage_order_next", &buffers.usage_order[1 - order])
        .write("grants", &buffers.grants)
        .write("requests", &buffers.requests)
        .update("page_table", &buffers.page_table)
        .update("slot_owner", &buffers.slot_owner)
        .update("wished", &buffers.wished)
        .update("touched", &buffers.touched)
        .update("answers", &buffers.answers);
    dispatch = buffers.bind_ranking(dispatch, pipeline);
    if let Some(weight) = buffers.wish_weight.as_ref().filter(|_| binds(pipeline, "wish_weight")) {
        dispatch = dispatch.update("wish_weight", weight);
    }
    dispatch.push(cache).threads([cache.chunks(), 1, 1]);
}
