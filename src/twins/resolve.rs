//! From ray states to the picture; twin of `shaders/resolve.comp`.

use crate::twins::ray::RayState;
use crate::twins::ray_resolve::resolve_ray;

/// Pixels (linear rgb over the background, alpha) and how many samples were taken in all.
pub fn resolve(states: &[RayState], background: [f32; 3]) -> (Vec<[f32; 4]>, u64) {
    let samples = states.iter().map(|state| u64::from(state.samples_taken)).sum();
    (states.iter().map(|state| resolve_ray(state, background)).collect(), samples)
}
