//! A ray's colour over the background; twin of `shaders/common/ray_resolve.glsl`.

use crate::twins::exponential::attenuate;
use crate::twins::ray::RayState;

/// Linear rgb over the background, and alpha.
pub fn resolve_ray(state: &RayState, background: [f32; 3]) -> [f32; 4] {
    let attenuation = attenuate(state.optical_depth);
    let [r, g, b]: [f32; 3] =
        std::array::from_fn(|part| state.color[part] + attenuation.transmitted * background[part]);
    [r, g, b, attenuation.absorbed]
}
