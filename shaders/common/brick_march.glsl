// brick_march.glsl: a ray's way through the bricks of a volume, sample by sample as ray_march.glsl.
// twin: src/twins/brick_march.rs
//
// binds    transfer     [segment]  transfer functions of all channels, one after another
//          page_table   [entry]    state and slot
//          constants    [number]   texels of bricks of one value
//          slot_used    [slot]     round in which a ray last used it
//          atlases      [image]    slots, one image per texel format
//          wish_weight  [entry]    what the brick would add; substitute refinement alone
//          wished       [word]     one bit per entry
//          slot_needed  [slot]     round in which a waiting ray last needed it; exact refinement alone
// spaces   voxels of the level (centre origin): block anchors in fixed point, samples in f32 from the
//          anchor; texels of a slot: local voxel + 1
// variants LOAD_CHANNELS, LOOK_UP_CHANNELS, SAMPLE_CHANNELS, MARK_CHANNELS: one call per channel;
//          ATLASES; PAYLOAD, SLOT: voxels and texels of a brick along each axis; FILTER_SAMPLER,
//          FILTER_FETCH or FILTER_QUADS; SKIPPING: bricks of nothing are crossed in one step;
//          SUBSTITUTE: a ray takes a coarser level for a missing brick and does not wait;
//          UNMARKED: slots that a ray uses are not marked, for a bench; exact refinement alone;
//          SHOW_STATES: what a ray met is remembered; EARLY_STOP; as common/ranks.glsl and
//          common/classify.glsl
// source   DESIGN section 5. A sample's brick, value and weight depend on its number alone: a ray that
//          waits and goes on gets the same bits, and so does one that skips what is hidden
#include "common/fixed_point.glsl"
#include "common/filter.glsl"
#include "common/classify.glsl"
#include "common/ranks.glsl"

layout(std430) readonly buffer page_table { uint entries[]; };
layout(std430) readonly buffer constants { vec4 constant_texels[]; };
layout(std430) writeonly buffer slot_used { uint round_used[]; };
#ifdef SUBSTITUTE
layout(std430) buffer wish_weight { uint weight_of_entry[]; };
#else
layout(std430) writeonly buffer slot_needed { uint round_needed[]; };
#endif
layout(std430) buffer wished { uint wishes_in_word[]; };
uniform sampler3D atlases[ATLASES];

// What a channel has in the brick around a sample.
#define HAS_NOTHING 0u
#define HAS_CONSTANT 1u
#define HAS_SLOT 2u
void wish(uint entry) {
    uint bit = 1u << (entry & 31u);
    if ((wishes_in_word[entry >> 5u] & bit) == 0u) {
        atomicOr(wishes_in_word[entry >> 5u], bit);
    }
}

// Marks what a ray that waits at a place needs of one channel; true where it has to wait.
bool mark(uint round, uint entry, uint slot_first) {
    uint value = entries[entry];
    uint state = value >> ENTRY_STATE_SHIFT;
#ifndef SUBSTITUTE
    if (state == ENTRY_MAPPED) {
        uint slot = slot_first + (value & ENTRY_PAYLOAD_MASK);
        round_used[slot] = round;
        round_needed[slot] = round;
    }
#endif
    if (state == ENTRY_UNMAPPED) {
        wish(entry);
    }
    return state <= ENTRY_EXPECTED;
}

ivec3 origin_of_slot(uint slot, uvec2 slots_across) {
    uint row = slot / slots_across.x;
    return ivec3(slot % slots_across.x, row % slots_across.y, row / slots_across.y) * ivec3(SLOT);
}

// What one channel has in a brick; `origin` is the texel of the voxel that comes before the brick's.
struct Found {
    uint has;
    uint state;
    ivec3 origin;
    vec4 texel;           // of a constant
#ifdef SUBSTITUTE
    uvec3 shift;          // how many levels coarser, per axis
#endif
};

