//! From ray states to the picture; twin of `shaders/resolve.comp`.

use crate::twins::limits::PLACE_ENDED;
use crate::twins::march_bricks::Rays;
use crate::twins::ray::RayState;
use crate::twins::ray_block::{RayBlock, tinted};
use crate::twins::ray_resolve::resolve_ray;

/// The same where rays are tinted by what they met; a ray waits as long as it has not ended.
pub fn resolve_states(rays: &Rays, background: [f32; 3]) -> Vec<[f32; 4]> {
    let (pixels, _) = resolve(&rays.states, background);
    let met = rays.blocks.iter().zip(&rays.places);
    let tint = |(color, (block, place)): ([f32; 4], (&RayBlock, &u32))| {
        tinted(color, block.met, *place != PLACE_ENDED)
    };
    pixels.into_iter().zip(met).map(tint).collect()
}

/// Pixels (linear rgb over the background, alpha) and how many samples were taken in all.
pub fn resolve(states: &[RayState], background: [f32; 3]) -> (Vec<[f32; 4]>, u64) {
    let samples = states.iter().map(|state| u64::from(state.samples_taken)).sum();
    (states.iter().map(|state| resolve_ray(state, background)).collect(), samples)
}
