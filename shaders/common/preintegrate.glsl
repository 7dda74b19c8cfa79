// preintegrate.glsl: the integral over a span between two samples, the value taken as linear along it:
// piece by piece of the transfer function, so that no piece is missed however narrow it is.
// twin: src/twins/preintegrate.rs
//
// variants as common/classify.glsl; who includes it defines MAY_BE_ABSENT: a point may be NaN, which says
//          that nothing is there
// source   pre-integrated classification (Engel, Kraus, Ertl 2001) by the function's own pieces: no
//          tables and no differences of integrals. Values are first moved by a twelfth of the difference
//          of their slopes, which takes away the chord's error where the value is curved (the trapezoid
//          rule with its end correction: Hermite's cubic has that mean)

// Windowed values are kept within this, so that differences stay finite.
#define UNIT_MAX 1.0e30
#define BEYOND_UNITS 2.0e30
#define NO_POINT uintBitsToFloat(0x7fc00000u)

// A part of a ray on which the windowed value is linear.
struct Span {
    float from;   // windowed value, not clamped to the window
    float to;
    float share;  // how much of it is there
    vec3 rgb;     // the voxels' own colour, of channels that have one
};

Span no_span() {
    return Span(0.0, 0.0, 0.0, vec3(1.0));
}

// Values come with their slopes, of voxels that are fetched whatever the filter.
// As filtered_along of src/twins/filter.rs has them.
// What the trilinear value is like at a place.
struct Along {
    float value;
    float slope;  // change of the value per way
    float low;    // least and greatest voxel of the cell
    float high;
};

// Of a cell's lower and upper voxels along z, each four: a voxel and its neighbours in x, y and xy.
Along along_of(vec4 near, vec4 far, vec3 within, vec3 way) {
    vec3 without = 1.0 - within;
    precise vec2 near_rows = near.xz * without.x + near.yw * within.x;
    precise vec2 far_rows = far.xz * without.x + far.yw * within.x;
    precise float near_face = near_rows.x * without.y + near_rows.y * within.y;
    precise float far_face = far_rows.x * without.y + far_rows.y * within.y;
    precise float value = near_face * without.z + far_face * within.z;
    precise vec2 near_x = near.yw - near.xz;
    precise vec2 far_x = far.yw - far.xz;
    precise float slope_x = (near_x.x * without.y + near_x.y * within.y) * without.z
        + (far_x.x * without.y + far_x.y * within.y) * within.z;
    precise float slope_y = (near_rows.y - near_rows.x) * without.z + (far_rows.y - far_rows.x) * within.z;
    precise float slope_z = far_face - near_face;
    precise float slope = slope_x * way.x + slope_y * way.y + slope_z * way.z;
    vec4 least = min(near, far);
    vec4 most = max(near, far);
    float low = min(min(least.x, least.y), min(least.z, least.w));
    float high = max(max(most.x, most.y), max(most.z, most.w));
    return Along(value, slope, low, high);
}

