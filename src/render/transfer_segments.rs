//! From a channel of the scene to the linear pieces that the shader chooses among.

use crate::render::image_layout::TexelLayout;
use crate::scene::{Channel, TransferFunction, TransferPoint};
use crate::twins::transfer::TransferSegment;
use crate::volume::sanitized;

/// Pieces narrower than this count as jumps: f32 cannot hold their slope.
const WIDTH_UNIT_MIN: f64 = 1e-12;

/// The channel's segments, at least one; `texel_scale` and `texel_offset` lead from a texel to the
/// stored value.
pub fn transfer_segments(
    channel: &Channel,
    (slope, intercept): (f64, f64),
    (texel_scale, texel_offset): (f64, f64),
) -> Vec<TransferSegment> {
    let [lo, hi] = channel.window;
    // windowed = (slope * (texel * texel_scale + texel_offset) + intercept - lo) / (hi - lo), in f64.
    let window_scale = (slope * texel_scale / (hi - lo)) as f32;
    let window_offset = ((slope * texel_offset + intercept - lo) / (hi - lo)) as f32;
    let mut segments: Vec<TransferSegment> = Vec::new();
    for piece in pieces(&channel.transfer) {
        let segment = TransferSegment { window_scale, window_offset, ..piece };
        match segments.last() {
            // Where nothing is seen the colour does not matter.
            Some(last) if is_clear(last) && is_clear(&segment) => {}
            _ => segments.push(segment),
        }
    }
    segments
}

/// Adds what holds below and above the window, where the function is not constant there: for values that
/// are not clamped to it.
pub fn open_both_ends(segments: &mut Vec<TransferSegment>) {
    let constant = |from: &TransferSegment, begins_at: f32| {
        let start = std::array::from_fn(|part| {
            from.start[part] + from.slope[part] * (begins_at - from.begins_at)
        });
        TransferSegment { start, slope: [0.0; 4], begins_at, ..*from }
    };
    if let Some(first) = segments.first().filter(|first| first.slope != [0.0; 4]) {
        let below = constant(first, 0.0);
        segments.insert(0, below);
    }
    if let Some(last) = segments.last().filter(|last| last.slope != [0.0; 4]) {
        let mut above = constant(last, 1.0);
        above.start[3] = above.start[3].max(0.0);
        segments.push(above);
    }
}

/// Where the window puts a stored value.
pub(super) struct Windowed {
    /// 0 to 1 within the window.
    pub at: f64,
    /// How far f32 arithmetic of filter and window may move it: a few units in the last place of what is
    /// added up.
    pub rounding: f64,
}

impl Windowed {
    /// Of a stored value of a channel with these segments.
    pub(super) fn of(value: f32, layout: &TexelLayout, segments: &[TransferSegment]) -> Windowed {
        let first = &segments[0];
        let texel = (f64::from(sanitized(value)) - layout.offset) / layout.scale;
        let (scaled, offset) =
            (texel * f64::from(first.window_scale), f64::from(first.window_offset));
        let rounding = 4e-6 * (scaled.abs() + offset.abs()) + 1e-6;
        Windowed { at: scaled + offset, rounding }
    }
}

/// The segments that values between `from` and `to` meet, windowed and clamped, and the part of that range
/// in each.
pub(super) fn segments_between(
    segments: &[TransferSegment],
    from: f64,
    to: f64,
) -> impl Iterator<Item = (&TransferSegment, [f64; 2])> {
    let (from, to) = (from.clamp(0.0, 1.0), to.clamp(0.0, 1.0));
    segments.iter().enumerate().filter_map(move |(index, segment)| {
        let begins = if index == 0 { 0.0 } else { f64::from(segment.begins_at) };
        let next = segments.get(index + 1);
        let ends = next.map_or(1.0, |next| f64::from(next.begins_at));
        let (from, to) = (from.max(begins), to.min(ends));
        (from <= to).then_some((segment, [from, to]))
    })
}

/// Linear rgb and extinction of a segment at a windowed value.
pub(super) fn value_at(segment: &TransferSegment, windowed: f64) -> [f64; 4] {
    let along = windowed - f64::from(segment.begins_at);
    std::array::from_fn(|part| {
        f64::from(segment.start[part]) + f64::from(segment.slope[part]) * along
    })
}

/// One segment for a channel whose every voxel has the stored value `value`.
pub fn classify_constant(
    channel: &Channel,
    (slope, intercept): (f64, f64),
    value: f64,
) -> TransferSegment {
    let [lo, hi] = channel.window;
    let windowed = ((slope * value + intercept - lo) / (hi - lo)).clamp(0.0, 1.0);
    let [r, g, b, extinction] = evaluate(&channel.transfer, windowed);
    TransferSegment {
        start: [r as f32, g as f32, b as f32, extinction as f32],
        window_scale: 1.0,
        ..TransferSegment::default()
    }
}

