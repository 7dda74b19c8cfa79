// scan.comp: from what each chunk adds to where each chunk begins.
//
// updates  chunk_counts  [chunk]   sums over all chunks before it; one more at the end: all
//          answers       [atlas]   how many requests are listed
// shape    one workgroup for all chunks, 64 x 1 x 1
// twin     src/twins/scan.rs
// source   stream compaction as in gpu-paging-2019 section 5.3: count, scan, write
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/cache.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) buffer chunk_counts { ChunkCounts counts_of_chunk[]; };
layout(std430) buffer answers { Answer answer_of_atlas[]; };
layout(push_constant) uniform Push { CacheRound cache; } push;

shared ChunkCounts counts_of_lane[CACHE_GROUP];

ChunkCounts sum(ChunkCounts a, ChunkCounts b) {
    return ChunkCounts(
        a.unused + b.unused,
        a.dead_unused + b.dead_unused,
        a.dead_used + b.dead_used,
        a.above + b.above,
        a.at + b.at,
        a.requests + b.requests,
        0u,
        0u
    );
}

void main() {
    CacheRound cache = push.cache;
    uint lane = gl_LocalInvocationID.x;
    uint chunks = chunks_of_slots(cache) + chunks_of_words(cache);
    uint chunks_of_lane = (chunks + CACHE_GROUP - 1u) / CACHE_GROUP;
    uint start = min(lane * chunks_of_lane, chunks);
    uint end = min(start + chunks_of_lane, chunks);
    ChunkCounts total = ChunkCounts(0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    for (uint chunk = start; chunk < end; ++chunk) {
        total = sum(total, counts_of_chunk[chunk]);
    }
    counts_of_lane[lane] = total;
    barrier();
    ChunkCounts before = ChunkCounts(0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    for (uint other = 0u; other < lane; ++other) {
        before = sum(before, counts_of_lane[other]);
    }
    for (uint chunk = start; chunk < end; ++chunk) {
        ChunkCounts here = counts_of_chunk[chunk];
        counts_of_chunk[chunk] = before;
        before = sum(before, here);
    }
    if (lane == CACHE_GROUP - 1u) {
        counts_of_chunk[chunks] = before;
        answer_of_atlas[cache.atlas].requests = min(before.requests, cache.requests_max);
    }
}
