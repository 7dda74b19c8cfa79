// place.comp: puts bricks that lie in the upload buffer into their slots.
//
// reads    upload      [word]   texels, tightly packed, each brick from a multiple of 16 bytes on
//          placements  [brick]  where each brick lies and where it goes
// writes   atlas       [texel]
// shape    one thread per texel of the largest brick and brick, 64 x 1 x 1
// spaces   atlas in texels
// variants TEXEL_FORMAT: the image's, as GLSL names it; TEXEL_BYTES; TEXEL_FLOAT: f32, else normalised
// twin     src/twins/place.rs
// source   DESIGN section 2: a brick's journey through an upload buffer
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/limits.glsl"

layout(local_size_x = CACHE_GROUP) in;

struct Placement {
    uvec3 start;       // first texel in the atlas
    uint first_word;   // in the upload buffer
    uvec3 size;        // texels
    uint unused_0;
};

layout(std430) readonly buffer upload { uint words[]; };
layout(std430) readonly buffer placements { Placement placement_of_brick[]; };
layout(TEXEL_FORMAT) writeonly uniform image3D atlas;

layout(push_constant) uniform Push {
    uint texels_max;       // of the largest brick
    uint first_placement;  // of the atlas
} push;

vec4 texel_at(uint first_word, uint index) {
#if TEXEL_BYTES == 1
    uint word = words[first_word + index / 4u];
    return vec4(float(bitfieldExtract(word, int(index % 4u) * 8, 8)) / 255.0);
#elif TEXEL_BYTES == 2
    uint word = words[first_word + index / 2u];
    return vec4(float(bitfieldExtract(word, int(index % 2u) * 16, 16)) / 65535.0);
#elif TEXEL_BYTES == 4 && defined(TEXEL_FLOAT)
    return vec4(uintBitsToFloat(words[first_word + index]));
#elif TEXEL_BYTES == 4
    return unpackUnorm4x8(words[first_word + index]);
#elif TEXEL_BYTES == 8
    uint first = first_word + index * 2u;
    return vec4(unpackUnorm2x16(words[first]), unpackUnorm2x16(words[first + 1u]));
#else
    uint first = first_word + index * 4u;
    return uintBitsToFloat(
        uvec4(words[first], words[first + 1u], words[first + 2u], words[first + 3u]));
#endif
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    Placement placement = placement_of_brick[push.first_placement + gl_GlobalInvocationID.y];
    uvec3 size = placement.size;
    if (index >= min(size.x * size.y * size.z, push.texels_max)) {
        return;
    }
    uint row = index / size.x;
    uvec3 at = uvec3(index % size.x, row % size.y, row / size.y);
    imageStore(atlas, ivec3(placement.start + at), texel_at(placement.first_word, index));
}
