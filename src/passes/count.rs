//! What each chunk of slots and wishes adds to the lists that grant writes.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::{CacheBuffers, RankShape};
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
    let dispatch = recorder
        .compute(pipeline)
        .read("choice", &buffers.choice)
        .read("usage_order", &buffers.usage_order[order])
        .read("slot_owner", &buffers.slot_owner)
        .read("slot_used", &buffers.slot_used)
        .read("wished", &buffers.wished)
        .write("chunk_counts", &buffers.chunk_counts);
    let dispatch = buffers.read_weights(buffers.bind_ranking(dispatch, pipeline), pipeline);
    dispatch.push(cache).threads([cache.chunks(), 1, 1]);
}
