// march_bricks.comp: moves every ray of a tile on through the bricks that are there, until it ends, waits
// for a brick, or has used up its steps.
//
// reads    views         [view]     the view's rays, linear in the pixel, f64; several levels alone
//          levels        [level]    grid, ray parameters and ranks of every level in the view
//          transfer      [segment]  transfer functions of all channels, one after another
//          page_table    [entry]    state and slot
//          constants     [number]   texels of bricks of one value
//          atlases       [image]    slots, one image per texel format
//          level_leaves  [level]    where leaves lie; OCTREE alone
//          leaf_words    [word]     which channels show something around a leaf; OCTREE alone
// writes   slot_used     [slot]     round in which a ray last used it
//          slot_needed   [slot]     round in which a waiting ray last needed it; exact refinement alone
// updates  ray_geometry  [ray]      fixed-point start and step in the level in use
//          ray_state     [ray]      position, optical depth, colour
//          ray_block     [ray]      the block of samples that the ray is in
//          ray_place     [ray]      where it waits
//          wished        [word]     one bit per entry
//          wish_weight   [entry]    what the brick would add; WEIGHTS alone
//          progress      [number]   front of the rays, and how many wait
// shape    one thread per ray of the tile, 8 x 8 x 1
// spaces   as common/brick_march.glsl
// variants SEVERAL_LEVELS: a ray goes from level to level as its footprint grows, VIEWS;
//          as common/brick_march.glsl
// twin     src/twins/march_bricks.rs
// source   DESIGN section 5; gpu-paging-2019 section 5.2 for marks and requests
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/limits.glsl"
#include "common/ray.glsl"
#include "common/ray_block.glsl"
#include "common/cache.glsl"
#ifdef SEVERAL_LEVELS
#include "common/ray_setup.glsl"
#endif
#include "common/brick_march.glsl"

layout(local_size_x = GROUP_WIDTH, local_size_y = GROUP_HEIGHT) in;

#ifdef SEVERAL_LEVELS
layout(std140) uniform views { ViewRays view_rays[VIEWS]; };
#endif
layout(std430) buffer ray_geometry { RayGeometry geometry_of_ray[]; };
layout(std430) buffer ray_state { RayState state_of_ray[]; };
layout(std430) buffer ray_block { RayBlock block_of_ray[]; };
layout(std430) buffer ray_place { uint place_of_ray[]; };
layout(std430) buffer progress { Progress round_progress; };

layout(push_constant) uniform Push {
    TileShape tile;
    uvec3 volume_size;
    uint view;
    uint blocks_max;   // blocks of samples in this dispatch
    float early_stop;  // a ray ends when less than this is transmitted
    uint round;        // counts from 1
    uint last;         // 1: the round's last dispatch, which says where rays wait
} push;

#if defined(ANCESTORS)
// The coarsest that is not there, and no other.
#define MARK(BIT, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST) \
    if ((channels & BIT) != 0u) { \
        bool waits_for = false; \
        for (uint at = 0u; at < LEVELS - level && !waits_for; ++at) { \
            uint entry = ENTRY_FIRST + place_around(level, LEVELS - 1u - at, brick) * CHANNELS + CHANNEL; \
            waits_for = mark(push.round, entry, SLOT_FIRST); \
        } \
        waits = waits_for || waits; \
    }
#elif defined(SUBSTITUTE)
#define MARK(BIT, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST)
#elif defined(OCTREE)
#define MARK(BIT, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST) \
    if ((channels & BIT) != 0u) { \
        waits = mark(push.round, ENTRY_FIRST + place * CHANNELS + CHANNEL, SLOT_FIRST) || waits; \
    }
#else
#define MARK(BIT, ENTRY_FIRST, CHANNELS, CHANNEL, SLOT_FIRST) \
    waits = mark(push.round, ENTRY_FIRST + place * CHANNELS + CHANNEL, SLOT_FIRST) || waits;
#endif

// A ray waits at `place` for bricks of these `channels`: its wishes, and what it needs beside them. False
// where all is there.
bool mark_place(uint place, uint channels) {
    bool waits = false;
#ifdef ANCESTORS
    uint level = level_of_place(place);
    ivec3 brick = brick_of_place(level, place);
#endif
    MARK_CHANNELS
    return waits;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.tile.size_pixel))) {
        return;
    }
    uint ray = pixel.y * push.tile.size_pixel.x + pixel.x;
    uint place = place_of_ray[ray];
    if (place == PLACE_ENDED) {
#ifdef SUBSTITUTE
        // It ended in an earlier dispatch of the round.
        if (push.last != 0u && (block_of_ray[ray].met & MET_PENDING) != 0u) {
            atomicAdd(round_progress.waiting, 1u);
        }
#endif
        return;
    }
    RayBlock partial = block_of_ray[ray];
    bool waits = place != PLACE_RUNNING;
    if (waits) {
        waits = mark_place(place, partial.met >> MET_CHANNELS_SHIFT);
    }
    // A loop of one turn: with an `if` around march_bricks lavapipe (Mesa 22.3.6) draws a wrong picture.
    for (bool go = !waits; go; go = false) {
        RayGeometry geometry = geometry_of_ray[ray];
        RayState state = state_of_ray[ray];
        place = PLACE_RUNNING;
        bool ended = false;
        uint blocks_left = push.blocks_max;
#ifdef SEVERAL_LEVELS
        bool more = true;
        for (uint levels = 0u; levels < LEVELS && more; ++levels) {
#endif
            march_bricks(geometry, state, partial, place, push.round, blocks_left, push.early_stop);
            ended = state.next_sample >= geometry.sample_count;
#ifdef SEVERAL_LEVELS
            more = ended && partial.level + 1u < LEVELS;
            if (more) {
                partial.level += 1u;
                LevelView in_level = level_views[partial.level];
                geometry = set_up_ray_within(
                    view_rays[push.view], push.tile.origin_pixel + pixel, push.volume_size,
                    in_level.per_scale_step.w, in_level.depth, in_level.per_scale_step.xyz);
                geometry_of_ray[ray] = geometry;
                state.next_sample = 0u;
            }
            place = ended && !more ? PLACE_ENDED : place;
        }
#else
        place = ended ? PLACE_ENDED : place;
#endif
        state_of_ray[ray] = state;
        block_of_ray[ray] = partial;
        atomicAdd(round_progress.moved, 1u);
        waits = place < PLACE_RUNNING;
        if (waits) {
            mark_place(place, partial.met >> MET_CHANNELS_SHIFT);
        }
    }
    place_of_ray[ray] = place;
    bool all_ended = place == PLACE_ENDED;
#ifdef SUBSTITUTE
    bool counted = all_ended && (partial.met & MET_PENDING) != 0u;
#else
    bool counted = waits;
#endif
    if (push.last != 0u && (counted || !all_ended)) {
#ifndef SUBSTITUTE
        uint rank = place < PLACE_RUNNING ? rank_of_place(place) : 0u;
        atomicMin(round_progress.front, rank);
#endif
        if (counted) {
            atomicAdd(round_progress.waiting, 1u);
        } else {
            atomicAdd(round_progress.running, 1u);
        }
    }
}
