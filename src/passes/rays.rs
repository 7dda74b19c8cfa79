//! One ray per pixel of a tile: where it enters the volume, how it steps, how often.

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};
use crate::passes::cache_buffers::CacheBuffers;
use crate::passes::march_bricks::RayBuffers;
use crate::twins::rays::{BrickPush, Push};

/// The variant for a number of views.
pub fn variant(views: usize) -> Variant {
    Variant::plain("rays").define("VIEWS", views)
}

/// The variant that sets up rays for march_bricks.
pub fn brick_variant(views: usize, levels: u32) -> Variant {
    variant(views).define("BRICKS", 1).define("LEVELS", levels)
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

/// Sets up the rays of a tile for march_bricks, in one level; earlier contents of all ray buffers are lost.
pub fn record_for_bricks<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    views: &'r Buffer,
    cache: &'r CacheBuffers,
    rays: &'r RayBuffers,
    push: &BrickPush,
) {
    let [width, height] = push.tile_size_pixel;
    recorder
        .compute(pipeline)
        .uniform("views", views)
        .uniform("levels", &cache.levels)
        .write("ray_geometry", &rays.ray_geometry)
        .write("ray_state", &rays.ray_state)
        .write("ray_block", &rays.ray_block)
        .write("ray_place", &rays.ray_place)
        .push(push)
        .threads([width, height, 1]);
}
