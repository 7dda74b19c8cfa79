// ray_march.glsl: a ray's way through the volume, block by block of samples.
// twin: src/twins/ray_march.rs
//
// binds    transfer  [segment]  transfer functions of all channels, one after another
//          channels  [image]    voxels with an apron of one on every side; absent when every channel is constant
//          macrocells  [image]  codes; MACROCELLS alone
// spaces   voxels (centre origin): block anchors in fixed point, samples in f32 from the anchor
// variants LOAD_CHANNELS, SAMPLE_CHANNELS: one LOAD_ and one SAMPLE_ call per channel;
//          SEGMENTS_TOTAL: of all channels, or TRANSFER_SEARCH and SEARCH_STEPS where they are too
//          many to select from;
//          IMAGES: how many channels have an image;
//          FILTER_SAMPLER, FILTER_FETCH or FILTER_QUADS; EARLY_STOP; NAN_VOXELS; SEVERAL_CHANNELS;
//          PREINTEGRATED: a sample is two spans, between its place and half a step before and after it;
//          SPAN_CHANNELS: one SPAN_ call per channel; SAMPLED_CHANNELS as common/classify.glsl;
//          MACROCELLS: samples in macrocells that show nothing are left out, which changes no bit;
//          ADAPTIVE: samples stand for as many steps as their macrocells allow
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
#ifdef MACROCELLS
#include "common/macrocells.glsl"
#endif

#ifdef IMAGES
uniform sampler3D channels[IMAGES];
#endif

#ifdef PREINTEGRATED
#define SAMPLE_SCALAR(NAME, IMAGE, SEGMENTS) \
    { \
        Along along = filtered_along(channels[IMAGE], corner, within, way); \
        NAME##_ahead = point_of(vec3(1.0), along, NAME##_window_scale, NAME##_window_offset); \
    }