fn pieces(transfer: &TransferFunction) -> Vec<TransferSegment> {
    let points = transfer.points();
    let level = |point: &TransferPoint, begins_at: f64| TransferSegment {
        start: parts(point).map(|part| part as f32),
        begins_at: begins_at as f32,
        ..TransferSegment::default()
    };
    let mut pieces = Vec::new();
    if points[0].at > 0.0 {
        pieces.push(level(&points[0], 0.0));
    }
    for pair in points.windows(2) {
        let width = pair[1].at - pair[0].at;
        if width < WIDTH_UNIT_MIN {
            continue;
        }
        let (from, to) = (parts(&pair[0]), parts(&pair[1]));
        pieces.push(TransferSegment {
            slope: std::array::from_fn(|part| ((to[part] - from[part]) / width) as f32),
            ..level(&pair[0], pair[0].at)
        });
    }
    // Constant from the last point on; at 1 itself it is needed only for a jump there.
    let last = &points[points.len() - 1];
    let jump_at_end = points.len() > 1 && last.at - points[points.len() - 2].at < WIDTH_UNIT_MIN;
    if last.at < 1.0 || jump_at_end || pieces.is_empty() {
        pieces.push(level(last, last.at));
    }
    pieces
}

fn parts(point: &TransferPoint) -> [f64; 4] {
    let [r, g, b] = point.color;
    [r, g, b, point.extinction]
}

fn is_clear(segment: &TransferSegment) -> bool {
    segment.start[3] == 0.0 && segment.slope[3] == 0.0
}

fn evaluate(transfer: &TransferFunction, windowed: f64) -> [f64; 4] {
    let points = transfer.points();
    let after = points.partition_point(|point| point.at <= windowed);
    match (after.checked_sub(1).map(|before| &points[before]), points.get(after)) {
        (None, Some(first)) => parts(first),
        (Some(last), None) => parts(last),
        (Some(from), Some(to)) => {
            let along = (windowed - from.at) / (to.at - from.at);
            let (from, to) = (parts(from), parts(to));
            std::array::from_fn(|part| from[part] + (to[part] - from[part]) * along)
        }
        (None, None) => [0.0; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twins::transfer::classify;

    fn channel(points: &[(f64, f64)]) -> Channel {
        let point = |&(at, extinction)| TransferPoint { at, color: [at, 0.5, 1.0], extinction };
        let transfer = TransferFunction::new(points.iter().map(point).collect()).expect("valid");
        Channel {
            index: 0,
            window: [-1.0, 3.0],
            transfer,
            level_min: 0,
            level_max: None,
            sample_every: 1,
        }
    }

    #[test]
    fn segments_equal_the_function_everywhere_jumps_included() {
        let cases: [&[(f64, f64)]; 6] = [
            &[(0.0, 1.0), (1.0, 3.0)],
            &[(0.25, 2.0), (0.5, 0.0), (0.5, 7.0), (0.75, 1.0)],
            &[(0.0, 0.0), (0.0, 5.0), (1.0, 5.0), (1.0, 2.0)],
            &[(0.5, 4.0)],
            &[(0.0, 0.0), (0.3, 0.0), (0.30000001, 9.0), (0.4, 0.0), (0.6, 0.0), (1.0, 0.0)],
            &[(0.0, 0.0), (1e-300, 3.0), (1.0, 3.0)],
        ];
        for points in cases {
            let channel = channel(points);
            let segments = transfer_segments(&channel, (2.0, -1.0), (1.0, 0.5));
            for step in -10i32..=410 {
                let texel = f64::from(step) * 0.005 - 0.5;
                let windowed = ((2.0 * (texel + 0.5) - 1.0 + 1.0) / 4.0).clamp(0.0, 1.0);
                let exact = evaluate(&channel.transfer, windowed);
                let got = classify(&segments, texel as f32);
                // At a jump, f32 may fall on the other side.
                let near_jump = points
                    .windows(2)
                    .any(|p| p[1].0 - p[0].0 < 1e-6 && (windowed - p[0].0).abs() < 1e-6);
                if !near_jump && (exact[3] > 0.0 || got[3] > 0.0) {
                    for part in 0..4 {
                        let error = (f64::from(got[part]) - exact[part]).abs();
                        assert!(error < 1e-5, "{points:?} at {windowed}: {got:?} {exact:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn clear_pieces_are_joined() {
        let channel = channel(&[(0.0, 0.0), (0.2, 0.0), (0.4, 0.0), (0.6, 1.0), (1.0, 0.0)]);
        assert_eq!(transfer_segments(&channel, (1.0, 0.0), (1.0, 0.0)).len(), 3);
    }
}
