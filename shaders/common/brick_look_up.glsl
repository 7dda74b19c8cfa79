// brick_look_up.glsl: what a channel has in a brick, and what is wished for where it has nothing yet.
// twin: src/twins/brick_look_up.rs
//
// binds    page_table   [entry]   state and slot
//          constants    [number]  texels of bricks of one value
//          slot_used    [slot]    round in which a ray last used it
//          wish_weight  [entry]   what the brick would add; WEIGHTS alone
//          wished       [word]    one bit per entry
//          slot_needed  [slot]    round in which a waiting ray last needed it; exact refinement alone
// spaces   voxels of the level (centre origin); texels of a slot: local voxel + 1
// variants PAYLOAD, SLOT: voxels and texels of a brick along each axis;
//          SUBSTITUTE: a coarser level stands in for a missing brick;
//          CHANNEL_LEVELS: some channel is drawn no finer than at a level of its own; SUBSTITUTE alone;
//          ANCESTORS: only where all coarser bricks around are there too, for a bench; exact alone;
//          WEIGHTS: rays say how much a wish is worth, and not what they need beside it;
//          UNMARKED: slots that a ray uses are not marked, for a bench; exact refinement alone;
//          as common/ranks.glsl
// source   DESIGN section 5; residency-octree-2023 section 6.1 for levels of channels

layout(std430) readonly buffer page_table { uint entries[]; };
layout(std430) readonly buffer constants { vec4 constant_texels[]; };
layout(std430) writeonly buffer slot_used { uint round_used[]; };
#ifdef WEIGHTS
layout(std430) buffer wish_weight { uint weight_of_entry[]; };
#else
layout(std430) writeonly buffer slot_needed { uint round_needed[]; };
#endif
layout(std430) buffer wished { uint wishes_in_word[]; };

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
    if (state == ENTRY_MAPPED) {
        uint slot = slot_first + (value & ENTRY_PAYLOAD_MASK);
        round_used[slot] = round;
#ifndef WEIGHTS
        round_needed[slot] = round;
#endif
    }
    if (state == ENTRY_UNMAPPED) {
        wish(entry);
#ifdef WEIGHTS
        atomicAdd(weight_of_entry[entry], 1u);
#endif
    }
    return state <= ENTRY_EXPECTED;
}

ivec3 origin_of_slot(uint slot, uvec2 slots_across) {
    uint row = slot / slots_across.x;
    return ivec3(slot % slots_across.x, row % slots_across.y, row / slots_across.y) * ivec3(SLOT);
}

// What one channel has in a brick; `origin` is the texel of the cell at the block's anchor (in a coarser
// level: of that level's cell 0).
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
    // Where nothing is in a slot, the first slot is fetched from and not used.
    found.origin = -brick * ivec3(PAYLOAD);
    if (state == ENTRY_MAPPED) {
        found.has = HAS_SLOT;
        found.origin += origin_of_slot(payload, slots_across);
#ifndef UNMARKED
        round_used[slot_first + payload] = round;
#endif
    }
    if (state == ENTRY_CONSTANT) {
        found.has = HAS_CONSTANT;
        found.texel = constant_texels[payload];
    }
}

// Where a level's bricks stand among all places.
struct LevelPlaces {
    uvec3 bricks;  // along each axis
    uint first;
};

uint place_of_brick(LevelPlaces places, ivec3 brick) {
    uvec3 at = uvec3(brick);
    return places.first + (at.z * places.bricks.y + at.y) * places.bricks.x + at.x;
}

#ifdef ANCESTORS
// The place of a coarser level around a brick.
uint place_around(uint level, uint coarser, ivec3 brick) {
    LevelPlaces places =
        LevelPlaces(level_views[coarser].bricks, level_views[coarser].first_place);
    uvec3 shift = level_views[coarser].halvings - level_views[level].halvings;
    return place_of_brick(places, brick >> ivec3(shift));
}
#endif

// `entry_first` and `channels` as in CacheRound; `channel` counts within the atlas. `finest`: level that the
// channel is drawn at where rays are in a finer one.
Found look_up(
    uint round, uint level, uint place, ivec3 brick, ivec3 anchor_cell, uint entry_first, uint channels,
    uint channel, uint slot_first, uvec2 slots_across, uint finest, uint weight
) {
    Found found;
    found.origin = ivec3(0);
    found.texel = vec4(0.0);
#ifdef SUBSTITUTE
    found.shift = uvec3(0u);
#endif
    uint own_level = level;
    ivec3 own_brick = brick;
#ifdef CHANNEL_LEVELS
    own_level = max(level, finest);
    found.shift = level_views[own_level].halvings - level_views[level].halvings;
    own_brick = brick >> ivec3(found.shift);
    place = place_of_brick(
        LevelPlaces(level_views[own_level].bricks, level_views[own_level].first_place), own_brick);
#endif
    uint entry = entry_first + place * channels + channel;
    take(found, round, entries[entry], slot_first, slots_across, own_brick);
#ifdef ANCESTORS
    // From the root down, as one goes through a tree of pointers.
    uint state = found.state;
    for (uint coarser = LEVELS - 1u; coarser > level; --coarser) {
        uint value = entries[entry_first + place_around(level, coarser, brick) * channels + channel];
        bool there = (value >> ENTRY_STATE_SHIFT) == ENTRY_MAPPED;
        if (there) {
            round_used[slot_first + (value & ENTRY_PAYLOAD_MASK)] = round;
        }
        state = min(state, (value >> ENTRY_STATE_SHIFT) <= ENTRY_EXPECTED ? ENTRY_EXPECTED : state);
    }
    found.state = state;
#endif
#ifdef SUBSTITUTE
    if (found.state == ENTRY_UNMAPPED) {
        wish(entry);
        atomicAdd(weight_of_entry[entry], weight);
    }
    uint missed = found.state;
    bool wanted = missed <= ENTRY_EXPECTED || missed == ENTRY_FAILED;
    for (uint coarser = own_level + 1u; wanted && coarser < LEVELS; ++coarser) {
        uvec3 shift = level_views[coarser].halvings - level_views[level].halvings;
        ivec3 above = brick >> ivec3(shift);
        LevelPlaces places =
            LevelPlaces(level_views[coarser].bricks, level_views[coarser].first_place);
        entry = entry_first + place_of_brick(places, above) * channels + channel;
        take(found, round, entries[entry], slot_first, slots_across, above);
        found.shift = shift;
        wanted = found.state <= ENTRY_EXPECTED || found.state == ENTRY_FAILED;
    }
    found.state = missed;
    found.origin += 1;
#else
    found.origin += anchor_cell + 1;
#endif
    return found;
}

// What a channel has that shows nothing in a run.
Found unneeded(ivec3 brick, ivec3 anchor_cell) {
    Found found;
    found.has = HAS_NOTHING;
    found.state = ENTRY_HIDDEN;
    found.origin = 1 - brick * ivec3(PAYLOAD);
    found.texel = vec4(0.0);
#ifdef SUBSTITUTE
    found.shift = uvec3(0u);
#else
    found.origin += anchor_cell;
#endif
    return found;
}
