// classify.glsl: from values of channels to the medium at a sample, and from samples to a block.
// twin: src/twins/classify.rs
//
// binds    transfer  [segment]  transfer functions of all channels, one after another
// variants SEGMENTS_TOTAL: of all channels, or TRANSFER_SEARCH and SEARCH_STEPS where they are too
//          many to select from; NAN_VOXELS; SEVERAL_CHANNELS;
//          SAMPLED_CHANNELS: one SAMPLED call per channel, where some take fewer samples than rays
// source   emission and absorption, midpoint rule; weights 1 - exp(-sigma h) as in
//          residency-octree-2023 section 6; blocks keep sums short
#include "common/exponential.glsl"
#include "common/transfer.glsl"

#ifdef TRANSFER_SEARCH
layout(std430) readonly buffer transfer { TransferSegment segments[]; };
#else
layout(std140) uniform transfer { TransferSegment segments[SEGMENTS_TOTAL]; };
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

// Every voxel has one value, which the host has classified.
#define LOAD_CONSTANT(NAME, FIRST) vec4 NAME##_medium = segments[FIRST].start;
#define SAMPLE_CONSTANT(NAME) mix_in(medium, NAME##_medium.rgb, NAME##_medium.a);

#ifdef SAMPLED_CHANNELS
// One sample of so many, a power of two, that stands for all of them; at the ray's end, where fewer are left,
// each for itself. `number` counts within the block of `samples`; SAMPLES: those that are taken.
#define SAMPLED_EVERY(STEPS, SAMPLES, SAMPLE) \
    if ((samples_taken_of(STEPS, SAMPLES, samples) >> number & 1u) != 0u) { \
        Medium others = medium; \
        medium = Medium(vec3(0.0), 0.0); \
        SAMPLE \
        medium = joined_media(others, medium, number < (samples & ~(STEPS - 1u)) ? float(STEPS) : 1.0); \
    }

uint samples_taken_of(uint steps, uint taken, uint samples) {
    uint whole = samples & ~(steps - 1u);
    return whole < 32u ? taken | 0xffffffffu << whole : taken;
}

Medium joined_media(Medium others, Medium medium, float steps) {
#ifdef SEVERAL_CHANNELS
    return Medium(
        others.emission + steps * medium.emission, others.extinction + steps * medium.extinction);
#else
    return Medium(medium.emission, steps * medium.extinction);
#endif
}
#endif

// A block of samples, composited front to back.
struct Block {
    vec3 color;         // linear, premultiplied, as if nothing stood before the block
    float depth;        // optical
    float transmitted;
};

// Adds one sample of a medium that goes on for `step_world`.
void composite(inout Block block, Medium medium, float step_world) {
    // Beyond this nothing is seen, and sums of it stay finite.
    float depth = min(medium.extinction * step_world, OPAQUE_DEPTH);
    Attenuation attenuation = attenuate_bounded(depth);
#ifdef SEVERAL_CHANNELS
    vec3 color = medium.emission / max(medium.extinction, 1.0e-37);
#else
    vec3 color = medium.emission;
#endif
    float weight = block.transmitted * attenuation.absorbed;
    block.color += weight * color;
    block.transmitted -= weight;
    block.depth += depth;
}

// Puts a block behind all blocks before it. A block of nothing changes no bit.
void join_block(inout RayState state, Block block) {
    // By the exponential of the summed optical depth: products stay short.
    state.color += attenuate(state.optical_depth).transmitted * block.color;
    precise float sum = state.optical_depth + block.depth;
    precise float lost = state.optical_depth_rest + (block.depth - (sum - state.optical_depth));
    precise float settled = sum + lost;
    precise float rest = lost - (settled - sum);
    state.optical_depth_rest = rest;
    state.optical_depth = settled;
}
