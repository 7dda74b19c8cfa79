// choose.comp: how many slots of an atlas are granted, and up to which ranks.
//
// updates  wishes_of_rank  [rank]    counted by tally; all 0 again afterwards
//          live_of_rank    [rank]    the same
//          tallies         [number]  the same
// writes   choice          [number]
//          answers         [atlas]   what the host is told
// shape    one workgroup for all ranks, 64 x 1 x 1
// twin     src/twins/choose.rs
// source   DESIGN section 5: the guard
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"
#include "common/cache.glsl"

layout(local_size_x = CACHE_GROUP) in;

layout(std430) buffer wishes_of_rank { uint wishes_of[]; };
layout(std430) buffer live_of_rank { uint live_of[]; };
layout(std430) buffer tallies { Tallies tally; };
layout(std430) writeonly buffer choice { Choice chosen; };
layout(std430) writeonly buffer answers { Answer answer_of_atlas[]; };
layout(push_constant) uniform Push { CacheRound cache; } push;

shared uint wishes_of_lane[CACHE_GROUP];
shared uint live_of_lane[CACHE_GROUP];
shared uint first_rank;       // least rank of a wish
shared uint first_wishes;     // wishes of that rank
shared uint live_above_first;
shared uint request_cut;
shared uint victim_cut;

void main() {
    CacheRound cache = push.cache;
    uint lane = gl_LocalInvocationID.x;
    uint ranks_of_lane = (cache.ranks + CACHE_GROUP - 1u) / CACHE_GROUP;
    uint start = min(lane * ranks_of_lane, cache.ranks);
    uint end = min(start + ranks_of_lane, cache.ranks);
    uint wishes = 0u;
    uint live = 0u;
    for (uint rank = start; rank < end; ++rank) {
        wishes += wishes_of[rank];
        live += live_of[rank];
    }
    wishes_of_lane[lane] = wishes;
    live_of_lane[lane] = live;
    if (lane == 0u) {
        first_rank = RANK_NONE;
        first_wishes = 0u;
        live_above_first = 0u;
        request_cut = 0u;
        victim_cut = 0u;
    }
    barrier();
    uint wishes_before = 0u;
    uint live_before = 0u;
    for (uint other = 0u; other < lane; ++other) {
        wishes_before += wishes_of_lane[other];
        live_before += live_of_lane[other];
    }
    // Requests in whole ranks, as many as the list holds.
    uint wishes_up_to = wishes_before;
    uint live_up_to = live_before;
    for (uint rank = start; rank < end; ++rank) {
        bool first = wishes_up_to == 0u && wishes_of[rank] != 0u;
        wishes_up_to += wishes_of[rank];
        live_up_to += live_of[rank];
        if (first) {
            first_rank = rank;
            first_wishes = wishes_of[rank];
            live_above_first = tally.live - live_up_to;
        }
        if (first || wishes_up_to <= cache.requests_max) {
            atomicMax(request_cut, rank);
        }
    }
    barrier();
    // Wishes of the first rank may take slots of later ranks; others only slots that nobody needs,
    // and of those not so many that the next first rank would have to take them back.
    uint dead = tally.dead;
    uint nearest = min(first_wishes - min(first_wishes, cache.held), dead + live_above_first);
    uint wanted = tally.wished - min(tally.wished, cache.held);
    uint room = cache.live_max > tally.live ? min(dead, cache.live_max - tally.live) : 0u;
    uint grants = min(max(nearest, min(wanted, room)), cache.grants_max);
    uint dead_grants = min(grants, dead);
    uint live_grants = grants - dead_grants;
    // From the farthest rank on, until there are enough.
    uint live_from = tally.live - live_before;
    if (live_grants > 0u) {
        for (uint rank = start; rank < end; ++rank) {
            if (live_from >= live_grants) {
                atomicMax(victim_cut, rank);
            }
            live_from -= live_of[rank];
        }
    }
    barrier();
    if (lane == 0u) {
        chosen = Choice(grants, dead_grants, request_cut, live_grants > 0u ? victim_cut : RANK_NONE);
        answer_of_atlas[cache.atlas] = Answer(
            tally.wished, first_rank, first_wishes, dead, tally.live, grants, 0u, 0u);
    }
    barrier();
    for (uint rank = start; rank < end; ++rank) {
        wishes_of[rank] = 0u;
        live_of[rank] = 0u;
    }
    if (lane == 0u) {
        tally = Tallies(0u, 0u, 0u, 0u);
    }
}
