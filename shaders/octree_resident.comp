// octree_resident.comp: which levels are resident around each brick, after some came or went.
//
// reads    places_of_levels  [level]   bricks of each level
//          changes           [change]  one of a brick at most
// updates  resident          [word]    a bit per level; one word for each place of each channel
// shape    one workgroup for all changes, 64 x 1 x 1
// twin     src/twins/octree_resident.rs
// source   residency-octree-2023 section 5.3; coarser levels one after another, so that no order of
//          changes matters
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"

layout(local_size_x = CACHE_GROUP) in;

struct Places {
    uvec3 bricks;    // along each axis
    uint first;      // places of all finer levels
    uvec3 halvings;  // of level 0
    uint unused_0;
};

struct Change {
    uvec3 brick;
    uint level;
    uint first_word;  // of the channel
    uint there;       // 1: it came; 0: it went
    uint unused_0;
    uint unused_1;
};

layout(std430) readonly buffer places_of_levels { Places places_of_level[]; };
layout(std430) readonly buffer changes { Change change_of[]; };
layout(std430) coherent buffer resident { uint levels_at[]; };

// At most 32 changes for each lane: it remembers in a bit which have ended.
layout(push_constant) uniform Push {
    uint first_change;
    uint change_count;
    uint level_count;
} push;

uint word_of(Places places, uint first_word, uvec3 brick) {
    return first_word + places.first + (brick.z * places.bricks.y + brick.y) * places.bricks.x + brick.x;
}

// Makes a bit what it should be; whether it was the other.
bool turned(uint word, uint bit, bool there) {
    uint before = there ? atomicOr(levels_at[word], bit) : atomicAnd(levels_at[word], ~bit);
    return ((before & bit) != 0u) != there;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    // Its own place and all beneath: there it is the only brick of its level.
    for (uint index = 0u; index < push.change_count; ++index) {
        Change change = change_of[push.first_change + index];
        uvec3 halvings = places_of_level[change.level].halvings;
        for (uint level = 0u; level <= change.level; ++level) {
            Places places = places_of_level[level];
            uvec3 shift = halvings - places.halvings;
            uvec3 start = change.brick << shift;
            uvec3 size = min((change.brick + 1u) << shift, places.bricks) - start;
            uint count = size.x * size.y * size.z;
            for (uint at = lane; at < count; at += CACHE_GROUP) {
                uint row = at / size.x;
                uvec3 brick = start + uvec3(at % size.x, row % size.y, row / size.y);
                turned(word_of(places, change.first_word, brick), 1u << change.level, change.there != 0u);
            }
        }
    }
    // Upwards: a place has what any of its children has.
    uint ended = 0u;
    for (uint step = 1u; step < push.level_count; ++step) {
        memoryBarrierBuffer();
        barrier();
        uint turn = 0u;
        for (uint index = lane; index < push.change_count; index += CACHE_GROUP) {
            Change change = change_of[push.first_change + index];
            uint level = change.level + step;
            if (level < push.level_count && (ended >> turn & 1u) == 0u) {
                Places places = places_of_level[level];
                Places finer = places_of_level[level - 1u];
                uvec3 at = change.brick >> (places.halvings - places_of_level[change.level].halvings);
                uvec3 halved = places.halvings - finer.halvings;
                uvec3 start = at << halved;
                uvec3 end = min((at + 1u) << halved, finer.bricks);
                uint bit = 1u << change.level;
                uint some = 0u;
                for (uint z = start.z; z < end.z; ++z) {
                    for (uint y = start.y; y < end.y; ++y) {
                        for (uint x = start.x; x < end.x; ++x) {
                            some |= levels_at[word_of(finer, change.first_word, uvec3(x, y, z))] & bit;
                        }
                    }
                }
                bool other = turned(word_of(places, change.first_word, at), bit, some != 0u);
                ended |= other ? 0u : 1u << turn;
            }
            ++turn;
        }
    }
}
