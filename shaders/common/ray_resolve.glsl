// ray_resolve.glsl: a ray's colour over the background. twin: src/twins/ray_resolve.rs
#include "common/exponential.glsl"

// Linear rgb over the background, and alpha.
vec4 resolve_ray(RayState state, vec3 background) {
    Attenuation attenuation = attenuate(state.optical_depth);
    return vec4(state.color + attenuation.transmitted * background, attenuation.absorbed);
}
