// ray_block.glsl: where a ray stands between two samples of a block. twin: src/twins/ray_block.rs

struct RayBlock {
    vec3 color;         // of the block so far, see common/classify.glsl
    float depth;
    float transmitted;
    uint sample_index;  // in the block
    uint level;
    uint met;           // pending, failed, absent: bits of what the ray met
};

// Nothing marched yet.
RayBlock fresh_block(uint level) {
    return RayBlock(vec3(0.0), 0.0, 1.0, 0u, level, 0u);
}

// What a ray met, for pictures of states.
#define MET_PENDING 1u
#define MET_FAILED 2u
#define MET_ABSENT 4u
#define MET_STATES 7u
// From this bit on: channels whose bricks a ray waits for, where that is not all of them.
#define MET_CHANNELS_SHIFT 3u

// Half of the colour and half of the state's: absent grey, pending blue, failed orange, the graver one
// where there are several. Told apart in every common kind of colour blindness.
vec4 tinted(vec4 color, uint met, bool waits) {
    vec3 tint = vec3(0.5);
    tint = waits || (met & MET_PENDING) != 0u ? vec3(0.0, 0.17, 0.45) : tint;
    tint = (met & MET_FAILED) != 0u ? vec3(0.8, 0.22, 0.0) : tint;
    return (met & MET_STATES) != 0u || waits ? vec4(mix(color.rgb, tint, 0.5), max(color.a, 0.5)) : color;
}