void take(inout Found found, uint round, uint value, uint slot_first, uvec2 slots_across, ivec3 brick) {
    uint state = value >> ENTRY_STATE_SHIFT;
    uint payload = value & ENTRY_PAYLOAD_MASK;
    found.state = state;
    found.has = HAS_NOTHING;
    if (state == ENTRY_MAPPED) {
        found.has = HAS_SLOT;
        found.origin = origin_of_slot(payload, slots_across) - brick * ivec3(PAYLOAD);
#ifndef UNMARKED
        round_used[slot_first + payload] = round;
#endif
    }
    if (state == ENTRY_CONSTANT) {
        found.has = HAS_CONSTANT;
        found.texel = constant_texels[payload];
    }
}

// `entry_first` and `channels` as in CacheRound; `channel` counts within the atlas.
Found look_up(
    uint round, uint level, ivec3 brick, uint entry_first, uint channels, uint channel, uint slot_first,
    uvec2 slots_across, uint weight
) {
    uvec3 bricks = level_views[level].bricks;
    uint place = level_views[level].first_place
        + (uint(brick.z) * bricks.y + uint(brick.y)) * bricks.x + uint(brick.x);
    uint entry = entry_first + place * channels + channel;
    Found found;
    found.origin = ivec3(0);
    found.texel = vec4(0.0);
#ifdef SUBSTITUTE
    found.shift = uvec3(0u);
#endif
    take(found, round, entries[entry], slot_first, slots_across, brick);
#ifdef SUBSTITUTE
    if (found.state == ENTRY_UNMAPPED) {
        wish(entry);
        atomicAdd(weight_of_entry[entry], weight);
    }
    uint missed = found.state;
    bool wanted = missed <= ENTRY_EXPECTED || missed == ENTRY_FAILED;
    for (uint coarser = level + 1u; wanted && coarser < LEVELS; ++coarser) {
        bricks = level_views[coarser].bricks;
        uvec3 shift = level_views[coarser].halvings - level_views[level].halvings;
        ivec3 above = brick >> ivec3(shift);
        place = level_views[coarser].first_place
            + (uint(above.z) * bricks.y + uint(above.y)) * bricks.x + uint(above.x);
        take(found, round, entries[entry_first + place * channels + channel], slot_first, slots_across, above);
        found.shift = shift;
        wanted = found.state <= ENTRY_EXPECTED || found.state == ENTRY_FAILED;
    }
    found.state = missed;
#endif
    return found;
}

#ifdef SHOW_STATES
#define REMEMBER(NAME) \
    partial.met |= NAME.state == ENTRY_FAILED ? MET_FAILED : 0u; \
    partial.met |= NAME.state == ENTRY_ABSENT ? MET_ABSENT : 0u;
#else
#define REMEMBER(NAME)
#endif

#define LOOK_UP(NAME, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST, SLOTS_ACROSS) \
    NAME = look_up( \
        round, level, brick, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST, SLOTS_ACROSS, weight); \
    missing = missing || NAME.state <= ENTRY_EXPECTED; \
    nothing_here = nothing_here && NAME.has == HAS_NOTHING; \
    REMEMBER(NAME)

#ifdef SUBSTITUTE
#define CELL_AND_WITHIN(NAME) \
    ivec3 shift = ivec3(NAME.shift); \
    ivec3 base = anchor.cell >> shift; \
    vec3 rest = vec3(anchor.cell - (base << shift)); \
    vec3 coarse = (rest + position + 0.5) / vec3(ivec3(1) << shift) - 0.5; \
    bvec3 substituted = notEqual(shift, ivec3(0)); \
    vec3 place_in = mix(position, coarse, substituted); \
    vec3 cell_in = floor(place_in); \
    vec3 within = place_in - cell_in; \
    ivec3 corner = NAME.origin + base + ivec3(cell_in) + 1;
#else
#define CELL_AND_WITHIN(NAME) \
    vec3 within = within_cell; \
    ivec3 corner = NAME.origin + voxel + 1;
#endif

#define SAMPLE_SCALAR(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        corner = NAME.has == HAS_SLOT ? corner : ivec3(0); \
        float texel = filtered_scalar(atlases[ATLAS], corner, within); \
        texel = NAME.has == HAS_SLOT ? texel : NAME.texel.a; \
        float windowed = clamp(texel * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        LEAVE_OUT_NAN(texel, classified) \
        classified = NAME.has == HAS_NOTHING ? vec4(0.0) : classified; \
        mix_in(medium, classified.rgb, classified.a); \
    }

