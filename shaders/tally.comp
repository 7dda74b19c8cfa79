// tally.comp: how many slots and wishes of an atlas there are of each rank.
//
// reads    levels          [level]   ranks in this view, see common/ranks.glsl
//          progress        [number]  front of the rays
//          slot_owner      [slot]    entry whose brick the slot holds
//          slot_used       [slot]    round in which a ray last used it
//          slot_needed     [slot]    round in which a waiting ray last needed it; exact refinement alone
//          wished          [word]    one bit per entry
//          wish_weight     [entry]   what the brick would add; WEIGHTS alone
// updates  wishes_of_rank  [rank]
//          live_of_rank    [rank]    slots that may be needed again
//          tallies         [number]
// shape    one thread per chunk of slots, then one per chunk of wishes, 64 x 1 x 1
// variants LEVELS; WEIGHTS: wishes are ranked by weight; SUBSTITUTE, PAPERS: slots by use alone
// twin     src/twins/tally.rs
// source   gpu-paging-2019 section 5.2 counts requests by stream compaction; ranks as common/ranks.glsl
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/cache.glsl"
#include "common/ranks.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) readonly buffer progress { Progress round_progress; };
layout(std430) buffer wishes_of_rank { uint wishes_of[]; };
layout(std430) buffer live_of_rank { uint live_of[]; };
layout(std430) buffer tallies { Tallies tally; };
layout(std430) readonly buffer slot_owner { uint owner_of_slot[]; };
layout(std430) readonly buffer wished { uint wishes_in_word[]; };
#ifdef WEIGHTS
layout(std430) readonly buffer wish_weight { uint weight_of_entry[]; };
#endif
layout(push_constant) uniform Push { CacheRound cache; } push;

#include "common/ranking.glsl"

void main() {
    CacheRound cache = push.cache;
    uint chunk = gl_GlobalInvocationID.x;
    uint slot_chunks = chunks_of_slots(cache);
    if (chunk < slot_chunks) {
        uint dead = 0u;
        uint live = 0u;
        uint end = min((chunk + 1u) * CHUNK_SLOTS, cache.slot_count);
        for (uint index = chunk * CHUNK_SLOTS; index < end; ++index) {
            uint rank = rank_of_slot(cache, cache.slot_first + index, round_progress.front);
            if (rank == SLOT_DEAD) {
                dead += 1u;
            } else if (rank != SLOT_PROMISED) {
                live += 1u;
                atomicAdd(live_of[rank], 1u);
            }
        }
        atomicAdd(tally.dead, dead);
        atomicAdd(tally.live, live);
    } else if (chunk - slot_chunks < chunks_of_words(cache)) {
        uint wishes = 0u;
        uint start = (chunk - slot_chunks) * CHUNK_WORDS;
        uint end = min(start + CHUNK_WORDS, cache.word_count);
        for (uint word = start; word < end; ++word) {
            for (uint bits = wishes_in_word[cache.word_first + word]; bits != 0u; bits &= bits - 1u) {
                uint rank = rank_of_wish(cache, word * 32u + uint(findLSB(bits)));
                if (rank < cache.ranks) {
                    wishes += 1u;
                    atomicAdd(wishes_of[rank], 1u);
                }
            }
        }
        atomicAdd(tally.wished, wishes);
    }
}
