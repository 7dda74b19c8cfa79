//! One ray per pixel of a tile: where it enters the volume, how it steps, how often.

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};
use crate::twins::rays::Push;

/// The variant for a number of views.
pub fn variant(views: usize) -> Variant {
    Variant::plain("rays").define("VIEWS", views)
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[view]` rays of each view, linear in the pixel.
    pub views: &'r Buffer,
    /// `[ray]` fixed-point start and step.
    pub ray_geometry: &'r Buffer,
    /// `[ray]` nothing marched yet.
    pub ray_state: &'r Buffer,
}

/// Sets up the rays of a tile; earlier contents of both ray buffers are lost.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    let [width, height] = push.tile_size_pixel;
    recorder
        .compute(pipeline)
        .uniform("views", resources.views)
        .write("ray_geometry", resources.ray_geometry)
        .write("ray_state", resources.ray_state)
        .push(push)
        .threads([width, height, 1]);
}
