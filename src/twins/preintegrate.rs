//! The integral over a span between two samples, the value taken as linear along it; twin of
//! `shaders/common/preintegrate.glsl`.
//!
//! Pre-integrated classification (Engel, Kraus, Ertl 2001) by the transfer function's own pieces: no
//! tables and no differences of integrals, so that nothing cancels where both ends are nearly equal, and
//! no piece is missed however narrow it is. Slopes at the ends take away a chord's error where the value is
//! curved: the trapezoid rule with its end correction.

use crate::twins::classify::Block;
use crate::twins::exponential::attenuate_bounded;
use crate::twins::filter::Along;
use crate::twins::limits::OPAQUE_DEPTH;
use crate::twins::transfer::TransferSegment;

/// Windowed values are kept within this, so that differences stay finite.
const UNIT_MAX: f32 = 1.0e30;
/// Above every windowed value.
const BEYOND_UNITS: f32 = 2.0e30;

/// A point of a channel.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// The voxels' own colour; 1 for channels that have none.
    pub rgb: [f32; 3],
    /// Windowed value, not clamped to the window; NaN where nothing is there.
    pub unit: f32,
    /// Its change from point to point, as the cell around has it.
    pub slope: f32,
    /// Least of the cell's voxels, windowed.
    pub low: f32,
    /// Greatest of them.
    pub high: f32,
}

impl Point {
    /// Nothing is there.
    pub const NONE: Point =
        Point { rgb: [1.0; 3], unit: f32::NAN, slope: 0.0, low: 0.0, high: 0.0 };

    /// Of a texel; a NaN is nothing.
    pub fn new(rgb: [f32; 3], along: Along, segments: &[TransferSegment]) -> Point {
        let TransferSegment { window_scale, window_offset, .. } = segments[0];
        let windowed = |texel: f32| texel * window_scale + window_offset;
        let bounded = |unit: f32| unit.clamp(-UNIT_MAX, UNIT_MAX);
        let [one, other] = [windowed(along.low), windowed(along.high)];
        let slope = along.slope * window_scale;
        Point {
            rgb,
            unit: if along.value.is_nan() { f32::NAN } else { bounded(windowed(along.value)) },
            // Differences of voxels may be beyond all numbers.
            slope: if slope.abs() < UNIT_MAX { slope } else { 0.0 },
            low: bounded(one.min(other)),
            high: bounded(one.max(other)),
        }
    }
}

/// A part of a ray on which the windowed value is linear.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    from: f32,
    to: f32,
    share: f32,
    rgb: [f32; 3],
}

impl Span {
    const NONE: Span = Span { from: 0.0, to: 0.0, share: 0.0, rgb: [1.0; 3] };

    /// Between two points.
    ///
    /// Their values are moved by a twelfth of the difference of their slopes: where the value is curved, a
    /// chord's mean differs from the true one by that. They stay within what the voxels around them hold.
    pub fn between(from: Point, to: Point) -> Span {
        let rgb = std::array::from_fn(|c| 0.5 * (from.rgb[c] + to.rgb[c]));
        let bend = (to.slope - from.slope) * (1.0 / 12.0);
        let (low, high) = (from.low.min(to.low), from.high.max(to.high));
        match (from.unit.is_nan(), to.unit.is_nan()) {
            (true, true) => Span::NONE,
            // Beside a point that is not there, half a span has the other's value.
            (true, false) => Span { from: to.unit, to: to.unit, share: 0.5, rgb },
            (false, true) => Span { from: from.unit, to: from.unit, share: 0.5, rgb },
            (false, false) => Span {
                from: (from.unit - bend).max(low).min(high),
                to: (to.unit - bend).max(low).min(high),
                share: 1.0,
                rgb,
            },
        }
    }
}

/// What one channel has on a span.
#[derive(Clone, Copy, Debug)]
pub enum Content<'a> {
    /// A value that changes, under a transfer function.
    Span(Span, &'a [TransferSegment]),
    /// One rgb and extinction.
    Constant([f32; 4]),
}

/// Adds a span of `length_world` of all channels together.
pub fn composite_span(block: &mut Block, contents: &[Content], length_world: f32) {
    if let [content] = contents {
        let mut sum = Composited::new(length_world);
        content.each_piece(|piece| sum.add(&piece));
        sum.composite(block);
    } else {
        let mut means = Means::default();
        for content in contents {
            match content {
                Content::Constant(medium) => means.add_constant(*medium),
                Content::Span(..) => content.each_piece(|piece| means.add(&piece)),
            }
        }
        means.composite(block, length_world);
    }
}

/// How a span lies among the pieces.
struct Crossing {
    from: f32,
    to: f32,
    per_unit: f32,
    still: bool,
}

/// The part of a span in one piece of the transfer function.
struct PiecePart {
    crossing: Crossing,
    start: [f32; 4],
    slope: [f32; 4],
    rgb: [f32; 3],
    share: f32,
    part: f32,
    centre: f32,
    middle: f32,
    rise: f32,
    extinction: f32,
    steeper: f32,
}

