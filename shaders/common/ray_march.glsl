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
#ifdef IMAGES
#include "common/filter.glsl"
#endif
#include "common/classify.glsl"

#ifdef IMAGES
uniform sampler3D channels[IMAGES];
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
        for (uint index = 0u; index < samples; ++index) {
            vec3 position = anchor_fraction + float(index) * step_voxel;
            vec3 cell = floor(position);
            vec3 within = position - cell;
            ivec3 corner = anchor.cell + ivec3(cell) + 1;
            Medium medium = Medium(vec3(0.0), 0.0);
            SAMPLE_CHANNELS
            composite(block, medium, geometry.step_world);
        }
        join_block(state, block);
        state.samples_taken += samples;
        state.next_sample += samples;
#ifdef EARLY_STOP
        if (attenuate(state.optical_depth).transmitted < early_stop) {
            state.next_sample = geometry.sample_count;
        }
#endif
    }
}
