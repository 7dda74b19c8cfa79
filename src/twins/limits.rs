//! Numbers that host and shaders share; a test reads both this file and `shaders/common/limits.glsl`.

/// Samples between two anchors of a ray.
pub const BLOCK_SAMPLES: u32 = 32;
/// Rays of one workgroup along x.
pub const GROUP_WIDTH: u32 = 8;
/// Rays of one workgroup along y.
pub const GROUP_HEIGHT: u32 = 8;
/// Optical depth taken for opaque: exp(-87) is the smallest that f32 holds as a normal number.
pub const OPAQUE_DEPTH: f32 = 87.0;
