//! What rays read of macrocells; twin of `shaders/common/macrocells.glsl`.

use crate::twins::limits::BLOCK_SAMPLES;
use crate::volume::{MACROCELL_CELLS, Macrocells};

/// From this code on something shows; below, nothing is seen in macrocells less than the code away.
pub const CODE_SHOWS: u8 = 128;
/// The longest step, above [`CODE_SHOWS`].
pub const CODE_STEP_MAX: u8 = 127;
/// Codes by which a step doubles.
pub const CODES_OF_OCTAVE: u32 = 8;
/// The farthest distance that codes say.
pub const REACH_MAX: u8 = 16;
/// Octaves of step for each unit of optical depth in front: half of what it hides.
pub const OCTAVES_OF_DEPTH: f32 = 0.721_347_5;

/// The code of the macrocell around the cell whose lower corner is the texel `corner` (apron included).
pub fn code_at(codes: &Macrocells<u8>, corner: [i32; 3]) -> u8 {
    let size = codes.size.to_array();
    let at: [u32; 3] = std::array::from_fn(|a| {
        (corner[a] / MACROCELL_CELLS as i32).clamp(0, size[a] as i32 - 1) as u32
    });
    codes.of[codes.size.index(at[0], at[1], at[2])]
}

/// By how many octaves a step may be longer than the finest, by a code and the optical depth in front.
pub fn octaves(code: u8, depth: f32) -> u32 {
    let eighths = f32::from(code - CODE_SHOWS) + depth * (OCTAVES_OF_DEPTH * CODES_OF_OCTAVE as f32);
    (eighths as u32 / CODES_OF_OCTAVE).min(OCTAVES_MAX)
}

/// A step as long as a block.
pub const OCTAVES_MAX: u32 = BLOCK_SAMPLES.trailing_zeros();
