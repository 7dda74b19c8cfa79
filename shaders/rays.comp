// rays.comp: one ray per pixel of a tile: where it enters the volume, how it steps, how often.
//
// reads    views         [view]   the view's rays, linear in the pixel, f64
// writes   ray_geometry  [ray]    fixed-point start and step
//          ray_state     [ray]    nothing marched yet
// shape    one thread per pixel of the tile, 8 x 8 x 1
// spaces   views in voxels (corner origin) and world; ray_geometry in voxels (centre origin)
// variants VIEWS: how many views there are
// twin     src/twins/rays.rs
// source   DESIGN: positions are integer voxel plus fraction, made from the camera in f64
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_setup.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std140) uniform views { ViewRays view_rays[VIEWS]; };
layout(std430) writeonly buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) writeonly buffer ray_state { RayState state_of_ray[]; };

layout(push_constant) uniform Push {
    TileShape tile;
    uvec3 volume_size;
    uint view;
    double step_world;  // greatest distance of two samples
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile.size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile.size_pixel.x + pixel.x;
    geometry_of_ray[ray] = set_up_ray(
        view_rays[push.view], push.tile.origin_pixel + pixel, push.volume_size, push.step_world);
    state_of_ray[ray] = fresh_ray();
}
