// filter.glsl: the value between voxels. twin: src/twins/filter.rs
//
// variants FILTER_SAMPLER: the device's own trilinear filter; FILTER_FETCH: eight texels in f32;
//          FILTER_QUADS: two texels that hold four voxels each, in f32, bit for bit as FILTER_FETCH

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
