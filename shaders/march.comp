// march.comp: moves every ray of a tile on by a bounded number of samples, until it ends.
//
// reads    ray_geometry  [ray]      fixed-point start and step
//          transfer      [segment]  transfer functions of all channels, one after another
//          channels      [image]    voxels with an apron of one on every side; absent when every channel is constant
//          macrocells    [image]    what macrocells show; MACROCELLS alone
// updates  ray_state     [ray]      position, optical depth, colour
// shape    one thread per ray of the tile, 8 x 8 x 1
// spaces   as common/ray_march.glsl
// variants as common/ray_march.glsl
// twin     src/twins/march.rs
// source   DESIGN section 5: a dispatch does a bounded number of steps and resumes from the ray state
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_march.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std430) readonly buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) buffer ray_state { RayState state_of_ray[]; };

layout(push_constant) uniform Push {
    uvec2 tile_size_pixel;
    uint blocks_max;      // blocks of samples in this dispatch
#ifdef EARLY_STOP
    float early_stop;     // a ray ends when less than this is transmitted
#endif
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile_size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile_size_pixel.x + pixel.x;
    RayGeometry geometry = geometry_of_ray[ray];
    RayState state = state_of_ray[ray];
    if (state.next_sample >= geometry.sample_count) {
        return;
    }
#ifdef EARLY_STOP
    march_ray(geometry, state, push.blocks_max, push.early_stop);
#else
    march_ray(geometry, state, push.blocks_max, 0.0);
#endif
    state_of_ray[ray] = state;
}
