// limits.glsl: numbers that host and shaders share. The host reads them from this file.

// Samples between two anchors of a ray, see fixed_point.glsl: few enough that f32 holds a position
// inside a block to 32 * 2^-24 of the step's length.
#define BLOCK_SAMPLES 32u
// Rays of one workgroup along x and y. Eight lanes along x: lavapipe runs narrower groups slower.
#define GROUP_WIDTH 8
#define GROUP_HEIGHT 8
// Optical depth taken for opaque: exp(-87) is the smallest that f32 holds as a normal number.
#define OPAQUE_DEPTH 87.0
