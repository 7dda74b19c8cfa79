// cast.comp: the whole way of every ray of a tile in one dispatch, from pixel to picture. For scenes
// whose longest ray fits one dispatch: no ray state is kept. The same arithmetic as rays, march and
// resolve one after another.
//
// reads    views       [view]     the view's rays, linear in the pixel, f64
//          transfer    [segment]  transfer functions of all channels, one after another
//          channels    [image]    voxels with an apron of one on every side; absent when every channel is constant
//          macrocells  [image]    what macrocells show; MACROCELLS alone
// writes   picture     [pixel]    linear rgb over the background, and alpha
// updates  counters    [counter]  samples taken: low and high word
// shape    one thread per pixel of the tile, 8 x 8 x 1
// spaces   as common/ray_setup.glsl and common/ray_march.glsl
// variants VIEWS: how many views there are; as common/ray_march.glsl
// twin     src/twins/cast.rs
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_setup.glsl"
#include "common/ray_march.glsl"
#include "common/ray_resolve.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std140) uniform views { ViewRays view_rays[VIEWS]; };
layout(std430) writeonly buffer picture { vec4 pixels[]; };
layout(std430) buffer counters { uint samples_low; uint samples_high; };

layout(push_constant) uniform Push {
    TileShape tile;
    uvec3 volume_size;
    uint view;
    double step_world;  // greatest distance of two samples
    uint blocks_max;    // blocks of samples of the longest ray
    float early_stop;   // a ray ends when less than this is transmitted
    vec3 background;
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile.size_pixel))) {
        return;
    }
    RayGeometry geometry = set_up_ray(
        view_rays[push.view], push.tile.origin_pixel + pixel, push.volume_size, push.step_world);
    RayState state = fresh_ray();
    march_ray(geometry, state, push.blocks_max, push.early_stop);
    pixels[pixel.y * push.tile.size_pixel.x + pixel.x] = resolve_ray(state, push.background);
    // No sum over the workgroup first: where the CPU computes, a barrier costs more than it saves.
    uint before = atomicAdd(samples_low, state.samples_taken);
    if (before + state.samples_taken < before) {
        atomicAdd(samples_high, 1u);
    }
}
