// brick_march.glsl: a ray's way through the bricks of a volume, sample by sample as ray_march.glsl.
// twin: src/twins/brick_march.rs
//
// binds    transfer     [segment]  transfer functions of all channels, one after another
//          atlases      [image]    slots, one image per texel format
//          page_table, constants, slot_used, slot_needed, wished, wish_weight:
//          as common/brick_look_up.glsl
// spaces   voxels of the level (centre origin): block anchors in fixed point, samples in f32 from the
//          anchor; texels of a slot: local voxel + 1
//          level_leaves, leaf_words: as common/octree.glsl; OCTREE alone
// variants LOAD_CHANNELS, LOOK_UP_CHANNELS, SAMPLE_CHANNELS, MARK_CHANNELS: one call per channel;
//          ATLASES; PAYLOAD, SLOT: voxels and texels of a brick along each axis; FILTER_SAMPLER,
//          FILTER_FETCH or FILTER_QUADS; SKIPPING: bricks of nothing are crossed in one step;
//          OCTREE: boxes of nothing are, and channels that show nothing in a run need no brick there;
//          CLOSED_FORM: a box of one value is one sample, as long as the ray is in it; OCTREE alone;
//          SUBSTITUTE: a ray takes a coarser level for a missing brick and does not wait;
//          SHOW_STATES: what a ray met is remembered; EARLY_STOP; PREINTEGRATED: a sample is two spans,
//          between its place and half a step before and after it; SPAN_CHANNELS: one SPAN_ call per
//          channel; as common/brick_look_up.glsl, common/classify.glsl and common/octree.glsl
// source   DESIGN section 5. A sample's brick, value and weight depend on its number alone: a ray that
//          waits and goes on gets the same bits, and so does one that skips what is hidden
#include "common/fixed_point.glsl"
#include "common/filter.glsl"
#include "common/classify.glsl"
#ifdef PREINTEGRATED
#define MAY_BE_ABSENT true
#include "common/preintegrate.glsl"
#endif
#include "common/ranks.glsl"
#ifdef OCTREE
#include "common/bits.glsl"
#include "common/octree.glsl"
#endif

#include "common/brick_look_up.glsl"

uniform sampler3D atlases[ATLASES];

#ifdef SHOW_STATES
#define REMEMBER(NAME) \
    partial.met |= NAME.state == ENTRY_FAILED ? MET_FAILED : 0u; \
    partial.met |= NAME.state == ENTRY_ABSENT ? MET_ABSENT : 0u;
#else
#define REMEMBER(NAME)
#endif

// Runs of samples in one brick that are known at a time: as many as a block crosses where its samples
// lie no more than a voxel apart and bricks are no smaller than a block.
#define RUNS 4u
#define FOUND(NAME) Found NAME##_0, NAME##_1, NAME##_2, NAME##_3;

// One channel alone always shows something in a run: that is why the run is there.
#if defined(OCTREE) && defined(SEVERAL_CHANNELS)
#define WHERE(CONDITION) if (CONDITION)
#else
#define WHERE(CONDITION)
#endif

