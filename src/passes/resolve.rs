//! From ray states to the picture, over the background.

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Buffer, ComputePipeline, Recorder, Variant};

/// The only variant.
pub fn variant() -> Variant {
    Variant::plain("resolve")
}

/// The variant that tints rays by what they met.
pub fn states_variant() -> Variant {
    variant().define("SHOW_STATES", 1)
}

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// Linear colour behind everything.
    pub background: [f32; 3],
    /// Nothing.
    pub unused_0: u32,
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[ray]` where each ray ended.
    pub ray_state: &'r Buffer,
    /// `[pixel]` linear rgb over the background, and alpha.
    pub picture: &'r Buffer,
    /// Samples taken: low and high word.
    pub counters: &'r Buffer,
    /// What rays met and where they wait; SHOW_STATES alone.
    pub states: Option<(&'r Buffer, &'r Buffer)>,
}

/// Writes every pixel of the tile and adds its samples to the counters.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    let [width, height] = push.tile_size_pixel;
    let mut dispatch = recorder
        .compute(pipeline)
        .read("ray_state", resources.ray_state)
        .write("picture", resources.picture)
        .update("counters", resources.counters);
    if let Some((ray_block, ray_place)) = resources.states {
        dispatch = dispatch.read("ray_block", ray_block).read("ray_place", ray_place);
    }
    dispatch.push(push).threads([width, height, 1]);
    recorder.host_read(resources.picture);
    recorder.host_read(resources.counters);
}
