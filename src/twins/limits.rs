//! Numbers that host and shaders share; a test reads both this file and `shaders/common/limits.glsl`.

/// Samples between two anchors of a ray.
pub const BLOCK_SAMPLES: u32 = 32;
/// Rays of one workgroup along x.
pub const GROUP_WIDTH: u32 = 8;
/// Rays of one workgroup along y.
pub const GROUP_HEIGHT: u32 = 8;
/// Optical depth of one sample, at most.
pub const DEPTH_OF_SAMPLE_MAX: f32 = 1.0e6;
