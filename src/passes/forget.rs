//! Forgets what stands in the entries of one channel of an atlas.

use crate::gpu::{ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::CacheBuffers;
use crate::twins::forget::Push;

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("forget")
}

/// Unmaps the channel's bricks, all of them or those that have no slot.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    push: &Push,
) {
    recorder
        .compute(pipeline)
        .update("page_table", &buffers.page_table)
        .update("slot_owner", &buffers.slot_owner)
        .write("slot_used", &buffers.slot_used)
        .push(push)
        .threads([push.places.max(push.slot_count), 1, 1]);
}
