//! Begins a round: what arrived becomes visible.

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::CacheBuffers;
use crate::twins::publish::Push;

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("publish")
}

/// Applies `push.update_count` updates and sets this round's counts to their start.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    buffers: &'r CacheBuffers,
    updates: &'r Buffer,
    push: &Push,
) {
    recorder
        .compute(pipeline)
        .read("updates", updates)
        .write("progress", &buffers.progress)
        .update("page_table", &buffers.page_table)
        .update("slot_owner", &buffers.slot_owner)
        .push(push)
        .threads([push.update_count.max(1), 1, 1]);
}