// Value, and its slope along `way` in voxels, of the cell whose lower corner is `corner`.
#ifdef FILTER_QUADS
Along filtered_along(sampler3D image, ivec3 corner, vec3 within, vec3 way) {
    return along_of(
        texelFetch(image, corner, 0), texelFetch(image, corner + ivec3(0, 0, 1), 0), within, way);
}
#else
// Of colours: their alpha's, and the colour itself.
Along filtered_color_along(sampler3D image, ivec3 corner, vec3 within, vec3 way, out vec3 rgb) {
    vec4 x000 = texelFetch(image, corner, 0);
    vec4 x100 = texelFetch(image, corner + ivec3(1, 0, 0), 0);
    vec4 x010 = texelFetch(image, corner + ivec3(0, 1, 0), 0);
    vec4 x110 = texelFetch(image, corner + ivec3(1, 1, 0), 0);
    vec4 x001 = texelFetch(image, corner + ivec3(0, 0, 1), 0);
    vec4 x101 = texelFetch(image, corner + ivec3(1, 0, 1), 0);
    vec4 x011 = texelFetch(image, corner + ivec3(0, 1, 1), 0);
    vec4 x111 = texelFetch(image, corner + ivec3(1, 1, 1), 0);
    vec3 without = 1.0 - within;
    vec3 x00 = x000.rgb * without.x + x100.rgb * within.x;
    vec3 x10 = x010.rgb * without.x + x110.rgb * within.x;
    vec3 x01 = x001.rgb * without.x + x101.rgb * within.x;
    vec3 x11 = x011.rgb * without.x + x111.rgb * within.x;
    rgb = (x00 * without.y + x10 * within.y) * without.z + (x01 * without.y + x11 * within.y) * within.z;
    return along_of(
        vec4(x000.a, x100.a, x010.a, x110.a), vec4(x001.a, x101.a, x011.a, x111.a), within, way);
}
Along filtered_along(sampler3D image, ivec3 corner, vec3 within, vec3 way) {
    vec4 near = vec4(
        texelFetch(image, corner, 0).r, texelFetch(image, corner + ivec3(1, 0, 0), 0).r,
        texelFetch(image, corner + ivec3(0, 1, 0), 0).r, texelFetch(image, corner + ivec3(1, 1, 0), 0).r);
    vec4 far = vec4(
        texelFetch(image, corner + ivec3(0, 0, 1), 0).r, texelFetch(image, corner + ivec3(1, 0, 1), 0).r,
        texelFetch(image, corner + ivec3(0, 1, 1), 0).r, texelFetch(image, corner + ivec3(1, 1, 1), 0).r);
    return along_of(near, far, within, way);
}
#endif

// A point of a channel.
struct Point {
    vec3 rgb;     // the voxels' own colour
    float unit;   // windowed value, not clamped to the window
    float slope;  // its change from point to point, as the cell around has it
    float low;    // least and greatest of the cell's voxels, windowed
    float high;
};

Point point_of(vec3 rgb, Along along, float window_scale, float window_offset) {
    float unit = clamp(along.value * window_scale + window_offset, -UNIT_MAX, UNIT_MAX);
#ifdef NAN_VOXELS
    unit = is_nan(along.value) ? NO_POINT : unit;
#endif
    precise float slope = along.slope * window_scale;
    float one = along.low * window_scale + window_offset;
    float other = along.high * window_scale + window_offset;
    float low = clamp(min(one, other), -UNIT_MAX, UNIT_MAX);
    float high = clamp(max(one, other), -UNIT_MAX, UNIT_MAX);
    // Differences of voxels may be beyond all numbers: judged by bits, as NaN would pass a comparison.
    bool holds = (floatBitsToUint(slope) & 0x7fffffffu) < floatBitsToUint(UNIT_MAX);
    return Point(rgb, unit, holds ? slope : 0.0, low, high);
}

// Between two points.
Span span_between(Point from, Point to) {
    precise float bend = (to.slope - from.slope) * (1.0 / 12.0);
    // Within what the voxels around hold.
    float low = min(from.low, to.low);
    float high = max(from.high, to.high);
    precise float moved_from = from.unit - bend;
    precise float moved_to = to.unit - bend;
    Span span;
    span.from = min(max(moved_from, low), high);
    span.to = min(max(moved_to, low), high);
    span.share = 1.0;
    span.rgb = 0.5 * (from.rgb + to.rgb);
    if (MAY_BE_ABSENT) {
        // Beside a point that is not there, half a span has the other's value.
        bool no_from = is_nan(from.unit);
        bool no_to = is_nan(to.unit);
        span.from = no_from ? to.unit : no_to ? from.unit : span.from;
        span.to = no_to ? from.unit : no_from ? to.unit : span.to;
        span.share = (no_from ? 0.0 : 0.5) + (no_to ? 0.0 : 0.5);
        if (no_from && no_to) {
            span = no_span();
        }
    }
    return span;
}

// How a span lies among the pieces.
struct Crossing {
    float from;
    float to;
    float per_unit;  // part of the span per unit of value; 0 where the value stands still
    bool still;
};

Crossing crossing_of(Span span) {
    float delta = span.to - span.from;
    bool still = abs(delta) < 1.0e-30;
    return Crossing(span.from, span.to, still ? 0.0 : 1.0 / delta, still);
}

