// macrocells.glsl: which samples of a block show something, and how long their steps may be.
// twin: src/twins/macrocells.rs
//
// binds    macrocells  [image]  a code for each box of 4 x 4 x 4 cells: 1 to 16, nothing is seen in
//                               macrocells less than that many away; from 128 on something is
// variants ADAPTIVE: codes say by how much a step may be longer than the finest
// source   macrocells with value ranges (Parker and others 1999); distances to what shows (Zuiderveld,
//          Koning, Viergever 1992)
#include "common/bits.glsl"

uniform sampler3D macrocells;

#define CODE_SHOWS 128u
// Boxes are made smaller by this on all sides, so that rounding puts no sample into the wrong one.
#define BORDER_VOXEL 1.0e-3

struct Macrocell {
    uint code;
    uint points;  // how many, from this one on, lie in the box that the code speaks of
};

// Of the cell around `position`, voxels from the anchor. Points are `per_voxel` voxels to the power of -1
// apart along each axis, 0 where they stand still.
Macrocell macrocell_at(vec3 position, vec3 per_voxel, ivec3 anchor_cell) {
    ivec3 corner = anchor_cell + ivec3(floor(position)) + 1;
    ivec3 at = clamp(corner >> 2, ivec3(0), textureSize(macrocells, 0) - 1);
    uint code = uint(texelFetch(macrocells, at, 0).r * 255.0 + 0.5);
    int reach = code < CODE_SHOWS ? int(code) - 1 : 0;
    ivec3 first = (at - reach) * 4 - 1 - anchor_cell;
    vec3 near = vec3(first) + BORDER_VOXEL;
    vec3 far = vec3(first + (2 * reach + 1) * 4) - BORDER_VOXEL;
    vec3 ahead = mix(near, far, greaterThan(per_voxel, vec3(0.0)));
    vec3 still = vec3(equal(per_voxel, vec3(0.0)));
    vec3 count = (ahead - position) * per_voxel + still * 1.0e9;
    float last = clamp(min(min(count.x, count.y), count.z), 0.0, 1.0e6);
    return Macrocell(code, uint(last) + 1u);
}

#ifdef ADAPTIVE
#define CODES_OF_LEVEL 8u
// Half of the octaves by which a unit of optical depth hides what comes behind it.
#define LEVELS_OF_DEPTH 0.7213475
// Levels of step, each twice the one before. One is a whole interval long; above it, intervals are joined.
#define LEVEL_WHOLE 5u
#define LEVEL_MAX 7u

uint level_of(uint code, float depth) {
    float level = float(code - CODE_SHOWS) / float(CODES_OF_LEVEL) + depth * LEVELS_OF_DEPTH;
    return uint(min(level, float(LEVEL_MAX)));
}

float length_of(uint level) {
    return uintBitsToFloat((level + 127u - LEVEL_WHOLE) << 23u);
}

// Intervals of a block in which something shows, by where samples start.
struct Steps {
    uint starts;
    uint level_bits[3];  // of the interval that starts there, bit by bit
};

uint level_at(Steps steps, uint index) {
    uvec3 bits = (uvec3(steps.level_bits[0], steps.level_bits[1], steps.level_bits[2]) >> index) & 1u;
    return bits.x + 2u * bits.y + 4u * bits.z;
}

// `below` holds for each level but the last the intervals some point of which allows no more.
Steps joined_steps(uint shown, uint below[LEVEL_MAX]) {
    // From bits that stand for all levels beneath to binary numbers.
    uint at_least_6 = ~below[5];
    uint at_least_7 = ~below[6];
    // Four aligned intervals, two of them.
    uint fours = at_least_7 & (at_least_7 >> 1u);
    fours &= (fours >> 2u) & 0x11111111u;
    uint in_fours = fours * 15u;
    uint twos = at_least_6 & (at_least_6 >> 1u) & 0x55555555u & ~in_fours;
    uint seen_by_two = shown | (shown >> 1u);
    uint seen_by_four = seen_by_two | (seen_by_two >> 2u);
    uint singles = ~(in_fours | twos * 3u);
    Steps steps;
    steps.starts = (shown & singles) | (twos & seen_by_two) | (fours & seen_by_four);
    uint at_least_4 = ~below[3];
    uint joined = fours | twos;
    steps.level_bits[2] = at_least_4 | joined;
    // 2, 3, 6 and 7; of single intervals none is above 5.
    steps.level_bits[1] = joined | (~below[1] & ~at_least_4 & singles);
    // 1, 3, 5 and 7.
    uint odd = (~below[0] & below[1]) | (~below[2] & below[3]) | ~below[4];
    steps.level_bits[0] = fours | (odd & singles);
    return steps;
}
#endif
