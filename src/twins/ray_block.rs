//! Where a ray stands between two samples of a block; mirrors `shaders/common/ray_block.glsl`.

use bytemuck::{Pod, Zeroable};

/// The block of samples that a ray is in.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct RayBlock {
    /// Of the block so far, as if nothing stood before it.
    pub color: [f32; 3],
    /// Optical, of the block so far.
    pub depth: f32,
    /// Through the block so far.
    pub transmitted: f32,
    /// In the block.
    pub sample_index: u32,
    /// In use.
    pub level: u32,
    /// [`MET_PENDING`], [`MET_FAILED`], [`MET_ABSENT`]; from [`MET_CHANNELS_SHIFT`] on channels whose
    /// bricks the ray waits for.
    pub met: u32,
}

/// The ray took a coarser level for a brick that is not there.
pub const MET_PENDING: u32 = 1;
/// The ray went through a brick that could not be read.
pub const MET_FAILED: u32 = 2;
/// The ray went through a brick that the source does not have.
pub const MET_ABSENT: u32 = 4;
/// All of these.
pub const MET_STATES: u32 = 7;
/// From this bit on: channels whose bricks a ray waits for, where that is not all of them.
pub const MET_CHANNELS_SHIFT: u32 = 3;

impl RayBlock {
    /// Nothing marched yet.
    pub const fn fresh(level: u32) -> RayBlock {
        RayBlock { color: [0.0; 3], depth: 0.0, transmitted: 1.0, sample_index: 0, level, met: 0 }
    }
}

/// Half of the colour and half of the state's, the graver one where there are several.
pub fn tinted(color: [f32; 4], met: u32, waits: bool) -> [f32; 4] {
    let tint = if met & MET_FAILED != 0 {
        [0.8, 0.22, 0.0]
    } else if waits || met & MET_PENDING != 0 {
        [0.0, 0.17, 0.45]
    } else if met & MET_STATES != 0 {
        [0.5; 3]
    } else {
        return color;
    };
    let [r, g, b] = std::array::from_fn(|part| color[part] * 0.5 + tint[part] * 0.5);
    [r, g, b, color[3].max(0.5)]
}
