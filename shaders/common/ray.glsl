// ray.glsl: what passes keep of one ray.

// Where a ray samples: sample i lies at start + i * delta, in voxel coordinates whose integers are
// voxel centres; both numbers are fixed point, cell + fraction / 2^32. Made once from the camera.
struct RayGeometry {
    ivec3 start_cell;
    uint sample_count;    // 0: the ray misses the volume
    uvec3 start_fraction;
    float step_world;     // distance of two samples, world units
    ivec3 delta_cell;
    uint unused_0;
    uvec3 delta_fraction;
    uint unused_1;
};

// How far a ray has come. Enough to go on in another dispatch with no change in the result.
struct RayState {
    vec3 color;                // linear, premultiplied
    float optical_depth;
    uint next_sample;          // equals the sample count when the ray has ended
    uint samples_taken;
    float optical_depth_rest;  // what optical_depth lost to rounding
    uint unused_0;
};

struct TileShape {
    uvec2 origin_pixel;
    uvec2 size_pixel;
};
