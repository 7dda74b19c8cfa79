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
//          FILTER_SAMPLER, FILTER_FETCH or FILTER_QUADS; EARLY_STOP; NAN_VOXELS; SEVERAL_CHANNELS;
//          PREINTEGRATED: a sample is two spans, between its place and half a step before and after it;
//          SPAN_CHANNELS: one SPAN_ call per channel
// source   emission and absorption, midpoint rule; weights 1 - exp(-sigma h) as in
//          residency-octree-2023 section 6; blocks keep sums short and positions exact;
//          PREINTEGRATED as common/preintegrate.glsl
#include "common/fixed_point.glsl"
#ifdef IMAGES
#include "common/filter.glsl"
#endif
#include "common/classify.glsl"
#ifdef PREINTEGRATED
#ifdef NAN_VOXELS
#define MAY_BE_ABSENT true
#else
#define MAY_BE_ABSENT false
#endif
#include "common/preintegrate.glsl"
#endif

#ifdef IMAGES
uniform sampler3D channels[IMAGES];
#endif

#ifdef PREINTEGRATED
#define SAMPLE_SCALAR(NAME, IMAGE, SEGMENTS) \
    { \
        float texel = filtered_scalar(channels[IMAGE], corner, within); \
        NAME##_ahead = point_of(vec3(1.0), texel, NAME##_window_scale, NAME##_window_offset); \
    }
#define SAMPLE_RGBA(NAME, IMAGE, SEGMENTS) \
    { \
        vec4 texel = filtered(channels[IMAGE], corner, within); \
        NAME##_ahead = point_of(texel.rgb, texel.a, NAME##_window_scale, NAME##_window_offset); \
    }
#else
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
#endif

// Takes up to blocks_max blocks of samples; ends early, where the variant may, once less than
// early_stop is transmitted.
void march_ray(RayGeometry geometry, inout RayState state, uint blocks_max, float early_stop) {
    Fixed3 start = Fixed3(geometry.start_cell, geometry.start_fraction);
    Fixed3 delta = Fixed3(geometry.delta_cell, geometry.delta_fraction);
    vec3 step_voxel = fixed_float(delta);
    LOAD_CHANNELS

    for (uint turn = 0u; turn < blocks_max && state.next_sample < geometry.sample_count; ++turn) {
        Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
        vec3 anchor_fraction = fixed_fraction(anchor.fraction);
        uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
        Block block = Block(vec3(0.0), 0.0, 1.0);
#ifdef PREINTEGRATED
        uint points = 2u * samples + 1u;
        float length_world = 0.0;
        for (uint index = 0u; index < points; ++index) {
            vec3 position = anchor_fraction + (0.5 * float(index) - 0.5) * step_voxel;
#else
        uint points = samples;
        for (uint index = 0u; index < points; ++index) {
            vec3 position = anchor_fraction + float(index) * step_voxel;
#endif
            vec3 cell = floor(position);
            vec3 within = position - cell;
            ivec3 corner = anchor.cell + ivec3(cell) + 1;
#ifdef PREINTEGRATED
            SAMPLE_CHANNELS
            bool pair_middle = (index & 1u) != 0u;
            bool pair_ends = index != 0u && !pair_middle;
            // Before the third point there is no span.
            length_world = index < 2u ? 0.0 : 0.5 * geometry.step_world;
            SPAN_SUM
            SPAN_CHANNELS
            SPAN_SUM_END
#else
            Medium medium = Medium(vec3(0.0), 0.0);
            SAMPLE_CHANNELS
            composite(block, medium, geometry.step_world);
#endif
        }
#ifdef PREINTEGRATED
        {
            bool pair_middle = false;
            bool pair_ends = false;
            SPAN_SUM
            SPAN_CHANNELS
            SPAN_SUM_END
        }
#endif
        join_block(state, block);
        state.samples_taken += points;
        state.next_sample += samples;
#ifdef EARLY_STOP
        if (attenuate(state.optical_depth).transmitted < early_stop) {
            state.next_sample = geometry.sample_count;
        }
#endif
    }
}
