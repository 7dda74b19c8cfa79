// rays.comp: one ray per pixel of a tile: where it enters the volume, how it steps, how often.
//
// reads    views         [view]   the view's rays, linear in the pixel, f64
//          levels        [level]  grid and ray parameters of every level in the view; BRICKS alone
// writes   ray_geometry  [ray]    fixed-point start and step
//          ray_state     [ray]    nothing marched yet
//          ray_block     [ray]    the same; BRICKS alone
//          ray_place     [ray]    on its way; BRICKS alone
// shape    one thread per pixel of the tile, 8 x 8 x 1
// spaces   views in voxels (corner origin) and world; ray_geometry in voxels (centre origin)
// variants VIEWS: how many views there are; BRICKS: for march_bricks, in the finest level that the view
//          uses; LEVELS
// twin     src/twins/rays.rs
// source   DESIGN: positions are integer voxel plus fraction, made from the camera in f64
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_setup.glsl"
#ifdef BRICKS
#include "common/ray_block.glsl"
#include "common/ranks.glsl"
#endif

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std140) uniform views { ViewRays view_rays[VIEWS]; };
layout(std430) writeonly buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) writeonly buffer ray_state { RayState state_of_ray[]; };

#ifdef BRICKS
layout(std430) writeonly buffer ray_block { RayBlock block_of_ray[]; };
layout(std430) writeonly buffer ray_place { uint place_of_ray[]; };
#endif

layout(push_constant) uniform Push {
    TileShape tile;
    uvec3 volume_size;
    uint view;
    double step_world;  // greatest distance of two samples
#ifdef BRICKS
    uint level;         // finest in use; its own step holds
    uint unused_0;
#endif
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile.size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile.size_pixel.x + pixel.x;
#ifdef BRICKS
    LevelView in_level = level_views[push.level];
    geometry_of_ray[ray] = set_up_ray_within(
        view_rays[push.view], push.tile.origin_pixel + pixel, push.volume_size,
        in_level.per_scale_step.w, in_level.depth, in_level.per_scale_step.xyz);
    block_of_ray[ray] = fresh_block(push.level);
    place_of_ray[ray] = PLACE_RUNNING;
#else
    geometry_of_ray[ray] = set_up_ray(
        view_rays[push.view], push.tile.origin_pixel + pixel, push.volume_size, push.step_world);
#endif
    state_of_ray[ray] = fresh_ray();
}
