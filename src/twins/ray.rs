//! What passes keep of one ray; mirrors `shaders/common/ray.glsl`.

use bytemuck::{Pod, Zeroable};

/// Where a ray samples: sample i lies at start + i * delta, in voxel coordinates whose integers are
/// voxel centres, in fixed point.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayGeometry {
    /// Integer part of the first sample's position.
    pub start_cell: [i32; 3],
    /// How many samples; 0: the ray misses the volume.
    pub sample_count: u32,
    /// Fraction of the first sample's position, in units of 2^-32.
    pub start_fraction: [u32; 3],
    /// Distance of two samples, world units.
    pub step_world: f32,
    /// Integer part of the step between samples.
    pub delta_cell: [i32; 3],
    /// Nothing.
    pub unused_0: u32,
    /// Fraction of the step, in units of 2^-32.
    pub delta_fraction: [u32; 3],
    /// Nothing.
    pub unused_1: u32,
}

/// How far a ray has come.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RayState {
    /// Linear, premultiplied.
    pub color: [f32; 3],
    /// Along the ray so far.
    pub optical_depth: f32,
    /// The sample to take next; equals the count when the ray has ended.
    pub next_sample: u32,
    /// Samples taken so far.
    pub samples_taken: u32,
    /// What `optical_depth` lost to rounding.
    pub optical_depth_rest: f32,
    /// Nothing.
    pub unused_0: u32,
}
