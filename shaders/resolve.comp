// resolve.comp: from ray states to the picture, over the background.
//
// reads    ray_state  [ray]
//          ray_block  [ray]      what the ray met; SHOW_STATES alone
//          ray_place  [ray]      whether it waits; SHOW_STATES alone
// writes   picture    [pixel]    linear rgb over the background, and alpha
// updates  counters   [counter]  samples taken: low and high word
// shape    one thread per ray of the tile, 8 x 8 x 1
// variants SHOW_STATES: rays that met a pending, failed or absent brick are tinted
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

#ifdef SHOW_STATES
#include "common/ray_block.glsl"
layout(std430) readonly buffer ray_block { RayBlock block_of_ray[]; };
layout(std430) readonly buffer ray_place { uint place_of_ray[]; };
#endif

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
    vec4 pixel_color = resolve_ray(state, push.background);
#ifdef SHOW_STATES
    pixel_color = tinted(pixel_color, block_of_ray[ray].met, place_of_ray[ray] != PLACE_ENDED);
#endif
    pixels[ray] = pixel_color;
    // No sum over the workgroup first: where the CPU computes, a barrier costs more than it saves.
    uint before = atomicAdd(samples_low, state.samples_taken);
    if (before + state.samples_taken < before) {
        atomicAdd(samples_high, 1u);
    }
}
