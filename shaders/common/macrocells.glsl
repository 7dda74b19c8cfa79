// macrocells.glsl: which samples of a block show something, and how long their steps may be.
// twin: src/twins/macrocells.rs
//
// binds    macrocells  [image]  a code for each box of 4 x 4 x 4 cells: 1 to 16, nothing is seen in
//                               macrocells less than that many away; from 128 on something is
// variants ADAPTIVE: codes say by how much a step may be longer than the finest
// source   macrocells with value ranges (Parker and others 1999); distances to what shows (Zuiderveld,
//          Koning, Viergever 1992)
uniform sampler3D macrocells;

#define CODE_SHOWS 128u
// Boxes are made smaller by this on all sides, so that rounding puts no sample into the wrong one.
#define BORDER_VOXEL 1.0e-4

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

// Bits from `from` up to but not `to`.
uint bits_between(uint from, uint to) {
    uint below = to < 32u ? (1u << to) - 1u : 0xffffffffu;
    uint left_out = from < 32u ? (1u << from) - 1u : 0xffffffffu;
    return below & ~left_out;
}

#ifdef ADAPTIVE
#define CODES_OF_OCTAVE 8u
// Half of the octaves by which a unit of optical depth hides what comes behind it.
#define CODES_OF_DEPTH 5.77078
#define OCTAVES_MAX 5u
// Where steps of an octave may start.
const uint ALIGNED[OCTAVES_MAX] = uint[](0x55555555u, 0x11111111u, 0x01010101u, 0x00010001u, 1u);

// By how many octaves a step may be longer than the finest.
uint octaves_of(uint code, float depth) {
    float eighths = float(code - CODE_SHOWS) + depth * CODES_OF_DEPTH;
    return min(uint(min(eighths, 1.0e3)) / CODES_OF_OCTAVE, OCTAVES_MAX);
}

uint bit_of(uint bits, uint index) {
    return (bits >> index) & 1u;
}

// Samples of a block: each stands for 2^octave steps from where it starts.
struct Steps {
    uint starts;
    uint octave_bits[3];  // bit by bit, where they start
};

// The longest aligned steps whose every part allows them (`may`, by octave from 1), of those in which
// something shows.
Steps longest_steps(uint samples, uint shown, uint may[OCTAVES_MAX]) {
    Steps steps = Steps(0u, uint[3](0u, 0u, 0u));
    uint left = bits_between(0u, samples);
    [[unroll]] for (uint octave = OCTAVES_MAX; octave >= 1u; --octave) {
        uint whole = may[octave - 1u] & left;
        uint seen = shown;
        [[unroll]] for (uint halving = 0u; halving < octave; ++halving) {
            uint half_way = 1u << halving;
            whole &= whole >> half_way;
            seen |= seen >> half_way;
        }
        whole &= ALIGNED[octave - 1u];
        left &= ~(whole * (0xffffffffu >> (32u - (1u << octave))));
        seen &= whole;
        steps.starts |= seen;
        steps.octave_bits[0] |= (octave & 1u) != 0u ? seen : 0u;
        steps.octave_bits[1] |= (octave & 2u) != 0u ? seen : 0u;
        steps.octave_bits[2] |= (octave & 4u) != 0u ? seen : 0u;
    }
    steps.starts |= left & shown;
    return steps;
}
#endif
