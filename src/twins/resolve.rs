//! From ray states to the picture; twin of `shaders/resolve.comp`.

use crate::twins::exponential::attenuate;
use crate::twins::ray::RayState;

/// Pixels (linear rgb over the background, alpha) and how many samples were taken in all.
pub fn resolve(states: &[RayState], background: [f32; 3]) -> (Vec<[f32; 4]>, u64) {
    let pixel = |state: &RayState| {
        let attenuation = attenuate(state.optical_depth);
        let [r, g, b]: [f32; 3] = std::array::from_fn(|part| {
            state.color[part] + attenuation.transmitted * background[part]
        });
        [r, g, b, attenuation.absorbed]
    };
    let samples = states.iter().map(|state| u64::from(state.samples_taken)).sum();
    (states.iter().map(pixel).collect(), samples)
}
