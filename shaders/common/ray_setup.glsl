// ray_setup.glsl: the ray of a pixel: where it enters the volume, how it steps, how often.
// twin: src/twins/ray_setup.rs

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

// Adding it leaves the nearest integer in the low bits of an f64: conversions of f64 are slow on
// every device. `precise` keeps optimizers from cancelling it.
const double ROUNDER = 6755399441055744.0LF;  // 1.5 * 2^52
const double TWO_POW_32 = 4294967296.0LF;

// Splits into cell and fraction, to the nearest 2^-32.
void to_fixed(double value, out int cell, out uint fraction) {
    precise double rounded = value + ROUNDER;
    precise double rest = (value - (rounded - ROUNDER)) * TWO_POW_32 + ROUNDER;
    cell = int(unpackDouble2x32(rounded).x) - (rest < ROUNDER ? 1 : 0);
    fraction = unpackDouble2x32(rest).x;
}

// The part of the ray between two of its parameters (multiples of its direction), in voxels each of
// which spans 1 / per_scale level-0 voxels along each axis.
RayGeometry set_up_ray_within(
    ViewRays rays, uvec2 pixel_of_view, uvec3 volume_size, double step_world, dvec2 depth, dvec3 per_scale
) {
    dvec2 at = dvec2(pixel_of_view) + 0.5LF;
    dvec3 origin = rays.origin_voxel.xyz + rays.origin_column_voxel.xyz * at.x
        + rays.origin_row_voxel.xyz * at.y;
    dvec3 direction = rays.direction_voxel.xyz + rays.direction_column_voxel.xyz * at.x
        + rays.direction_row_voxel.xyz * at.y;
    dvec3 direction_world = rays.direction_world.xyz + rays.direction_column_world.xyz * at.x
        + rays.direction_row_world.xyz * at.y;

    // The part of the ray, in multiples of its direction, inside the volume's box. Along an axis on
    // which the ray does not move, it is inside from the start or never: not within the upper face, since
    // voxels are half open.
    dvec3 extent = dvec3(volume_size);
    bvec3 still = equal(direction, dvec3(0.0LF));
    bvec3 outside = bvec3(
        origin.x < 0.0LF || origin.x >= extent.x,
        origin.y < 0.0LF || origin.y >= extent.y,
        origin.z < 0.0LF || origin.z >= extent.z
    );
    dvec3 per_direction = 1.0LF / mix(direction, dvec3(1.0LF), still);
    dvec3 to_near = mix(-origin * per_direction, dvec3(0.0LF), still);
    dvec3 to_far = mix((extent - origin) * per_direction, dvec3(1.0e300LF), still);
    dvec3 first = min(to_near, to_far);
    dvec3 last = max(to_near, to_far);
    bvec3 never = bvec3(still.x && outside.x, still.y && outside.y, still.z && outside.z);
    double enter = max(max(first.x, first.y), max(first.z, depth.x));
    double leave = any(never) ? -1.0LF : min(min(last.x, last.y), min(last.z, depth.y));

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
        double steps = length_world / step_world;
        precise double whole = (steps + ROUNDER) - ROUNDER;
        double count = max(whole < steps ? whole + 1.0LF : whole, 1.0LF);
        double step_ray = (leave - enter) / count;
        dvec3 start = (origin + (enter + 0.5LF * step_ray) * direction) * per_scale - 0.5LF;
        dvec3 delta = step_ray * direction * per_scale;
        to_fixed(start.x, geometry.start_cell.x, geometry.start_fraction.x);
        to_fixed(start.y, geometry.start_cell.y, geometry.start_fraction.y);
        to_fixed(start.z, geometry.start_cell.z, geometry.start_fraction.z);
        to_fixed(delta.x, geometry.delta_cell.x, geometry.delta_fraction.x);
        to_fixed(delta.y, geometry.delta_cell.y, geometry.delta_fraction.y);
        to_fixed(delta.z, geometry.delta_cell.z, geometry.delta_fraction.z);
        geometry.sample_count = unpackDouble2x32(count + ROUNDER).x;
        geometry.step_world = float(length_world / count);
    }
    return geometry;
}

RayGeometry set_up_ray(ViewRays rays, uvec2 pixel_of_view, uvec3 volume_size, double step_world) {
    return set_up_ray_within(
        rays, pixel_of_view, volume_size, step_world, dvec2(0.0LF, 1.0e300LF), dvec3(1.0LF));
}

// Nothing marched yet.
RayState fresh_ray() {
    return RayState(vec3(0.0), 0.0, 0u, 0u, 0.0, 0u);
}
