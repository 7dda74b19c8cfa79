// march.comp: moves every ray of a tile on by a bounded number of samples, until it ends.
//
// reads    ray_geometry  [ray]      fixed-point start and step
//          transfer      [segment]  transfer functions of all channels, one after another
//          channels      [image]    voxels with an apron of one on every side; absent when every channel is constant
// updates  ray_state     [ray]      position, optical depth, colour
// shape    one thread per ray of the tile, 8 x 8 x 1
// spaces   voxels (centre origin): block anchors in fixed point, samples in f32 from the anchor
// variants CHANNELS_DO: one CHANNEL_* call per channel; IMAGES: how many channels have an image;
//          FILTER_SAMPLER, FILTER_FETCH or FILTER_QUADS; EARLY_STOP; NAN_VOXELS; SEVERAL_CHANNELS
// twin     src/twins/march.rs
// source   emission and absorption, midpoint rule; weights 1 - exp(-sigma h) as in
//          residency-octree-2023 section 6; blocks keep sums short and positions exact
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/fixed_point.glsl"
#include "common/exponential.glsl"
#include "common/filter.glsl"
#include "common/transfer.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

layout(std430) readonly buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) readonly buffer transfer { TransferSegment segments[]; };
layout(std430) buffer ray_state { RayState state_of_ray[]; };
#ifdef IMAGES
uniform sampler3D channels[IMAGES];
#endif

layout(push_constant) uniform Push {
    uvec2 tile_size_pixel;
    uint blocks_max;      // blocks of samples in this dispatch
#ifdef EARLY_STOP
    float early_stop;     // a ray ends when less than this is transmitted
#endif
} push;

struct Medium {
    vec3 emission;     // sum over channels of extinction * rgb; of one channel: its rgb alone
    float extinction;  // per world unit
};

bool is_nan(float value) {
    return (floatBitsToUint(value) & 0x7fffffffu) > 0x7f800000u;
}

// Adds a medium to what other channels give at the same place.
void mix_in(inout Medium medium, vec3 color, float extinction) {
#ifdef SEVERAL_CHANNELS
    medium.emission += extinction * color;
    medium.extinction += extinction;
#else
    medium = Medium(color, extinction);
#endif
}

// Chooses the segment by comparisons, which cost less than one load on every device measured.
#define CLASSIFY(windowed, FIRST, SEGMENTS, result) \
    { \
        vec4 start = segments[FIRST].start; \
        vec4 slope = segments[FIRST].slope; \
        float begins_at = segments[FIRST].begins_at; \
        [[unroll]] for (int index = 1; index < SEGMENTS; ++index) { \
            if (windowed >= segments[FIRST + index].begins_at) { \
                start = segments[FIRST + index].start; \
                slope = segments[FIRST + index].slope; \
                begins_at = segments[FIRST + index].begins_at; \
            } \
        } \
        result = start + slope * (windowed - begins_at); \
        result.a = max(result.a, 0.0); \
    }

#ifdef NAN_VOXELS
#define LEAVE_OUT_NAN(value, result) if (is_nan(value)) { result = vec4(0.0); }
#else
#define LEAVE_OUT_NAN(value, result)
#endif

#define CHANNEL_SCALAR(IMAGE, FIRST, SEGMENTS) \
    { \
        float texel = filtered_scalar(channels[IMAGE], corner, within); \
        float windowed = clamp(texel * segments[FIRST].window_scale \
            + segments[FIRST].window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(windowed, FIRST, SEGMENTS, classified) \
        LEAVE_OUT_NAN(texel, classified) \
        mix_in(medium, classified.rgb, classified.a); \
    }

#define CHANNEL_RGBA(IMAGE, FIRST, SEGMENTS) \
    { \
        vec4 texel = filtered(channels[IMAGE], corner, within); \
        float windowed = clamp(texel.a * segments[FIRST].window_scale \
            + segments[FIRST].window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(windowed, FIRST, SEGMENTS, classified) \
        mix_in(medium, texel.rgb * classified.rgb, classified.a); \
    }

// Every voxel has one value: the host has classified it.
#define CHANNEL_CONSTANT(FIRST) \
    mix_in(medium, segments[FIRST].start.rgb, segments[FIRST].start.a);

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
    Fixed3 start = Fixed3(geometry.start_cell, geometry.start_fraction);
    Fixed3 delta = Fixed3(geometry.delta_cell, geometry.delta_fraction);
    vec3 step_voxel = fixed_float(delta);

    for (uint block = 0u; block < push.blocks_max; ++block) {
        Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
        vec3 anchor_fraction = fixed_fraction(anchor.fraction);
        uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
        vec3 block_color = vec3(0.0);
        float block_depth = 0.0;
        float block_transmitted = 1.0;
        for (uint index = 0u; index < samples; ++index) {
            vec3 position = anchor_fraction + float(index) * step_voxel;
            vec3 cell = floor(position);
            vec3 within = position - cell;
            ivec3 corner = anchor.cell + ivec3(cell) + 1;
            Medium medium = Medium(vec3(0.0), 0.0);
            CHANNELS_DO
            // Beyond this nothing is seen, and sums of it stay finite.
            float depth = min(medium.extinction * geometry.step_world, DEPTH_OF_SAMPLE_MAX);
            Attenuation attenuation = attenuate(depth);
#ifdef SEVERAL_CHANNELS
            vec3 color = medium.emission / max(medium.extinction, 1.0e-37);
#else
            vec3 color = medium.emission;
#endif
            block_color += (block_transmitted * attenuation.absorbed) * color;
            block_transmitted *= attenuation.transmitted;
            block_depth += depth;
        }
        // Blocks are joined by the exponential of the summed optical depth: products stay short.
        state.color += attenuate(state.optical_depth).transmitted * block_color;
        float sum = state.optical_depth + block_depth;
        state.optical_depth_rest += block_depth - (sum - state.optical_depth);
        float settled = sum + state.optical_depth_rest;
        state.optical_depth_rest -= settled - sum;
        state.optical_depth = settled;
        state.samples_taken += samples;
        state.next_sample += samples;
#ifdef EARLY_STOP
        if (attenuate(state.optical_depth).transmitted < push.early_stop) {
            state.next_sample = geometry.sample_count;
        }
#endif
        if (state.next_sample >= geometry.sample_count) {
            break;
        }
    }
    state_of_ray[ray] = state;
}
