// count.comp: what each chunk of slots and wishes adds to the lists that grant writes.
//
// reads    levels        [level]   ranks in this view, see common/ranks.glsl
//          progress      [number]  front of the rays
//          choice        [number]
//          usage_order   [slot]    least recently used first
//          slot_owner    [slot]    entry whose brick the slot holds
//          slot_used     [slot]    round in which a ray last used it
//          slot_needed   [slot]    round in which a waiting ray last needed it; exact refinement alone
//          wished        [word]    one bit per entry
//          wish_weight   [entry]   what the brick would add; WEIGHTS alone
// writes   chunk_counts  [chunk]   of slots, then of wishes
// shape    one thread per chunk of slots, then one per chunk of wishes, 64 x 1 x 1
// variants LEVELS; WEIGHTS: wishes are ranked by weight; SUBSTITUTE, PAPERS: slots by use alone
// twin     src/twins/count.rs
// source   stream compaction as in gpu-paging-2019 section 5.3: count, scan, write
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/cache.glsl"
#include "common/ranks.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) readonly buffer progress { Progress round_progress; };
layout(std430) readonly buffer choice { Choice chosen; };
layout(std430) readonly buffer usage_order { uint slot_of_order[]; };
layout(std430) writeonly buffer chunk_counts { ChunkCounts counts_of_chunk[]; };
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
    ChunkCounts counts = ChunkCounts(0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    if (chunk >= slot_chunks + chunks_of_words(cache)) {
        return;
    }
    if (chunk < slot_chunks) {
        uint end = min((chunk + 1u) * CHUNK_SLOTS, cache.slot_count);
        for (uint index = chunk * CHUNK_SLOTS; index < end; ++index) {
            uint slot = slot_of_order[cache.slot_first + index];
            bool used = round_used[slot] == cache.round;
            counts.unused += used ? 0u : 1u;
            uint rank = rank_of_slot(cache, slot, round_progress.front);
            if (rank == SLOT_DEAD) {
                counts.dead_unused += used ? 0u : 1u;
                counts.dead_used += used ? 1u : 0u;
            } else if (rank != SLOT_PROMISED && chosen.victim_cut != RANK_NONE) {
                counts.above += rank > chosen.victim_cut ? 1u : 0u;
                counts.at += rank == chosen.victim_cut ? 1u : 0u;
            }
        }
    } else {
        uint start = (chunk - slot_chunks) * CHUNK_WORDS;
        uint end = min(start + CHUNK_WORDS, cache.word_count);
        for (uint word = start; word < end; ++word) {
            for (uint bits = wishes_in_word[cache.word_first + word]; bits != 0u; bits &= bits - 1u) {
                uint rank = rank_of_wish(cache, word * 32u + uint(findLSB(bits)));
                counts.requests += rank <= chosen.request_cut ? 1u : 0u;
            }
        }
    }
    counts_of_chunk[chunk] = counts;
}
