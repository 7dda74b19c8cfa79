// limits.glsl: numbers that host and shaders share. The host reads them from this file.

// Samples between two anchors of a ray, see fixed_point.glsl: few enough that f32 holds a position
// inside a block to 32 * 2^-24 of the step's length.
#define BLOCK_SAMPLES 32u
// Rays of one workgroup along x and y. Eight lanes along x: lavapipe runs narrower groups slower.
#define GROUP_WIDTH 8
#define GROUP_HEIGHT 8
// Optical depth of one sample, at most: far beyond opaque, and a million of them sum without overflow.
#define DEPTH_OF_SAMPLE_MAX 1.0e6