impl Content<'_> {
    /// In the order of their values.
    fn each_piece(&self, mut take: impl FnMut(PiecePart)) {
        let (span, segments) = match self {
            Content::Span(span, segments) => (*span, *segments),
            Content::Constant(medium) => {
                let segment = TransferSegment { start: *medium, ..TransferSegment::default() };
                let span = Span { share: 1.0, ..Span::NONE };
                return take(PiecePart::new(&span, &segment, -UNIT_MAX, BEYOND_UNITS));
            }
        };
        for (index, segment) in segments.iter().enumerate() {
            let low = if index == 0 { -UNIT_MAX } else { segment.begins_at };
            let high = segments.get(index + 1).map_or(BEYOND_UNITS, |next| next.begins_at);
            take(PiecePart::new(&span, segment, low, high));
        }
    }
}

impl PiecePart {
    fn new(span: &Span, segment: &TransferSegment, low: f32, high: f32) -> PiecePart {
        let delta = span.to - span.from;
        let still = delta.abs() < 1.0e-30;
        let per_unit = if still { 0.0 } else { 1.0 / delta };
        let crossing = Crossing { from: span.from, to: span.to, per_unit, still };
        let TransferSegment { start, slope, begins_at, .. } = *segment;
        let (from, to) = (span.from.clamp(low, high), span.to.clamp(low, high));
        let rise = to - from;
        let stands = if span.from >= low && span.from < high { 1.0 } else { 0.0 };
        let part = if still { stands } else { rise * per_unit };
        let middle = 0.5 * (from - begins_at + (to - begins_at));
        let extinction = (start[3] + slope[3] * middle).max(0.0);
        let steeper = slope[3] * rise / (12.0 * extinction.max(1.0e-37));
        let (rgb, share) = (span.rgb, span.share);
        PiecePart {
            crossing,
            start,
            slope,
            rgb,
            share,
            part,
            centre: 0.5 * (from + to),
            middle,
            rise,
            extinction,
            steeper,
        }
    }
}

/// A span of one channel, composited along the ray.
struct Composited {
    color: [f32; 3],
    depth: f32,
    transmitted: f32,
    length_world: f32,
}

impl Composited {
    fn new(length_world: f32) -> Composited {
        Composited { color: [0.0; 3], depth: 0.0, transmitted: 1.0, length_world }
    }

    fn add(&mut self, piece: &PiecePart) {
        let length = piece.part * piece.share * self.length_world;
        let depth = (piece.extinction * length).min(OPAQUE_DEPTH);
        let attenuation = attenuate_bounded(depth);
        // Where the light comes from: where extinction is greater, and where less stands before it.
        let lead = (piece.steeper - depth / (12.0 + 2.0 * depth)).clamp(-0.5, 0.5);
        let along = piece.crossing.to >= piece.crossing.from;
        for c in 0..3 {
            let at = piece.middle + piece.rise * lead;
            let color = piece.rgb[c] * (piece.start[c] + piece.slope[c] * at).max(0.0);
            self.color[c] = if along {
                self.color[c] + self.transmitted * attenuation.absorbed * color
            } else {
                attenuation.absorbed * color + attenuation.transmitted * self.color[c]
            };
        }
        self.transmitted *= attenuation.transmitted;
        self.depth += depth;
    }

    fn composite(&self, block: &mut Block) {
        for (sum, color) in block.color.iter_mut().zip(self.color) {
            *sum += block.transmitted * color;
        }
        block.transmitted *= self.transmitted;
        block.depth += self.depth;
    }
}

/// Sums over channels, each a mean over the span and the rise of its best linear fit.
#[derive(Default)]
struct Means {
    emission: [f32; 3],
    extinction: f32,
    emission_rise: [f32; 3],
    extinction_rise: f32,
}

impl Means {
    fn add(&mut self, piece: &PiecePart) {
        let part = piece.part * piece.share;
        let crossing = &piece.crossing;
        let extinction_rise = piece.slope[3] * piece.rise;
        let place = if crossing.still {
            0.0
        } else {
            (piece.centre - crossing.from) * crossing.per_unit - 0.5
        };
        self.extinction += part * piece.extinction;
        self.extinction_rise +=
            part * (12.0 * place * piece.extinction + piece.part * extinction_rise);
        for c in 0..3 {
            let color = piece.rgb[c] * (piece.start[c] + piece.slope[c] * piece.middle);
            let color_rise = piece.rgb[c] * piece.slope[c] * piece.rise;
            let emission = piece.extinction * color + extinction_rise * color_rise * (1.0 / 12.0);
            let emission_rise = piece.extinction * color_rise + extinction_rise * color;
            self.emission[c] += part * emission;
            self.emission_rise[c] += part * (12.0 * place * emission + piece.part * emission_rise);
        }
    }

    fn add_constant(&mut self, [r, g, b, extinction]: [f32; 4]) {
        self.extinction += extinction;
        for (sum, color) in self.emission.iter_mut().zip([r, g, b]) {
            *sum += extinction * color;
        }
    }

    fn composite(&self, block: &mut Block, length_world: f32) {
        let depth = (self.extinction.min(3.0e38) * length_world).min(OPAQUE_DEPTH);
        let attenuation = attenuate_bounded(depth);
        let per_extinction = 1.0 / self.extinction.max(1.0e-37);
        let weight = block.transmitted * attenuation.absorbed;
        for c in 0..3 {
            let color = self.emission[c] * per_extinction;
            let rise = (self.emission_rise[c] - color * self.extinction_rise) * per_extinction;
            // What comes first hides what comes later.
            let color = (color - rise * (depth / (12.0 + 2.0 * depth))).max(0.0);
            block.color[c] += weight * color;
        }
        block.transmitted -= weight;
        block.depth += depth;
    }
}