#define LOOK_UP(NAME, BIT, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST, SLOTS_ACROSS, FINEST) \
    { \
        Found found = unneeded(brick, anchor.cell); \
        WHERE((needed & BIT) != 0u) { \
            found = look_up( \
                round, level, brick_place, brick, anchor.cell, ENTRY_FIRST, CHANNELS, CHANNEL, \
                SLOT_FIRST, SLOTS_ACROSS, FINEST, weight); \
        } \
        missing = missing || found.state <= ENTRY_EXPECTED; \
        nothing_here = nothing_here && found.has == HAS_NOTHING; \
        REMEMBER(found) \
        if (run == 0u) { NAME##_0 = found; } \
        if (run == 1u) { NAME##_1 = found; } \
        if (run == 2u) { NAME##_2 = found; } \
        if (run == 3u) { NAME##_3 = found; } \
    }

// The run that a sample lies in, by the runs it is past.
#define OF_RUN(FIELD, NAME) \
    (past.z ? NAME##_3.FIELD : past.y ? NAME##_2.FIELD : past.x ? NAME##_1.FIELD : NAME##_0.FIELD)

#ifdef SUBSTITUTE
// Numbers that are exact are added first: in any other order lavapipe's compiler brings them into this one
// (and `precise` here makes glslang of shaderc-sys 0.10.1 crash).
#define CELL_AND_WITHIN(NAME) \
    ivec3 shift = ivec3(OF_RUN(shift, NAME)); \
    ivec3 base = anchor.cell >> shift; \
    vec3 rest = vec3(anchor.cell - (base << shift)); \
    vec3 coarse = ((rest + 0.5) + position) / vec3(ivec3(1) << shift) - 0.5; \
    vec3 place_in = mix(position, coarse, notEqual(shift, ivec3(0))); \
    vec3 cell_in = floor(place_in); \
    vec3 within = place_in - cell_in; \
    ivec3 corner = OF_RUN(origin, NAME) + base + ivec3(cell_in);
#else
#define CELL_AND_WITHIN(NAME) \
    vec3 within = within_cell; \
    ivec3 corner = OF_RUN(origin, NAME) + ivec3(cell);
#endif

#ifdef PREINTEGRATED
#ifdef SUBSTITUTE
#define WAY vec3 way_in = way / vec3(ivec3(1) << shift);
#else
#define WAY vec3 way_in = way;
#endif
#define POINT_AHEAD(NAME, rgb, constant) \
    { \
        along.value = has == HAS_SLOT ? along.value : constant; \
        along.slope = has == HAS_SLOT ? along.slope : 0.0; \
        along.low = has == HAS_SLOT ? along.low : constant; \
        along.high = has == HAS_SLOT ? along.high : constant; \
        NAME##_ahead = point_of(rgb, along, NAME##_window_scale, NAME##_window_offset); \
        NAME##_ahead.unit = has == HAS_NOTHING ? NO_POINT : NAME##_ahead.unit; \
    }
#define SAMPLE_SCALAR(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        WAY \
        uint has = OF_RUN(has, NAME); \
        Along along = filtered_along(atlases[ATLAS], corner, within, way_in); \
        POINT_AHEAD(NAME, vec3(1.0), OF_RUN(texel.a, NAME)) \
    }
#define SAMPLE_RGBA(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        WAY \
        uint has = OF_RUN(has, NAME); \
        vec3 rgb; \
        Along along = filtered_color_along(atlases[ATLAS], corner, within, way_in, rgb); \
        vec4 constant = OF_RUN(texel, NAME); \
        rgb = has == HAS_SLOT ? rgb : constant.rgb; \
        POINT_AHEAD(NAME, rgb, constant.a) \
    }
#else
#define SAMPLE_SCALAR(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        uint has = OF_RUN(has, NAME); \
        float texel = filtered_scalar(atlases[ATLAS], corner, within); \
        texel = has == HAS_SLOT ? texel : OF_RUN(texel.a, NAME); \
        float windowed = clamp(texel * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        LEAVE_OUT_NAN(texel, classified) \
        classified.a = has == HAS_NOTHING ? 0.0 : classified.a; \
        mix_in(medium, classified.rgb, classified.a); \
    }

#define SAMPLE_RGBA(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        uint has = OF_RUN(has, NAME); \
        vec4 texel = filtered(atlases[ATLAS], corner, within); \
        texel = has == HAS_SLOT ? texel : OF_RUN(texel, NAME); \
        float windowed = clamp(texel.a * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        classified.a = has == HAS_NOTHING ? 0.0 : classified.a; \
        mix_in(medium, texel.rgb * classified.rgb, classified.a); \
    }

#endif

#ifdef SAMPLED_CHANNELS
#define SAMPLED(BIT, STEPS, SAMPLES) \
    sampled |= (box.shows & BIT) != 0u ? samples_taken_of(STEPS, SAMPLES, samples) : 0u;
#endif

// Points fetched for so many samples of one brick.
#ifdef PREINTEGRATED
#define POINTS_OF(samples) (2u * (samples) + 1u)
#else
#define POINTS_OF(samples) (samples)
#endif

// How many samples, this one included, lie in the box whose first voxel is `first`. Rounding may add
// or take away one at the border: half a voxel on both sides of it can be had from either brick, and is
// in the range of either box.
uint samples_until_border(
    vec3 position, vec3 step_voxel, ivec3 first, ivec3 edge, ivec3 anchor_cell
) {
    ivec3 near = first - anchor_cell;
    vec3 ahead = mix(vec3(near), vec3(near + edge), greaterThan(step_voxel, vec3(0.0)));
    vec3 still = vec3(equal(step_voxel, vec3(0.0)));
    vec3 count = (ahead - (position + 0.5)) / (step_voxel + still) + still * 1.0e9;
    return uint(clamp(ceil(min(min(count.x, count.y), count.z)), 1.0, 1.0e9));
}

ivec3 brick_of_voxel(ivec3 voxel, LevelPlaces places) {
    return ivec3(min(uvec3(max(voxel, ivec3(0))) / PAYLOAD, places.bricks - 1u));
}

// Takes up to blocks_left blocks of samples of one level; stops, with `place` saying where, at the first
// sample that needs a brick which is not there.
void march_bricks(
    RayGeometry geometry, inout RayState state, inout RayBlock partial, inout uint place, uint round,
    inout uint blocks_left, float early_stop
) {
    Fixed3 start = Fixed3(geometry.start_cell, geometry.start_fraction);
    Fixed3 delta = Fixed3(geometry.delta_cell, geometry.delta_fraction);
    vec3 step_voxel = fixed_float(delta);
    uint level = partial.level;
    LevelPlaces places = LevelPlaces(level_views[level].bricks, level_views[level].first_place);
    LOAD_CHANNELS
#ifdef OCTREE
    LevelLeaves of_level = leaves_of_level[level];
#endif

    bool missing = false;
    uint sample_index = partial.sample_index;
    Block block = Block(partial.color, partial.depth, partial.transmitted);

    // Loops test at their start. Tested at their end they would save a turn that lavapipe runs for no ray,
    // but it then draws wrong: what a ray's last turn gave is computed again while its neighbours go on.
    while (blocks_left > 0u && state.next_sample < geometry.sample_count && !missing) {
#ifdef OCTREE
        // First boxes of nothing, from block to block. A ray that has found something waits here for its
        // neighbours: what comes after the loop is paid once for all of them.
        bool seeks = block.depth == 0.0;
        while (seeks) {
            Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
            vec3 position = fixed_fraction(anchor.fraction) + float(sample_index) * step_voxel;
            uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
            Box box = box_around(of_level, anchor.cell + ivec3(floor(position + 0.5)));
            bool nothing = box.shows == 0u && sample_index < samples;
            sample_index += nothing
                ? samples_until_border(position, step_voxel, box.first, box.edge, anchor.cell) : 0u;
            bool passes = sample_index >= samples;
            uint passed = passes ? max(sample_index / BLOCK_SAMPLES * BLOCK_SAMPLES, samples) : 0u;
            state.next_sample = min(geometry.sample_count, state.next_sample + passed);
            sample_index -= min(passed, sample_index);
            blocks_left -= passes ? 1u : 0u;
            seeks = nothing && blocks_left > 0u && state.next_sample < geometry.sample_count;
        }
        bool more = blocks_left > 0u && state.next_sample < geometry.sample_count;
#else
        const bool more = true;
#endif
        Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
        vec3 anchor_fraction = fixed_fraction(anchor.fraction);
        uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
        // First the bricks that the block goes through, then its samples: where the CPU runs shaders,
        // a whole group pays for what one of its rays does in the loop over samples.
        uvec3 run_end = uvec3(0xffffffffu);
        uint known = sample_index;
        uint run = 0u;
        // A run of nothing may have reached beyond the ray's last sample.
#ifdef OCTREE
        // Before them which samples show something, box by box. A run begins where one does.
        uint shown = 0u;
#ifdef CLOSED_FORM
        uint alike = 0u;  // as the sample before, in one box with it
#endif
        uint runs = 0u;
        uvec4 begins = uvec4(0xffffffffu);
        uvec4 channels_of_run = uvec4(0u);
        ivec3 last_brick = ivec3(-1);
        bool room = more;
        while (known < samples && room) {
            vec3 position = anchor_fraction + float(known) * step_voxel;
            ivec3 voxel = anchor.cell + ivec3(floor(position + 0.5));
            Box box = box_around(of_level, voxel);
            uint end = known
                + samples_until_border(position, step_voxel, box.first, box.edge, anchor.cell);
            bool shows = box.shows != 0u;
            ivec3 brick = brick_of_voxel(voxel, places);
            bool enters = shows && brick != last_brick;
            room = !enters || runs < RUNS;
            shows = shows && room;
            end = shows ? min(end, samples) : end;
            runs += enters && room ? 1u : 0u;
            bvec4 in_run = equal(uvec4(runs), uvec4(1u, 2u, 3u, 4u));
            begins = min(begins, mix(uvec4(0xffffffffu), uvec4(known), in_run));
            channels_of_run |= mix(uvec4(0u), uvec4(shows ? box.shows : 0u), in_run);
            last_brick = shows ? brick : last_brick;
            uint here = shows ? bits_between(known, end) : 0u;
#ifdef SAMPLED_CHANNELS
            uint sampled = 0u;
            SAMPLED_CHANNELS
            here &= sampled;
#endif
            shown |= here;
#ifdef CLOSED_FORM
            alike |= shows && box.alike ? here & (here - 1u) : 0u;
#endif
            known = room ? end : known;
        }
        while (run < runs && !missing) {
            uint first = run == 0u ? begins.x : run == 1u ? begins.y : run == 2u ? begins.z : begins.w;
            uint needed = run == 0u ? channels_of_run.x
                : run == 1u ? channels_of_run.y : run == 2u ? channels_of_run.z : channels_of_run.w;
#else
        uint shown_to = 0u;  // end of the last run that shows something
        while (run < RUNS && known < samples && !missing) {
            uint first = known;
#endif
            vec3 position = anchor_fraction + float(first) * step_voxel;
            ivec3 voxel = anchor.cell + ivec3(floor(position + 0.5));
            ivec3 brick = brick_of_voxel(voxel, places);
            uint brick_place = place_of_brick(places, brick);
#ifdef SUBSTITUTE
            float transmitted = attenuate(state.optical_depth).transmitted * block.transmitted;
            uint weight = 1u + uint(transmitted * 255.0);
#else
            uint weight = 0u;
#endif
            bool nothing_here = true;
            LOOK_UP_CHANNELS
#ifdef SUBSTITUTE
            partial.met |= missing ? MET_PENDING : 0u;
            missing = false;
#else
            place = missing ? brick_place : place;
#endif
#ifdef OCTREE
            known = missing ? first : known;
            partial.met = missing
                ? (partial.met & MET_STATES) | (needed << MET_CHANNELS_SHIFT) : partial.met;
#else
            uint end = known
                + samples_until_border(
                    position, step_voxel, brick * ivec3(PAYLOAD), ivec3(PAYLOAD), anchor.cell);
            end = missing ? known : end;
#ifdef SKIPPING
            bool shows = !nothing_here && !missing;
#else
            bool shows = !missing;
#endif
            state.samples_taken += shows ? POINTS_OF(min(end, samples) - known) : 0u;
#ifdef SKIPPING
            shown_to = shows ? end : shown_to;
            sample_index = shown_to == 0u ? end : sample_index;
#endif
            known = end;
            run_end.x = run == 0u ? end : run_end.x;
            run_end.y = run == 1u ? end : run_end.y;
            run_end.z = run == 2u ? end : run_end.z;
#endif
            ++run;
        }
#if defined(OCTREE)
        run_end = begins.yzw;
        shown &= bits_between(0u, known);
#elif defined(SKIPPING)
        // Runs of nothing before and after what shows are left out; one between changes no bit.
        uint end = min(shown_to, samples);
#else
        uint end = min(known, samples);
#endif
#ifdef PREINTEGRATED
        vec3 way = 0.5 * step_voxel;  // from point to point
        uint phase = 0u;  // point of the sample: its start, middle, end
#endif
#if defined(OCTREE) && !defined(PREINTEGRATED)
#ifdef CLOSED_FORM
        shown &= ~alike;
#endif
        uint at = uint(findLSB(shown)) & 31u;
        while (shown != 0u) {
            Medium media[SAMPLES_AT_ONCE];
            // 0 where none is left: such a sample changes no bit. It is fetched where the one before is.
            float lengths_world[SAMPLES_AT_ONCE];
            [[unroll]] for (uint which = 0u; which < SAMPLES_AT_ONCE; ++which) {
                bool there = shown != 0u;
                at = there ? uint(findLSB(shown)) : at;
                shown &= shown - 1u;
                state.samples_taken += there ? 1u : 0u;
                lengths_world[which] = there ? geometry.step_world : 0.0;
#ifdef CLOSED_FORM
                // What each of them lets through, multiplied, is what their whole length does.
                lengths_world[which] *= float(1u + uint(findLSB(~(alike >> at >> 1u))));
#endif
#ifdef SAMPLED_CHANNELS
                uint number = at;
#endif
                bvec3 past = greaterThanEqual(uvec3(at), run_end);
                vec3 position = anchor_fraction + float(at) * step_voxel;
                vec3 cell = floor(position);
                vec3 within_cell = position - cell;
                Medium medium = Medium(vec3(0.0), 0.0);
                SAMPLE_CHANNELS
                media[which] = medium;
            }
            [[unroll]] for (uint which = 0u; which < SAMPLES_AT_ONCE; ++which) {
                composite(block, media[which], lengths_world[which]);
            }
        }
#else
#ifdef OCTREE
        while (shown != 0u) {
            sample_index = uint(findLSB(shown));
#else
        while (sample_index < end) {
#endif
            bvec3 past = greaterThanEqual(uvec3(sample_index), run_end);
#ifdef PREINTEGRATED
            vec3 position = anchor_fraction
                + (0.5 * float(2u * sample_index + phase) - 0.5) * step_voxel;
#else
            vec3 position = anchor_fraction + float(sample_index) * step_voxel;
#endif
            vec3 cell = floor(position);
            vec3 within_cell = position - cell;
#ifdef PREINTEGRATED
            SAMPLE_CHANNELS
            // Before the second point there is no span.
            float length_world = phase == 0u ? 0.0 : 0.5 * geometry.step_world;
            SPAN_SUM
            SPAN_CHANNELS
            SPAN_SUM_END
            bool ends = phase == 2u;
            sample_index += ends ? 1u : 0u;
            // The end of a sample is the start of the next, where they are in one brick.
            bvec3 next_past = greaterThanEqual(uvec3(sample_index), run_end);
            bool joined = next_past == past;
#ifdef OCTREE
            ++state.samples_taken;
            joined = joined && sample_index < 32u
                && (shown & (1u << (sample_index & 31u))) != 0u;
            shown = ends ? shown & (shown - 1u) : shown;
#endif
            phase = ends ? (joined ? 1u : 0u) : phase + 1u;
#else
            Medium medium = Medium(vec3(0.0), 0.0);
#ifdef SAMPLED_CHANNELS
            uint number = sample_index;
#endif
            SAMPLE_CHANNELS
            composite(block, medium, geometry.step_world);
            ++sample_index;
#endif
        }
#endif
#if defined(OCTREE)
        sample_index = known;
#elif defined(SKIPPING)
        sample_index = shown_to < known ? known : sample_index;
#endif
        if (more && sample_index >= samples) {
            --blocks_left;
            join_block(state, block);
            block = Block(vec3(0.0), 0.0, 1.0);
            // Blocks that were skipped whole change nothing.
            uint skipped = sample_index / BLOCK_SAMPLES * BLOCK_SAMPLES;
            skipped = max(skipped, samples);
            state.next_sample = min(geometry.sample_count, state.next_sample + skipped);
            sample_index = sample_index > skipped ? sample_index - skipped : 0u;
#ifdef EARLY_STOP
            if (attenuate(state.optical_depth).transmitted < early_stop) {
                state.next_sample = geometry.sample_count;
                partial.level = LEVELS;
            }
#endif
        }
    }
    partial.color = block.color;
    partial.depth = block.depth;
    partial.transmitted = block.transmitted;
    partial.sample_index = state.next_sample < geometry.sample_count ? sample_index : 0u;
}
