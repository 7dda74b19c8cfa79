// probe.comp: takes samples of one image along straight lines and sums them: the bare price of a
// sample, and with one sample a line, the device's own filter to be compared with arithmetic.
//
// reads    probed  [image]  voxels with an apron of one on every side; absent in the bare loop
// writes   sums    [line]   sum of the values along each line
// shape    one thread per line, 8 x 8 x 1
// spaces   voxels (centre origin), f32
// variants FILTER_SAMPLER, FILTER_FETCH, FILTER_QUADS; FILTER_ONE: one texel, unfiltered;
//          FILTER_NONE: no texel at all
// twin     src/twins/probe.rs
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std430) writeonly buffer sums { float sum_of_line[]; };
#ifndef FILTER_NONE
#include "common/filter.glsl"
uniform sampler3D probed;
#endif

layout(push_constant) uniform Push {
    vec3 origin_voxel;
    uint lines_across;
    vec3 column_voxel;  // from one line to the next, across
    uint lines_down;
    vec3 row_voxel;     // and down
    uint samples;       // of each line
    vec3 step_voxel;    // along the line
} push;

void main() {
    uvec2 line = gl_GlobalInvocationID.xy;
    if (line.x >= push.lines_across || line.y >= push.lines_down) {
        return;
    }
    vec3 start = push.origin_voxel + float(line.x) * push.column_voxel + float(line.y) * push.row_voxel;
    float sum = 0.0;
    for (uint index = 0u; index < push.samples; ++index) {
        vec3 position = start + float(index) * push.step_voxel;
        vec3 cell = floor(position);
        vec3 within = position - cell;
#ifdef FILTER_NONE
        sum += within.x + within.y + within.z;
#else
        ivec3 corner = ivec3(cell) + 1;
#ifdef FILTER_ONE
        sum += texelFetch(probed, corner, 0).r + within.x;
#else
        sum += filtered_scalar(probed, corner, within);
#endif
#endif
    }
    sum_of_line[line.y * push.lines_across + line.x] = sum;
}
