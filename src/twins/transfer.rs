//! Colour and extinction of a windowed value; mirrors `shaders/common/transfer.glsl`.

use bytemuck::{Pod, Zeroable};

/// A linear piece of a channel's transfer function, from `begins_at` to where the next one begins.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct TransferSegment {
    /// Linear rgb and extinction (per world unit) at `begins_at`.
    pub start: [f32; 4],
    /// Their change per unit of windowed value.
    pub slope: [f32; 4],
    /// Windowed value, 0 to 1.
    pub begins_at: f32,
    /// Windowed value = texel * window_scale + window_offset; the same in every segment of a channel.
    pub window_scale: f32,
    /// See `window_scale`.
    pub window_offset: f32,
    /// Nothing.
    pub unused_0: f32,
}

/// rgb and extinction of a texel, by the last segment that begins at or before its windowed value.
pub fn classify(segments: &[TransferSegment], texel: f32) -> [f32; 4] {
    let first = &segments[0];
    let windowed = (texel * first.window_scale + first.window_offset).clamp(0.0, 1.0);
    let mut later = segments[1..].iter().filter(|segment| windowed >= segment.begins_at);
    let segment = later.next_back().unwrap_or(first);
    let mut result: [f32; 4] = std::array::from_fn(|part| {
        segment.start[part] + segment.slope[part] * (windowed - segment.begins_at)
    });
    result[3] = result[3].max(0.0);
    result
}
