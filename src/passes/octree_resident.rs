//! Which levels are resident around each brick, after some came or went.

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};
use crate::twins::octree_resident::Push;

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("octree_resident")
}

/// What the pass works on.
pub struct Resources<'r> {
    /// `[level]` bricks of each level.
    pub places_of_levels: &'r Buffer,
    /// `[change]` bricks that came or went.
    pub changes: &'r Buffer,
    /// `[word]` a bit per level, for each place of each channel.
    pub resident: &'r Buffer,
}

/// Tells all places around the changes.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    recorder
        .compute(pipeline)
        .read("places_of_levels", resources.places_of_levels)
        .read("changes", resources.changes)
        .update("resident", resources.resident)
        .push(push)
        .threads([1, 1, 1]);
}
