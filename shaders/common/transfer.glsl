// transfer.glsl: colour and extinction of a windowed value. twin: src/twins/transfer.rs

// A linear piece of a channel's transfer function, from begins_at to where the next one begins.
// A channel's first piece holds from below everything.
struct TransferSegment {
    vec4 start;            // linear rgb and extinction (per world unit) at begins_at
    vec4 slope;            // their change per unit of windowed value
    float begins_at;       // windowed value, 0 to 1
    float window_scale;    // windowed value = texel * window_scale + window_offset;
    float window_offset;   // the same in every segment of a channel
    float unused_0;
};
