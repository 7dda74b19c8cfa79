//! From what each chunk adds to where each chunk begins.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::CacheBuffers;
use crate::twins::cache::CacheRound;

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("scan")
}

/// Sums in place.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    cache: &CacheRound,
) {
    recorder
        .compute(pipeline)
        .update("chunk_counts", &buffers.chunk_counts)
        .update("answers", &buffers.answers)
        .push(cache)
        .threads([1, 1, 1]);
}
