// filter.glsl: the value between voxels. twin: src/twins/filter.rs
//
// variants FILTER_SAMPLER: the device's own trilinear filter; FILTER_FETCH: eight texels in f32;
//          FILTER_QUADS: two texels that hold four voxels each, in f32, bit for bit as FILTER_FETCH;
//          PREINTEGRATED: values come with their slopes, of voxels that are fetched whatever the filter

// Trilinear value in the cell whose lower corner is `corner` (apron included), at `within` the cell.
#if defined(FILTER_SAMPLER)
vec4 filtered(sampler3D image, ivec3 corner, vec3 within) {
    return textureLod(image, (vec3(corner) + within + 0.5) / vec3(textureSize(image, 0)), 0.0);
}
float filtered_scalar(sampler3D image, ivec3 corner, vec3 within) {
    return filtered(image, corner, within).r;
}
#elif defined(FILTER_FETCH)
// Weights sum to one in every step and nothing is subtracted, so that no finite voxel overflows.
vec4 filtered(sampler3D image, ivec3 corner, vec3 within) {
    vec3 without = 1.0 - within;
    vec4 x00 = texelFetch(image, corner, 0) * without.x
        + texelFetch(image, corner + ivec3(1, 0, 0), 0) * within.x;
    vec4 x10 = texelFetch(image, corner + ivec3(0, 1, 0), 0) * without.x
        + texelFetch(image, corner + ivec3(1, 1, 0), 0) * within.x;
    vec4 x01 = texelFetch(image, corner + ivec3(0, 0, 1), 0) * without.x
        + texelFetch(image, corner + ivec3(1, 0, 1), 0) * within.x;
    vec4 x11 = texelFetch(image, corner + ivec3(0, 1, 1), 0) * without.x
        + texelFetch(image, corner + ivec3(1, 1, 1), 0) * within.x;
    return (x00 * without.y + x10 * within.y) * without.z
        + (x01 * without.y + x11 * within.y) * within.z;
}
float filtered_scalar(sampler3D image, ivec3 corner, vec3 within) {
    return filtered(image, corner, within).r;
}
#elif defined(FILTER_QUADS)
// A texel holds its voxel and the neighbours in x, y and xy.
float filtered_scalar(sampler3D image, ivec3 corner, vec3 within) {
    vec3 without = 1.0 - within;
    vec4 near = texelFetch(image, corner, 0);
    vec4 far = texelFetch(image, corner + ivec3(0, 0, 1), 0);
    vec2 near_y = near.xz * without.x + near.yw * within.x;
    vec2 far_y = far.xz * without.x + far.yw * within.x;
    return (near_y.x * without.y + near_y.y * within.y) * without.z
        + (far_y.x * without.y + far_y.y * within.y) * within.z;
}
#endif

#ifdef PREINTEGRATED
// What the trilinear value is like at a place.
struct Along {
    float value;
    float slope;  // change of the value per way
    float low;    // least and greatest voxel of the cell
    float high;
};

// Of a cell's lower and upper voxels along z, each four: a voxel and its neighbours in x, y and xy.
Along along_of(vec4 near, vec4 far, vec3 within, vec3 way) {
    vec3 without = 1.0 - within;
    precise vec2 near_rows = near.xz * without.x + near.yw * within.x;
    precise vec2 far_rows = far.xz * without.x + far.yw * within.x;
    precise float near_face = near_rows.x * without.y + near_rows.y * within.y;
    precise float far_face = far_rows.x * without.y + far_rows.y * within.y;
    precise float value = near_face * without.z + far_face * within.z;
    precise vec2 near_x = near.yw - near.xz;
    precise vec2 far_x = far.yw - far.xz;
    precise float slope_x = (near_x.x * without.y + near_x.y * within.y) * without.z
        + (far_x.x * without.y + far_x.y * within.y) * within.z;
    precise float slope_y = (near_rows.y - near_rows.x) * without.z + (far_rows.y - far_rows.x) * within.z;
    precise float slope_z = far_face - near_face;
    precise float slope = slope_x * way.x + slope_y * way.y + slope_z * way.z;
    vec4 least = min(near, far);
    vec4 most = max(near, far);
    float low = min(min(least.x, least.y), min(least.z, least.w));
    float high = max(max(most.x, most.y), max(most.z, most.w));
    return Along(value, slope, low, high);
}

// Value, and its slope along `way` in voxels, of the cell whose lower corner is `corner`.
#ifdef FILTER_QUADS
Along filtered_along(sampler3D image, ivec3 corner, vec3 within, vec3 way) {
    return along_of(
        texelFetch(image, corner, 0), texelFetch(image, corner + ivec3(0, 0, 1), 0), within, way);
}
#else
// Of colours: their alpha's, and the colour itself.
Along filtered_color_along(sampler3D image, ivec3 corner, vec3 within, vec3 way, out vec3 rgb) {
    vec4 x000 = texelFetch(image, corner, 0);
    vec4 x100 = texelFetch(image, corner + ivec3(1, 0, 0), 0);
    vec4 x010 = texelFetch(image, corner + ivec3(0, 1, 0), 0);
    vec4 x110 = texelFetch(image, corner + ivec3(1, 1, 0), 0);
    vec4 x001 = texelFetch(image, corner + ivec3(0, 0, 1), 0);
    vec4 x101 = texelFetch(image, corner + ivec3(1, 0, 1), 0);
    vec4 x011 = texelFetch(image, corner + ivec3(0, 1, 1), 0);
    vec4 x111 = texelFetch(image, corner + ivec3(1, 1, 1), 0);
    vec3 without = 1.0 - within;
    vec3 x00 = x000.rgb * without.x + x100.rgb * within.x;
    vec3 x10 = x010.rgb * without.x + x110.rgb * within.x;
    vec3 x01 = x001.rgb * without.x + x101.rgb * within.x;
    vec3 x11 = x011.rgb * without.x + x111.rgb * within.x;
    rgb = (x00 * without.y + x10 * within.y) * without.z + (x01 * without.y + x11 * within.y) * within.z;
    return along_of(
        vec4(x000.a, x100.a, x010.a, x110.a), vec4(x001.a, x101.a, x011.a, x111.a), within, way);
}
Along filtered_along(sampler3D image, ivec3 corner, vec3 within, vec3 way) {
    vec4 near = vec4(
        texelFetch(image, corner, 0).r, texelFetch(image, corner + ivec3(1, 0, 0), 0).r,
        texelFetch(image, corner + ivec3(0, 1, 0), 0).r, texelFetch(image, corner + ivec3(1, 1, 0), 0).r);
    vec4 far = vec4(
        texelFetch(image, corner + ivec3(0, 0, 1), 0).r, texelFetch(image, corner + ivec3(1, 0, 1), 0).r,
        texelFetch(image, corner + ivec3(0, 1, 1), 0).r, texelFetch(image, corner + ivec3(1, 1, 1), 0).r);
    return along_of(near, far, within, way);
}
#endif
#endif