#define SAMPLE_RGBA(NAME, ATLAS, SEGMENTS) \
    { \
        CELL_AND_WITHIN(NAME) \
        corner = NAME.has == HAS_SLOT ? corner : ivec3(0); \
        vec4 texel = filtered(atlases[ATLAS], corner, within); \
        texel = NAME.has == HAS_SLOT ? texel : NAME.texel; \
        float windowed = clamp(texel.a * NAME##_window_scale + NAME##_window_offset, 0.0, 1.0); \
        vec4 classified; \
        CLASSIFY(NAME, windowed, SEGMENTS, classified) \
        classified = NAME.has == HAS_NOTHING ? vec4(0.0) : classified; \
        mix_in(medium, texel.rgb * classified.rgb, classified.a); \
    }

// How many samples, this one included, surely lie in the box that begins at `first`.
uint samples_inside(vec3 position, vec3 step_voxel, ivec3 first, ivec3 end, ivec3 anchor_cell) {
    vec3 ahead = mix(vec3(first - anchor_cell), vec3(end - anchor_cell), greaterThan(step_voxel, vec3(0.0)));
    vec3 count = mix(
        (ahead - position) / step_voxel, vec3(1.0e9), equal(step_voxel, vec3(0.0)));
    // A little less than computed: rounding must not skip what lies beyond.
    return uint(max(min(min(count.x, count.y), count.z) * 0.9999 - 0.01, 1.0));
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
    LOAD_CHANNELS

    // The box of cells around the sample in whose brick everything is known.
    ivec3 box_first = ivec3(0);
    ivec3 box_end = ivec3(0);
    bool nothing_here = false;
    bool missing = false;
    uint sample_index = partial.sample_index;
    Block block = Block(partial.color, partial.depth, partial.transmitted);

    for (; blocks_left > 0u && state.next_sample < geometry.sample_count && !missing; --blocks_left) {
        Fixed3 anchor = fixed_advance(start, delta, state.next_sample);
        vec3 anchor_fraction = fixed_fraction(anchor.fraction);
        uint samples = min(BLOCK_SAMPLES, geometry.sample_count - state.next_sample);
        while (sample_index < samples) {
            vec3 position = anchor_fraction + float(sample_index) * step_voxel;
            vec3 cell = floor(position);
            vec3 within_cell = position - cell;
            ivec3 voxel = anchor.cell + ivec3(cell);
            // A loop of one turn: where nobody has to look anything up, nobody pays.
            for (bool outside = any(lessThan(voxel, box_first)) || any(greaterThanEqual(voxel, box_end));
                outside; outside = false) {
                ivec3 brick = max(voxel, ivec3(0)) / ivec3(PAYLOAD);
                box_first = brick * ivec3(PAYLOAD) - ivec3(equal(brick, ivec3(0)));
                box_end = (brick + 1) * ivec3(PAYLOAD);
#ifdef SUBSTITUTE
                float transmitted = attenuate(state.optical_depth).transmitted * block.transmitted;
                uint weight = 1u + uint(transmitted * 255.0);
#else
                uint weight = 0u;
#endif
                nothing_here = true;
                LOOK_UP_CHANNELS
#ifdef SUBSTITUTE
                partial.met |= missing ? MET_PENDING : 0u;
                missing = false;
#else
                if (missing) {
                    uvec3 bricks = level_views[level].bricks;
                    place = level_views[level].first_place
                        + (uint(brick.z) * bricks.y + uint(brick.y)) * bricks.x + uint(brick.x);
                }
#endif
            }
            if (missing) {
                break;
            }
#ifdef SKIPPING
            if (nothing_here) {
                sample_index += samples_inside(position, step_voxel, box_first, box_end, anchor.cell);
                continue;
            }
#endif
            Medium medium = Medium(vec3(0.0), 0.0);
            SAMPLE_CHANNELS
            composite(block, medium, geometry.step_world);
            state.samples_taken += 1u;
            sample_index += 1u;
        }
        if (!missing) {
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
