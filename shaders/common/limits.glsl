// limits.glsl: numbers that host and shaders share. The host reads them from this file.

// Samples between two anchors of a ray, see fixed_point.glsl: few enough that f32 holds a position
// inside a block to 32 * 2^-24 of the step's length.
#define BLOCK_SAMPLES 32u
// Samples of a ray whose voxels are waited for together, before any of them is composited. Two, since
// what a turn of the loop holds is as much as a core looks ahead.
#define SAMPLES_AT_ONCE 2u
// Rays of one workgroup along x and y. Eight lanes along x: lavapipe runs narrower groups slower.
#define GROUP_WIDTH 8
#define GROUP_HEIGHT 8
// Optical depth taken for opaque: exp(-87) is the smallest that f32 holds as a normal number.
#define OPAQUE_DEPTH 87.0

// States of a page-table entry, in its highest four bits; the rest is a slot or a constant's number.
#define ENTRY_UNMAPPED 0u
#define ENTRY_EXPECTED 1u  // unmapped, and a grant is bound to it
#define ENTRY_MAPPED 2u
#define ENTRY_CONSTANT 3u
#define ENTRY_HIDDEN 4u
#define ENTRY_ABSENT 5u
#define ENTRY_FAILED 6u
#define ENTRY_STATE_SHIFT 28u
#define ENTRY_PAYLOAD_MASK 0x0fffffffu

// Owner of a slot that holds no brick, and of one promised to the host for a copy.
#define OWNER_FREE 0xffffffffu
#define OWNER_GRANTED 0xfffffffeu
// Rank of a brick in a level that the view does not use: no ray can need it.
#define RANK_NONE 0xffffffffu
// Instead of a slot's rank: nobody needs it; the host has it.
#define SLOT_DEAD 0xffffffffu
#define SLOT_PROMISED 0xfffffffeu
// Slots, and words of 32 wishes, that one thread of tally, count and grant looks through.
#define CHUNK_SLOTS 32u
#define CHUNK_WORDS 32u
// Threads of the passes that manage the cache.
#define CACHE_GROUP 64
// Ranks of wishes in substitute refinement: four a doubling of their weight.
#define WEIGHT_RANKS 128u
// Place of a ray that has ended, and of one on its way.
#define PLACE_ENDED 0xffffffffu
#define PLACE_RUNNING 0xfffffffeu
