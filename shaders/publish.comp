// publish.comp: begins a round: bricks that arrived become visible in the page table, and so do
// bricks that never travel.
//
// reads    updates     [update]  what the host learned since the last round
// writes   progress    [number]  this round's counts, all at their start
// updates  page_table  [entry]   state and slot
//          slot_owner  [slot]    entry whose brick the slot holds
// shape    one thread per update, and at least one, 64 x 1 x 1
// twin     src/twins/publish.rs
// source   DESIGN section 5
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/cache.glsl"

layout(local_size_x = CACHE_GROUP) in;

struct Update {
    uint entry;
    uint value;   // of the entry from now on
    uint slot;    // that changes its owner; OWNER_FREE: none
    uint owner;   // of that slot from now on
};

layout(std430) readonly buffer updates { Update update_of_host[]; };
layout(std430) buffer page_table { uint entries[]; };
layout(std430) buffer slot_owner { uint owner_of_slot[]; };
layout(std430) writeonly buffer progress { Progress round_progress; };

layout(push_constant) uniform Push { uint update_count; } push;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index == 0u) {
        round_progress = Progress(RANK_NONE, 0u, 0u, 0u);
    }
    if (index >= push.update_count) {
        return;
    }
    Update update = update_of_host[index];
    if (update.entry != OWNER_FREE) {
        entries[update.entry] = update.value;
    }
    if (update.slot != OWNER_FREE) {
        owner_of_slot[update.slot] = update.owner;
    }
}