// The part of a span in one piece of the transfer function, which holds from low to high.
struct PiecePart {
    float part;        // of the span
    float centre;      // value in its middle
    float middle;      // the same from the piece's beginning on
    float rise;        // of the value, along the ray
    float extinction;  // in its middle
    float steeper;     // rise of the extinction over twelve times the extinction
};

PiecePart part_in(Crossing crossing, float begins_at, float low, float high, vec4 start, vec4 slope) {
    precise float from = clamp(crossing.from, low, high);
    precise float to = clamp(crossing.to, low, high);
    precise float rise = to - from;
    float stands = crossing.from >= low && crossing.from < high ? 1.0 : 0.0;
    precise float part = crossing.still ? stands : rise * crossing.per_unit;
    precise float middle = 0.5 * (from - begins_at + (to - begins_at));
    precise float extinction = max(start.a + slope.a * middle, 0.0);
    precise float steeper = slope.a * rise / (12.0 * max(extinction, 1.0e-37));
    precise float centre = 0.5 * (from + to);
    return PiecePart(part, centre, middle, rise, extinction, steeper);
}

#ifdef SEVERAL_CHANNELS
// Sums over channels, each a mean over the span and the rise of its best linear fit.
struct Means {
    vec3 emission;
    float extinction;
    vec3 emission_rise;
    float extinction_rise;
};

void add_piece(
    inout Means means, Crossing crossing, float begins_at, float low, float high, vec4 start, vec4 slope,
    vec3 rgb, float share
) {
    PiecePart piece = part_in(crossing, begins_at, low, high, start, slope);
    precise float part = piece.part * share;
    precise vec3 color = rgb * (start.rgb + slope.rgb * piece.middle);
    precise vec3 color_rise = rgb * slope.rgb * piece.rise;
    precise float extinction_rise = slope.a * piece.rise;
    precise vec3 emission = piece.extinction * color + extinction_rise * color_rise * (1.0 / 12.0);
    precise vec3 emission_rise = piece.extinction * color_rise + extinction_rise * color;
    // Where the part lies in the span, from its middle on.
    precise float place_moving = (piece.centre - crossing.from) * crossing.per_unit - 0.5;
    float place = crossing.still ? 0.0 : place_moving;
    precise float sum = means.extinction + part * piece.extinction;
    precise vec3 emission_sum = means.emission + part * emission;
    precise float rise_sum = means.extinction_rise
        + part * (12.0 * place * piece.extinction + piece.part * extinction_rise);
    precise vec3 emission_rise_sum = means.emission_rise
        + part * (12.0 * place * emission + piece.part * emission_rise);
    means = Means(emission_sum, sum, emission_rise_sum, rise_sum);
}

void add_constant(inout Means means, vec4 medium) {
    means.extinction += medium.a;
    means.emission += medium.a * medium.rgb;
}

void composite_means(inout Block block, Means means, float length_world) {
    float depth = min(min(means.extinction, 3.0e38) * length_world, OPAQUE_DEPTH);
    Attenuation attenuation = attenuate_bounded(depth);
    precise float per_extinction = 1.0 / max(means.extinction, 1.0e-37);
    precise vec3 color = means.emission * per_extinction;
    precise vec3 rise = (means.emission_rise - color * means.extinction_rise) * per_extinction;
    // What comes first hides what comes later.
    precise float hidden = depth / (12.0 + 2.0 * depth);
    precise vec3 seen = max(color - rise * hidden, 0.0);
    float weight = block.transmitted * attenuation.absorbed;
    block.color += weight * seen;
    block.transmitted -= weight;
    block.depth += depth;
}

#define SPAN_SUM Means sum = Means(vec3(0.0), 0.0, vec3(0.0), 0.0);
#define SPAN_SUM_END composite_means(block, sum, length_world);
#else
// A span of one channel, composited along the ray.
struct Composited {
    vec3 color;         // as if nothing stood before the span
    float depth;
    float transmitted;
    float length_world;
};

