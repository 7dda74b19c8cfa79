// resolve.comp: from ray states to the picture, over the background.
//
// reads    ray_state  [ray]
// writes   picture    [pixel]    linear rgb over the background, and alpha
// updates  counters   [counter]  samples taken: low and high word
// shape    one thread per ray of the tile, 8 x 8 x 1
// twin     src/twins/resolve.rs
// source   DESIGN section 4: C + T(end) * background, alpha = 1 - T(end)
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_resolve.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std430) readonly buffer ray_state { RayState state_of_ray[]; };
layout(std430) writeonly buffer picture { vec4 pixels[]; };
layout(std430) buffer counters { uint samples_low; uint samples_high; };

layout(push_constant) uniform Push {
    vec3 background;
    uint unused_0;
    uvec2 tile_size_pixel;
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile_size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile_size_pixel.x + pixel.x;
    RayState state = state_of_ray[ray];
    pixels[ray] = resolve_ray(state, push.background);
    // No sum over the workgroup first: where the CPU computes, a barrier costs more than it saves.
    uint before = atomicAdd(samples_low, state.samples_taken);
    if (before + state.samples_taken < before) {
        atomicAdd(samples_high, 1u);
    }
}
