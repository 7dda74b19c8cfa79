// ranks.glsl: the order in which bricks of a view are needed. twin: src/twins/ranks.rs
//
// binds    levels  [level]  grid, ray parameters and ranks of every level in a view
// variants LEVELS: how many levels the volume has
//
// Along any ray, brick coordinates move away from the eye's and levels only get coarser: so the
// number of bricks between a brick and the eye's, summed over the axes, grows with every border that
// the ray crosses. That number is the rank: a brick can be needed by no ray that is past its rank.

struct LevelView {
    dvec4 per_scale_step;  // xyz: 1 / level-0 voxels a voxel spans; w: greatest distance of two samples, world units
    dvec2 depth;           // ray parameters between which the level is in use
    uvec3 halvings;        // of level 0 that lead to the level, along each axis
    uint held;             // 1: bricks of the level are never given up; substitute refinement alone
    uvec3 bricks;          // along each axis
    uint first_place;
    ivec3 eye_brick;       // nearest to the eye
    uint rank_first;       // of that brick; RANK_NONE where the level is not in use
};

layout(std140) uniform levels { LevelView level_views[LEVELS]; };

uint level_of_place(uint place) {
    uint level = 0u;
    [[unroll]] for (uint coarser = 1u; coarser < LEVELS; ++coarser) {
        level = place >= level_views[coarser].first_place ? coarser : level;
    }
    return level;
}

uint rank_of_brick(uint level, ivec3 brick) {
    uvec3 away = uvec3(abs(brick - level_views[level].eye_brick));
    uint first = level_views[level].rank_first;
    return first == RANK_NONE ? RANK_NONE : first + away.x + away.y + away.z;
}

ivec3 brick_of_place(uint level, uint place) {
    uvec3 bricks = level_views[level].bricks;
    uint within = place - level_views[level].first_place;
    uint row = within / bricks.x;
    return ivec3(within % bricks.x, row % bricks.y, row / bricks.y);
}

uint rank_of_place(uint place) {
    uint level = level_of_place(place);
    return rank_of_brick(level, brick_of_place(level, place));
}
