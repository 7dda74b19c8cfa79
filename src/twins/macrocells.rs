//! What rays read of macrocells; twin of `shaders/common/macrocells.glsl`.

use crate::volume::{MACROCELL_CELLS, Macrocells};

/// From this code on something shows; below, nothing is seen in macrocells less than the code away.
pub const CODE_SHOWS: u8 = 128;
/// The longest step, above [`CODE_SHOWS`].
pub const CODE_STEP_MAX: u8 = 127;
/// Codes by which a step doubles.
pub const CODES_OF_LEVEL: u32 = 8;
/// The level of steps that are a whole interval long; above it, intervals are joined.
pub const LEVEL_WHOLE: u32 = 5;
/// The level of the longest steps.
pub const LEVEL_MAX: u32 = 7;
/// The farthest distance that codes say.
pub const REACH_MAX: u8 = 16;
/// Levels of step for each unit of optical depth in front: half of what it hides.
pub const LEVELS_OF_DEPTH: f32 = 0.721_347_5;

/// The code of the macrocell around the cell whose lower corner is the texel `corner` (apron included).
pub fn code_at(codes: &Macrocells<u8>, corner: [i32; 3]) -> u8 {
    let size = codes.size.to_array();
    let at: [u32; 3] = std::array::from_fn(|a| {
        (corner[a] / MACROCELL_CELLS as i32).clamp(0, size[a] as i32 - 1) as u32
    });
    codes.of[codes.size.index(at[0], at[1], at[2])]
}

/// The level of steps that a code allows behind an optical depth.
pub fn level_of(code: u8, depth: f32) -> u32 {
    let level = f32::from(code - CODE_SHOWS) / CODES_OF_LEVEL as f32 + depth * LEVELS_OF_DEPTH;
    level.min(LEVEL_MAX as f32) as u32
}

/// Length of steps of a level, in intervals.
pub fn length_of(level: u32) -> f32 {
    f32::from_bits((level + 127 - LEVEL_WHOLE) << 23)
}
