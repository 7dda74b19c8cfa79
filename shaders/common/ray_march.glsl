// ray_march.glsl: a ray's way through the volume, block by block of samples.
// twin: src/twins/ray_march.rs
//
// binds    transfer  [segment]  transfer functions of all channels, one after another
//          channels  [image]    voxels with an apron of one on every side; absent when every channel is constant
// spaces   voxels (centre origin): block anchors in fixed point, samples in f32 from the anchor
// variants LOAD_CHANNELS, SAMPLE_CHANNELS: one LOAD_ and one SAMPLE_ call per channel;
//          SEGMENTS_TOTAL: of all channels, or TRANSFER_SEARCH and SEARCH_STEPS where they are too
//          many to select from;
//          IMAGES: how many channels have an image;
//          FILTER_SAMPLER, FILTER_FETCH or FILTER_QUADS; EARLY_STOP; NAN_VOXELS; SEVERAL_CHANNELS
// source   emission and absorption, midpoint rule; weights 1 - exp(-sigma h) as in
//          residency-octree-2023 section 6; blocks keep sums short and positions exact
#include "common/fixed_point.glsl"
#include "common/exponential.glsl"
#ifdef IMAGES
#include "common/filter.glsl"
#endif
#include "common/transfer.glsl"

#ifdef TRANSFER_SEARCH
layout(std430) readonly buffer transfer { TransferSegment segments[]; };
#else
layout(std140) uniform transfer { TransferSegment segments[SEGMENTS_TOTAL]; };
#endif
#ifdef IMAGES
uniform sampler3D channels[IMAGES];
#endif

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

// The last segment that begins at or before the windowed value.
#ifdef TRANSFER_SEARCH
// Binary search in the buffer, unrolled: SEARCH_STEPS halvings find one of 2^SEARCH_STEPS segments.
#define LOAD_SEGMENTS(NAME, FIRST, SEGMENTS) \
    const uint NAME##_first = FIRST; \
    const uint NAME##_count = SEGMENTS; \
    float NAME##_window_scale = segments[FIRST].window_scale; \
    float NAME##_window_offset = segments[FIRST].window_offset;

#define CLASSIFY(NAME, windowed, SEGMENTS, result) \
    { \
        uint found = 0u; \
        [[unroll]] for (uint halving = 0u; halving < SEARCH_STEPS; ++halving) { \
            uint tried = found + ((1u << (SEARCH_STEPS - 1u)) >> halving); \
            if (tried < NAME##_count && windowed >= segments[NAME##_first + tried].begins_at) { \
                found = tried; \
            } \
        } \
        TransferSegment segment = segments[NAME##_first + found]; \
        result = segment.start + segment.slope * (windowed - segment.begins_at); \
        result.a = max(result.a, 0.0); \
    }
#else
// All segments are loaded once: selecting among registers costs a tenth of a load.
#define LOAD_SEGMENTS(NAME, FIRST, SEGMENTS) \
    vec4 NAME##_start[SEGMENTS]; \
    vec4 NAME##_slope[SEGMENTS]; \
    float NAME##_begins_at[SEGMENTS]; \
    [[unroll]] for (int index = 0; index < SEGMENTS; ++index) { \
        NAME##_start[index] = segments[FIRST + index].start; \
        NAME##_slope[index] = segments[FIRST + index].slope; \
        NAME##_begins_at[index] = segments[FIRST + index].begins_at; \
    } \
    float NAME##_window_scale = segments[FIRST].window_scale; \
    float NAME##_window_offset = segments[FIRST].window_offset;

#define CLASSIFY(NAME, windowed, SEGMENTS, result) \
    { \
        vec4 start = NAME##_start[0]; \
        vec4 slope = NAME##_slope[0]; \
        float begins_at = NAME##_begins_at[0]; \
        [[unroll]] for (int index = 1; index < SEGMENTS; ++index) { \
            bool begun = windowed >= NAME##_begins_at[index]; \
            start = mix(start, NAME##_start[index], bvec4(begun)); \
            slope = mix(slope, NAME##_slope[index], bvec4(begun)); \
            begins_at = begun ? NAME##_begins_at[index] : begins_at; \
        } \
        result = start + slope * (windowed - begins_at); \
        result.a = max(result.a, 0.0); \
    }
#endif

#ifdef NAN_VOXELS
#define LEAVE_OUT_NAN(value, result) if (is_nan(value)) { result = vec4(0.0); }
#else
#define LEAVE_OUT_NAN(value, result)
#endif

#define SAMPLE_SCALAR(NAME, IMAGE, SEGMENTS) \
    { \
        float texel = filtered_scalar(channels[IMAGE], corner, within); \
        float windowed = clamp(texel * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        LEAVE_OUT_NAN(texel, classified) \
        mix_in(medium, classified.rgb, classified.a); \
    }

#define SAMPLE_RGBA(NAME, IMAGE, SEGMENTS) \
    { \
        vec4 texel = filtered(channels[IMAGE], corner, within); \
        float windowed = clamp(texel.a * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        mix_in(medium, texel.rgb * classified.rgb, classified.a); \
    }

// Every voxel has one value, which the host has classified.
#define LOAD_CONSTANT(NAME, FIRST) vec4 NAME##_medium = segments[FIRST].start;
#define SAMPLE_CONSTANT(NAME) mix_in(medium, NAME##_medium.rgb, NAME##_medium.a);

// Takes up to blocks_max blocks of samples; ends early, where the variant may, once less than
// early_stop is transmitted.
void march_ray(RayGeometry geometry, inout RayState state, uint blocks_max, float early_stop) {
    Fixed3 start = Fixed3(geometry.start_cell, geometry.start_fraction);
    Fixed3 delta = Fixed3(geometry.delta_cell, geometry.delta_fraction);
    vec3 step_voxel = fixed_float(delta);
    LOAD_CHANNELS

    for (uint block = 0u; block < blocks_max && state.next_sample < geometry.sample_count; ++block) {
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
            SAMPLE_CHANNELS
            // Beyond this nothing is seen, and sums of it stay finite.
            float depth = min(medium.extinction * geometry.step_world, OPAQUE_DEPTH);
            Attenuation attenuation = attenuate_bounded(depth);
#ifdef SEVERAL_CHANNELS
            vec3 color = medium.emission / max(medium.extinction, 1.0e-37);
#else
            vec3 color = medium.emission;
#endif
            float weight = block_transmitted * attenuation.absorbed;
            block_color += weight * color;
            block_transmitted -= weight;
            block_depth += depth;
        }
        // Blocks are joined by the exponential of the summed optical depth: products stay short.
        state.color += attenuate(state.optical_depth).transmitted * block_color;
        precise float sum = state.optical_depth + block_depth;
        precise float lost = state.optical_depth_rest + (block_depth - (sum - state.optical_depth));
        precise float settled = sum + lost;
        precise float rest = lost - (settled - sum);
        state.optical_depth_rest = rest;
        state.optical_depth = settled;
        state.samples_taken += samples;
        state.next_sample += samples;
#ifdef EARLY_STOP
        if (attenuate(state.optical_depth).transmitted < early_stop) {
            state.next_sample = geometry.sample_count;
        }
#endif
    }
}
