// forget.comp: what stands in the entries of one channel of an atlas is forgotten: another channel has its
// place from now on, or another transfer function says what shows.
//
// updates  page_table  [entry]  the channel's are unmapped; with push.keep those alone that have no slot
//          slot_owner  [slot]   slots of the channel's bricks are nobody's; none with push.keep
// writes   slot_used   [slot]   the round, where another brick is, and not where none is any more: so
//                               that free slots are given away first
// shape    one thread per place and one per slot of the atlas, whichever are more, 64 x 1 x 1
// twin     src/twins/forget.rs
// source   residency-octree-2023 section 4.1 shows m of n channels; docs/OCTREE.md
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) buffer page_table { uint entries[]; };
layout(std430) buffer slot_owner { uint owner_of_slot[]; };
layout(std430) writeonly buffer slot_used { uint round_used[]; };

layout(push_constant) uniform Push {
    uint entry_first;  // of the atlas
    uint channels;     // of the atlas
    uint channel;      // counts within the atlas
    uint places;
    uint slot_first;   // of the atlas
    uint slot_count;
    uint keep;         // 1: the same voxels as before, bricks that are there stay
    uint round;        // counts from 1
} push;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index < push.places) {
        uint entry = push.entry_first + index * push.channels + push.channel;
        bool stays = push.keep != 0u && entries[entry] >> ENTRY_STATE_SHIFT == ENTRY_MAPPED;
        if (!stays) {
            entries[entry] = ENTRY_UNMAPPED << ENTRY_STATE_SHIFT;
        }
    }
    if (index < push.slot_count && push.keep == 0u) {
        uint slot = push.slot_first + index;
        uint owner = owner_of_slot[slot];
        if (owner < OWNER_GRANTED) {
            bool forgotten = (owner - push.entry_first) % push.channels == push.channel;
            owner_of_slot[slot] = forgotten ? OWNER_FREE : owner;
            round_used[slot] = forgotten ? 0u : push.round;
        }
    }
}
