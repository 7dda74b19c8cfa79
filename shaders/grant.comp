// grant.comp: gives slots to the host, least recently used first, and lists what it should load.
//
// reads    levels            [level]    ranks in this view, see common/ranks.glsl
//          progress          [number]   front of the rays
//          choice            [number]
//          chunk_counts      [chunk]    sums over all chunks before it
//          usage_order       [slot]     least recently used first
//          slot_used         [slot]     round in which a ray last used it
//          slot_needed       [slot]     round in which a waiting ray last needed it; exact refinement alone
// writes   usage_order_next  [slot]     the same after this round
//          grants            [grant]    slots for the host
//          requests          [request]  entry and rank of bricks to load, in the order of entries
// updates  page_table        [entry]    owners of granted slots are unmapped
//          slot_owner        [slot]     entry whose brick the slot holds
//          wished            [word]     one bit per entry; none afterwards
//          wish_weight       [entry]    what the brick would add; 0 afterwards; WEIGHTS alone
//          touched           [word]     one bit per entry that rays have used
//          answers           [atlas]    how many they have used for the first time
// shape    one thread per chunk of slots, then one per chunk of wishes, 64 x 1 x 1
// variants LEVELS; WEIGHTS: wishes are ranked by weight; SUBSTITUTE, PAPERS: slots by use alone
// twin     src/twins/grant.rs
// source   gpu-paging-2019 section 5.3: usage order by stream compaction; DESIGN section 5: grants
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/cache.glsl"
#include "common/ranks.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) readonly buffer progress { Progress round_progress; };
layout(std430) readonly buffer choice { Choice chosen; };
layout(std430) readonly buffer chunk_counts { ChunkCounts counts_of_chunk[]; };
layout(std430) readonly buffer usage_order { uint slot_of_order[]; };
layout(std430) writeonly buffer usage_order_next { uint slot_of_order_next[]; };
layout(std430) buffer page_table { uint entries[]; };
layout(std430) buffer slot_owner { uint owner_of_slot[]; };
layout(std430) buffer wished { uint wishes_in_word[]; };
#ifdef WEIGHTS
layout(std430) buffer wish_weight { uint weight_of_entry[]; };
#endif
layout(std430) buffer touched { uint touched_in_word[]; };
layout(std430) writeonly buffer grants { uint granted_slot[]; };
layout(std430) writeonly buffer requests { uvec2 entry_and_rank[]; };
layout(std430) buffer answers { Answer answer_of_atlas[]; };
layout(push_constant) uniform Push { CacheRound cache; } push;

#include "common/ranking.glsl"

void order_and_grant(CacheRound cache, uint chunk, ChunkCounts before, ChunkCounts all) {
    uint end = min((chunk + 1u) * CHUNK_SLOTS, cache.slot_count);
    for (uint index = chunk * CHUNK_SLOTS; index < end; ++index) {
        uint slot = slot_of_order[cache.slot_first + index];
        uint owner = owner_of_slot[slot];
        bool used = round_used[slot] == cache.round;
        uint place_in_order = used ? all.unused + index - before.unused : before.unused;
        before.unused += used ? 0u : 1u;
        slot_of_order_next[cache.slot_first + place_in_order] = slot;
        if (used && owner < OWNER_GRANTED) {
            uint bit = 1u << (owner & 31u);
            if ((atomicOr(touched_in_word[owner >> 5u], bit) & bit) == 0u) {
                atomicAdd(answer_of_atlas[cache.atlas].touched, 1u);
            }
        }

        uint rank = rank_of_slot(cache, slot, round_progress.front);
        uint grant = chosen.grants;
        if (rank == SLOT_DEAD) {
            grant = used ? all.dead_unused + before.dead_used : before.dead_unused;
            grant = grant < chosen.dead_grants ? grant : chosen.grants;
            before.dead_used += used ? 1u : 0u;
            before.dead_unused += used ? 0u : 1u;
        } else if (rank != SLOT_PROMISED && chosen.victim_cut != RANK_NONE) {
            if (rank > chosen.victim_cut) {
                grant = chosen.dead_grants + before.above;
                before.above += 1u;
            } else if (rank == chosen.victim_cut) {
                grant = chosen.dead_grants + all.above + before.at;
                before.at += 1u;
            }
        }
        if (grant < chosen.grants) {
            if (owner != OWNER_FREE) {
                entries[owner] = ENTRY_UNMAPPED << ENTRY_STATE_SHIFT;
            }
            owner_of_slot[slot] = OWNER_GRANTED;
            granted_slot[cache.grant_first + grant] = slot;
        }
    }
}

void list_requests(CacheRound cache, uint chunk, uint request) {
    uint start = chunk * CHUNK_WORDS;
    uint end = min(start + CHUNK_WORDS, cache.word_count);
    for (uint word = start; word < end; ++word) {
        for (uint bits = wishes_in_word[cache.word_first + word]; bits != 0u; bits &= bits - 1u) {
            uint entry = word * 32u + uint(findLSB(bits));
            uint rank = rank_of_wish(cache, entry);
            if (rank <= chosen.request_cut) {
                if (request < cache.requests_max) {
                    entry_and_rank[cache.request_first + request] =
                        uvec2(cache.entry_first + entry, rank);
                }
                request += 1u;
            }
#ifdef WEIGHTS
            weight_of_entry[cache.entry_first + entry] = 0u;
#endif
        }
        wishes_in_word[cache.word_first + word] = 0u;
    }
}

void main() {
    CacheRound cache = push.cache;
    uint chunk = gl_GlobalInvocationID.x;
    uint slot_chunks = chunks_of_slots(cache);
    uint chunks = slot_chunks + chunks_of_words(cache);
    if (chunk >= chunks) {
        return;
    }
    ChunkCounts before = counts_of_chunk[chunk];
    if (chunk < slot_chunks) {
        order_and_grant(cache, chunk, before, counts_of_chunk[chunks]);
    } else {
        list_requests(cache, chunk - slot_chunks, before.requests);
    }
}