void add_piece(
    inout Composited sum, Crossing crossing, float begins_at, float low, float high, vec4 start, vec4 slope,
    vec3 rgb, float share
) {
    PiecePart piece = part_in(crossing, begins_at, low, high, start, slope);
    float depth = min(piece.extinction * (piece.part * share * sum.length_world), OPAQUE_DEPTH);
    Attenuation attenuation = attenuate_bounded(depth);
    // Where the light comes from: where extinction is greater, and where less stands before it.
    float lead = clamp(piece.steeper - depth / (12.0 + 2.0 * depth), -0.5, 0.5);
    vec3 color = rgb * max(start.rgb + slope.rgb * (piece.middle + piece.rise * lead), 0.0);
    // Pieces come in the order of their values: along the ray, or against it.
    bool along = crossing.to >= crossing.from;
    sum.color = along
        ? sum.color + sum.transmitted * attenuation.absorbed * color
        : attenuation.absorbed * color + attenuation.transmitted * sum.color;
    sum.transmitted *= attenuation.transmitted;
    sum.depth += depth;
}

void composite_span(inout Block block, Composited sum) {
    block.color += block.transmitted * sum.color;
    block.transmitted *= sum.transmitted;
    block.depth += sum.depth;
}

#define SPAN_SUM Composited sum = Composited(vec3(0.0), 0.0, 1.0, length_world);
#define SPAN_SUM_END composite_span(block, sum);
#endif

#ifdef TRANSFER_SEARCH
#define ADD_PIECES(NAME, PIECES, span) \
    { \
        Crossing crossing = crossing_of(span); \
        float lowest = min(span.from, span.to); \
        float highest = max(span.from, span.to); \
        uint at = 0u; \
        [[unroll]] for (uint halving = 0u; halving < SEARCH_STEPS; ++halving) { \
            uint tried = at + ((1u << (SEARCH_STEPS - 1u)) >> halving); \
            if (tried < NAME##_count && lowest >= segments[NAME##_first + tried].begins_at) { \
                at = tried; \
            } \
        } \
        bool more = true; \
        while (more) { \
            TransferSegment piece = segments[NAME##_first + at]; \
            uint after = min(at + 1u, NAME##_count - 1u); \
            float next = at + 1u < NAME##_count ? segments[NAME##_first + after].begins_at : BEYOND_UNITS; \
            float low = at == 0u ? -UNIT_MAX : piece.begins_at; \
            add_piece( \
                sum, crossing, piece.begins_at, low, next, piece.start, piece.slope, span.rgb, span.share); \
            ++at; \
            more = at < NAME##_count && next <= highest; \
        } \
    }
#else
// PIECES is one ADD_PIECE after another. No loop does that: where the compiler unrolls one, the copies of
// what is precise no longer are.
#define ADD_PIECE(NAME, index, SEGMENTS) \
    add_piece( \
        sum, crossing, NAME##_begins_at[index], index == 0 ? -UNIT_MAX : NAME##_begins_at[index], \
        index + 1 < SEGMENTS ? NAME##_begins_at[min(index + 1, SEGMENTS - 1)] : BEYOND_UNITS, \
        NAME##_start[index], NAME##_slope[index], span.rgb, span.share);
#define ADD_PIECES(NAME, PIECES, span) \
    { \
        Crossing crossing = crossing_of(span); \
        PIECES \
    }
#endif

// What a channel keeps from point to point.
#define DECLARE_POINTS(NAME) \
    Point NAME##_behind = Point(vec3(0.0), 0.0, 0.0, 0.0, 0.0); \
    Point NAME##_ahead = NAME##_behind;

// A channel's span from the point before to this one.
#define SPAN_SAMPLED(NAME, PIECES) \
    { \
        Span span = span_between(NAME##_behind, NAME##_ahead); \
        ADD_PIECES(NAME, PIECES, span) \
        NAME##_behind = NAME##_ahead; \
    }
#define SPAN_CONSTANT(NAME, SEGMENTS) SPAN_OF_CONSTANT(NAME)
#ifdef SEVERAL_CHANNELS
#define SPAN_OF_CONSTANT(NAME) add_constant(sum, NAME##_medium);
#else
#define SPAN_OF_CONSTANT(NAME) \
    add_piece( \
        sum, Crossing(0.0, 0.0, 0.0, true), 0.0, -UNIT_MAX, BEYOND_UNITS, NAME##_medium, vec4(0.0), vec3(1.0), 1.0);
#endif
