// rays.comp: one ray per pixel of a tile: where it enters the volume, how it steps, how often.
//
// reads    views         [view]   the view's rays, linear in the pixel, f64
// writes   ray_geometry  [ray]    fixed-point start and step
//          ray_state     [ray]    nothing marched yet
// shape    one thread per pixel of the tile, 8 x 8 x 1
// spaces   views in voxels (corner origin) and world; ray_geometry in voxels (centre origin)
// twin     src/twins/rays.rs
// source   DESIGN: positions are integer voxel plus fraction, made from the camera in f64
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/ray.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

// w is unused in each.
struct ViewRays {
    dvec4 origin_voxel;
    dvec4 origin_column_voxel;
    dvec4 origin_row_voxel;
    dvec4 direction_voxel;
    dvec4 direction_column_voxel;
    dvec4 direction_row_voxel;
    dvec4 direction_world;
    dvec4 direction_column_world;
    dvec4 direction_row_world;
};

layout(std430) readonly buffer views { ViewRays view_rays[]; };
layout(std430) writeonly buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) writeonly buffer ray_state { RayState state_of_ray[]; };

layout(push_constant) uniform Push {
    TileShape tile;
    uvec3 volume_size;
    uint view;
    double step_world;  // greatest distance of two samples
} push;

// Splits into cell and fraction, to the nearest 2^-32.
void to_fixed(double value, out int cell, out uint fraction) {
    double scaled = floor(value * 4294967296.0LF + 0.5LF);
    double whole = floor(scaled * 2.3283064365386962890625e-10LF);
    cell = int(whole);
    fraction = uint(scaled - whole * 4294967296.0LF);
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile.size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile.size_pixel.x + pixel.x;
    ViewRays rays = view_rays[push.view];
    dvec2 at = dvec2(push.tile.origin_pixel + pixel) + 0.5LF;
    dvec3 origin = rays.origin_voxel.xyz + rays.origin_column_voxel.xyz * at.x
        + rays.origin_row_voxel.xyz * at.y;
    dvec3 direction = rays.direction_voxel.xyz + rays.direction_column_voxel.xyz * at.x
        + rays.direction_row_voxel.xyz * at.y;
    dvec3 direction_world = rays.direction_world.xyz + rays.direction_column_world.xyz * at.x
        + rays.direction_row_world.xyz * at.y;

    // The part of the ray, in multiples of its direction, inside the volume's box.
    double enter = 0.0LF;
    double leave = 1.0e300LF;
    for (int axis = 0; axis < 3; ++axis) {
        double extent = double(push.volume_size[axis]);
        if (direction[axis] == 0.0LF) {
            if (origin[axis] < 0.0LF || origin[axis] > extent) {
                leave = -1.0LF;
            }
        } else {
            double to_near = -origin[axis] / direction[axis];
            double to_far = (extent - origin[axis]) / direction[axis];
            enter = max(enter, min(to_near, to_far));
            leave = min(leave, max(to_near, to_far));
        }
    }

    RayGeometry geometry;
    geometry.start_cell = ivec3(0);
    geometry.sample_count = 0u;
    geometry.start_fraction = uvec3(0u);
    geometry.step_world = 0.0;
    geometry.delta_cell = ivec3(0);
    geometry.unused_0 = 0u;
    geometry.delta_fraction = uvec3(0u);
    geometry.unused_1 = 0u;
    if (leave > enter) {
        // Equal steps, at most the one asked for, that fill the way through the box exactly.
        double length_world = (leave - enter) * sqrt(dot(direction_world, direction_world));
        double count = max(ceil(length_world / push.step_world), 1.0LF);
        double step_ray = (leave - enter) / count;
        dvec3 start = origin + (enter + 0.5LF * step_ray) * direction - 0.5LF;
        dvec3 delta = step_ray * direction;
        for (int axis = 0; axis < 3; ++axis) {
            to_fixed(start[axis], geometry.start_cell[axis], geometry.start_fraction[axis]);
            to_fixed(delta[axis], geometry.delta_cell[axis], geometry.delta_fraction[axis]);
        }
        geometry.sample_count = uint(count);
        geometry.step_world = float(length_world / count);
    }
    geometry_of_ray[ray] = geometry;
    state_of_ray[ray] = RayState(vec3(0.0), 0.0, 0u, 0u, 0.0, 0u);
}
