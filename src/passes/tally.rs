//! How many slots and wishes of an atlas there are of each rank.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::{CacheBuffers, RankShape, binds};
use crate::twins::cache::CacheRound;

/// The variant of a ranking.
pub fn variant(shape: RankShape) -> Variant {
    shape.variant("tally")
}

/// Adds to counts that choose has left at 0.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    cache: &CacheRound,
) {
    let mut dispatch = recorder
        .compute(pipeline)
        .read("slot_owner", &buffers.slot_owner)
        .read("wished", &buffers.wished)
        .update("wishes_of_rank", &buffers.wishes_of_rank)
        .update("live_of_rank", &buffers.live_of_rank)
        .update("tallies", &buffers.tallies);
    if binds(pipeline, "slot_used") {
        dispatch = dispatch.read("slot_used", &buffers.slot_used);
    }
    let dispatch = buffers.read_weights(buffers.bind_ranking(dispatch, pipeline), pipeline);
    dispatch.push(cache).threads([cache.chunks(), 1, 1]);
}
