//! How many slots of an atlas are granted, and up to which ranks.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::CacheBuffers;
use crate::twins::cache::CacheRound;

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("choose")
}

/// Uses up what tally counted.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    cache: &CacheRound,
) {
    recorder
        .compute(pipeline)
        .update("wishes_of_rank", &buffers.wishes_of_rank)
        .update("live_of_rank", &buffers.live_of_rank)
        .update("tallies", &buffers.tallies)
        .write("choice", &buffers.choice)
        .write("answers", &buffers.answers)
        .push(cache)
        .threads([1, 1, 1]);
}