#define SAMPLE_RGBA(NAME, IMAGE, SEGMENTS) \
    { \
        vec3 rgb; \
        Along along = filtered_color_along(channels[IMAGE], corner, within, way, rgb); \
        NAME##_ahead = point_of(rgb, along, NAME##_window_scale, NAME##_window_offset); \
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

// Samples that one turn of the loop takes; of one value everywhere, a ray takes one in all.
#ifdef IMAGES
#define AT_ONCE SAMPLES_AT_ONCE
#else
#define AT_ONCE 1u
#endif

// Points of a block's samples: a sample's place, or start, middle and end of its two spans.
#if defined(PREINTEGRATED) || defined(ADAPTIVE)
#define POINTS_OF(samples) (2u * (samples) + 1u)
#define STEPS_TO(point) (0.5 * float(point) - 0.5)
// The first sample that has the point, and the one after the last that has one before `end`.
#define FIRST_WITH(point) ((max(point, 1u) - 1u) / 2u)
#define LAST_WITH(end) (min(((end) - 1u) / 2u + 1u, samples))
// Samples whose every point comes before `end`.
#define ENDED_BEFORE(end) (((end) - 1u) / 2u)
#else
#define POINTS_OF(samples) (samples)
#define STEPS_TO(point) (float(point))
#define FIRST_WITH(point) (point)
#define LAST_WITH(end) (end)
#define ENDED_BEFORE(end) (end)
#endif

// Takes up to blocks_max blocks of samples; ends early, where the variant may, once less than
// early_stop is transmitted.
void march_ray(RayGeometry geometry, inout RayState state, uint blocks_max, float early_stop) {
    Fixed3 start = Fixed3(geometry.start_cell, geometry.start_fraction);
    Fixed3 delta = Fixed3(geometry.delta_cell, geometry.delta_fraction);
    vec3 step_voxel = fixed_float(delta);
    LOAD_CHANNELS
#ifdef MACROCELLS
    vec3 still = vec3(equal(step_voxel, vec3(0.0)));
    vec3 per_point = (1.0 - still) / (STEPS_TO(1u) - STEPS_TO(0u)) / (step_voxel + still);
#endif

    for (uint turn = 0u; turn < blocks_max && state.next_sample < geometry.sample_count; ++turn) {
        Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
        vec3 anchor_fraction = fixed_fraction(anchor.fraction);
        uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
        Block block = Block(vec3(0.0), 0.0, 1.0);
        uint taken = samples;
        uint skipped = samples;
#ifdef MACROCELLS
        uint shown = 0u;
#ifdef ADAPTIVE
        uint below[LEVEL_MAX] = uint[](0u, 0u, 0u, 0u, 0u, 0u, 0u);
#endif
        // A sample that shows something anywhere is one: of two spans, at its start, middle or end.
        uint points = POINTS_OF(samples);
        uint known = 0u;
        while (known < points) {
            vec3 position = anchor_fraction + STEPS_TO(known) * step_voxel;
            Macrocell here = macrocell_at(position, per_point, anchor.cell);
            bool shows = here.code >= CODE_SHOWS;
            uint end = known + here.points;
            end = shows ? min(end, points) : end;
            uint bits = bits_between(FIRST_WITH(known), LAST_WITH(min(end, points)));
            shown |= shows ? bits : 0u;
#ifdef ADAPTIVE
            uint level = shows ? level_of(here.code, state.optical_depth) : LEVEL_MAX;
            [[unroll]] for (uint above = 0u; above < LEVEL_MAX; ++above) {
                below[above] |= level <= above ? bits : 0u;
            }
#endif
            known = end;
        }
        // Nothing is seen as far as is known.
        skipped = max(samples, ENDED_BEFORE(known) / BLOCK_SAMPLES * BLOCK_SAMPLES);
#endif
#if defined(PREINTEGRATED)
#ifndef MACROCELLS
        uint shown = 0xffffffffu >> (32u - samples);
#endif
        vec3 way = 0.5 * step_voxel;  // from point to point
        uint phase = 0u;  // point of the sample: its start, middle, end
        taken = 0u;
        while (shown != 0u) {
            uint index = uint(findLSB(shown));
            vec3 position = anchor_fraction + STEPS_TO(2u * index + phase) * step_voxel;
            vec3 cell = floor(position);
            vec3 within = position - cell;
            ivec3 corner = anchor.cell + ivec3(cell) + 1;
            SAMPLE_CHANNELS
            // Before the second point there is no span.
            float length_world = phase == 0u ? 0.0 : 0.5 * geometry.step_world;
            SPAN_SUM
            SPAN_CHANNELS
            SPAN_SUM_END
            ++taken;
            bool ends = phase == 2u;
            shown = ends ? shown & (shown - 1u) : shown;
            // The end of a sample is the start of the next.
            bool next = (shown & (2u << index)) != 0u;
            phase = ends ? (next ? 1u : 0u) : phase + 1u;
        }
#else
#ifdef ADAPTIVE
        // Intervals beyond the ray's end join none.
        below[5] |= samples < BLOCK_SAMPLES ? 0xffffffffu << samples : 0u;
        below[6] |= below[5];
        Steps steps = joined_steps(shown, below);
        float from = 0.0;
        float length = 1.0;
        taken = 0u;
        while (steps.starts != 0u) {
#elif defined(MACROCELLS)
        taken = uint(bitCount(shown));
        while (shown != 0u) {
#else
        for (uint first = 0u; first < samples; first += AT_ONCE) {
#endif
            vec3 positions[AT_ONCE];
#ifdef SAMPLED_CHANNELS
            uint numbers[AT_ONCE];
#endif
            // 0 where fewer are left: such a sample changes no bit.
            float lengths_world[AT_ONCE];
            [[unroll]] for (uint which = 0u; which < AT_ONCE; ++which) {
#ifdef ADAPTIVE
                bool there = steps.starts != 0u;
                uint index = uint(findLSB(steps.starts)) & 31u;
                uint level = level_at(steps, index);
                // What the block hides before these samples lengthens steps too, within their interval.
                uint longer = min(level + uint(block.depth * LEVELS_OF_DEPTH), max(level, LEVEL_WHOLE));
                length = from == 0.0 ? length_of(longer) : length;
                positions[which] = anchor_fraction + (float(index) - 0.5 + from + 0.5 * length) * step_voxel;
                lengths_world[which] = there ? length * geometry.step_world : 0.0;
                taken += there ? 1u : 0u;
                from += length;
                bool ends = from >= 1.0;
                from = ends ? 0.0 : from;
                steps.starts = ends ? steps.starts & (steps.starts - 1u) : steps.starts;
#else
#ifdef MACROCELLS
                bool there = shown != 0u;
                uint index = uint(findLSB(shown)) & 31u;
                shown &= shown - 1u;
#else
                bool there = first + which < samples;
                uint index = there ? first + which : first;
#endif
                positions[which] = anchor_fraction + float(index) * step_voxel;
#ifdef SAMPLED_CHANNELS
                numbers[which] = index;
#endif
                lengths_world[which] = there ? geometry.step_world : 0.0;
#endif
            }
            Medium media[AT_ONCE];
            [[unroll]] for (uint which = 0u; which < AT_ONCE; ++which) {
                vec3 cell = floor(positions[which]);
                vec3 within = positions[which] - cell;
                ivec3 corner = anchor.cell + ivec3(cell) + 1;
                Medium medium = Medium(vec3(0.0), 0.0);
#ifdef SAMPLED_CHANNELS
                uint number = numbers[which];
#endif
                SAMPLE_CHANNELS
                media[which] = medium;
            }
            [[unroll]] for (uint which = 0u; which < AT_ONCE; ++which) {
                composite(block, media[which], lengths_world[which]);
            }
        }
#endif
        join_block(state, block);
        state.samples_taken += taken;
        state.next_sample = min(geometry.sample_count, state.next_sample + skipped);
#ifdef EARLY_STOP
        if (attenuate(state.optical_depth).transmitted < early_stop) {
            state.next_sample = geometry.sample_count;
        }
#endif
    }
}
