// octree.glsl: which channels show something around a voxel, and in how large a box that is all.
// twin: src/twins/octree.rs
//
// binds    level_leaves  [level]  where the leaves of a level lie
//          leaf_words    [word]   channels that show, and how far up; WORD_BITS each
// spaces   voxels of the level, corner origin
// variants LEAF: voxels along the edges of a leaf of level 0; WORD_BITS: 8, 16 or 32;
//          CLOSED_FORM: boxes say whether they have one value
// source   residency-octree-2023 section 6.1 and figure 8; docs/OCTREE.md
struct LevelLeaves {
    uvec3 leaves;       // along each axis
    uint first_word;
    uvec3 shift;        // how often LEAF is doubled along the edges of the level's leaves
    uint unused_0;
    uvec3 rises;        // from bit 3 * rise on: how often a leaf's edge is doubled in a word's box
    uint unused_1;
    uvec3 brick_shift;  // and in a brick
    uint unused_2;
};

layout(std140) uniform level_leaves { LevelLeaves leaves_of_level[LEVELS]; };
layout(std430) readonly buffer leaf_words { uint packed_words[]; };

#define WORD_CHANNELS (WORD_BITS - 4)

struct Box {
    uint shows;   // bits of the channels that show something
#ifdef CLOSED_FORM
    bool alike;   // each of them has one value
#endif
    ivec3 first;  // voxel
    ivec3 edge;   // voxels along each axis
};

// Where some channel shows something, the box lies in one brick.
Box box_around(LevelLeaves of_level, ivec3 voxel) {
    uvec3 edge = uvec3(LEAF) << of_level.shift;
    uvec3 leaf = min((uvec3(max(voxel, ivec3(0))) / uvec3(LEAF)) >> of_level.shift, of_level.leaves - 1u);
    uint index = of_level.first_word
        + (leaf.z * of_level.leaves.y + leaf.y) * of_level.leaves.x + leaf.x;
#if WORD_BITS == 32
    uint word = packed_words[index];
#else
    uint word = packed_words[index / (32u / WORD_BITS)] >> (index % (32u / WORD_BITS) * WORD_BITS);
    word &= (1u << WORD_BITS) - 1u;
#endif
    uint rise = word >> (WORD_CHANNELS + 1);
    Box box;
    box.shows = word & ((1u << WORD_CHANNELS) - 1u);
#ifdef CLOSED_FORM
    box.alike = (word & (1u << WORD_CHANNELS)) != 0u;
#endif
    uvec3 shift = (of_level.rises >> (3u * rise)) & 7u;
    shift = box.shows == 0u ? shift : min(shift, of_level.brick_shift);
    box.first = ivec3(((leaf >> shift) << shift) * edge);
    box.edge = ivec3(edge << shift);
    return box;
}
