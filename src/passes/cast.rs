//! The whole way of every ray of a tile in one dispatch, from pixel to picture.

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};
use crate::passes::march_shape::{SceneResources, Shape};
use crate::twins::cast::Push;

/// The variant of a shape for a number of views.
pub fn variant(shape: &Shape, views: usize) -> Variant {
    shape.variant("cast").define("VIEWS", views)
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[view]` rays of each view, linear in the pixel.
    pub views: &'r Buffer,
    /// `[pixel]` linear rgb over the background, and alpha.
    pub picture: &'r Buffer,
    /// Samples taken: low and high word.
    pub counters: &'r Buffer,
    /// Transfer functions and voxels.
    pub scene: SceneResources<'r>,
}

/// Draws the tile and adds its samples to the counters.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    let [width, height] = push.rays.tile_size_pixel;
    let dispatch = recorder
        .compute(pipeline)
        .uniform("views", resources.views)
        .write("picture", resources.picture)
        .update("counters", resources.counters);
    let dispatch = resources.scene.bind(dispatch, pipeline);
    dispatch.push_front(push).threads([width, height, 1]);
    recorder.host_read(resources.picture);
    recorder.host_read(resources.counters);
}
