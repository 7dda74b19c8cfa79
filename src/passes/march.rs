//! Moves every ray of a tile on by a bounded number of samples, until it ends.

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Buffer, ComputePipeline, Recorder};
use crate::passes::march_shape::SceneResources;

/// The shader's push constants; without EARLY_STOP the last one is not there.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
    /// Blocks of samples in this dispatch.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted.
    pub early_stop: f32,
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[ray]` fixed-point start and step.
    pub ray_geometry: &'r Buffer,
    /// `[ray]` position, optical depth, colour.
    pub ray_state: &'r Buffer,
    /// Transfer functions and voxels.
    pub scene: SceneResources<'r>,
}

/// Rays that have ended stay as they are; the others go on from where they were.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    let [width, height] = push.tile_size_pixel;
    let dispatch = recorder
        .compute(pipeline)
        .read("ray_geometry", resources.ray_geometry)
        .update("ray_state", resources.ray_state);
    let dispatch = resources.scene.bind(dispatch, pipeline);
    dispatch.push_front(push).threads([width, height, 1]);
}
