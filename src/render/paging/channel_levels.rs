//! The finest level that each channel of a scene is drawn at: as its level bounds say, and as coarse as what
//! is lost by it may be.
//!
//! # Source
//! residency-octree-2023 section 6.1 has level bounds of channels; choosing them by what levels lose is its
//! future work (section 8). Details of different levels are orthogonal, since a coarse voxel is the mean of
//! those that it covers: drawing level l in the place of level 0 loses the root of the sum of the squares of
//! what each level between loses.

use crate::render::paging::visibility::{Judge, Shows};
use crate::scene::{Channel, Quality};
use crate::source::{BrickEntry, BrickSource};
use crate::twins::transfer::TransferSegment;
use crate::volume::BrickId;

/// The finest level of a channel, the source's `in_source`.
pub fn finest_level(
    source: &dyn BrickSource,
    in_source: u16,
    channel: &Channel,
    judge: &Judge,
    quality: &Quality,
) -> u8 {
    let last = (source.description().levels.count() - 1) as u8;
    let most = channel.level_max.unwrap_or(last).min(last);
    let least = channel.level_min.min(most);
    match quality.level_loss {
        Some(loss_max) => coarsest_within(source, in_source, judge, loss_max, [least, most]),
        None => least,
    }
}

/// The coarsest level between bounds that loses no more than `loss_max`, [`Quality::level_loss`].
fn coarsest_within(
    source: &dyn BrickSource,
    in_source: u16,
    judge: &Judge,
    loss_max: f64,
    [least, most]: [u8; 2],
) -> u8 {
    let per_value = shown_per_value(judge);
    let mut squares = 0.0;
    for level in 0..most {
        let lost = per_value * greatest_loss(source, in_source, judge, level);
        squares += lost * lost;
        // False of what is not known.
        let within = squares.sqrt() <= loss_max;
        if !within {
            return level.max(least);
        }
    }
    most
}

/// What bricks of a level that show something lose at most where the next coarser level is drawn, in stored
/// values; NaN where that is not known.
fn greatest_loss(source: &dyn BrickSource, channel: u16, judge: &Judge, level: u8) -> f64 {
    let Some(grid) = source.description().grid(level) else { return f64::NAN };
    let [across, down, deep] = grid.bricks().to_array();
    let mut greatest = 0.0;
    for z in 0..deep {
        for y in 0..down {
            for x in 0..across {
                let entry = source.entry(BrickId { volume: 0, channel, level, x, y, z });
                match entry {
                    Ok(BrickEntry::Stored { loss, .. }) if loss.is_nan() => return f64::NAN,
                    Ok(entry @ BrickEntry::Stored { loss, .. })
                        if judge.shows(&entry) == Shows::Voxels =>
                    {
                        greatest = f64::max(greatest, loss.into());
                    }
                    Ok(_) => {}
                    // Drawing it will say why.
                    Err(_) => return f64::NAN,
                }
            }
        }
    }
    greatest
}

/// How steeply extinction, or extinction times colour, changes with the stored value, as a part of the
/// greatest extinction or of that times colour; infinite where it jumps.
fn shown_per_value(judge: &Judge) -> f64 {
    let of_segment = |segment: &TransferSegment, at: f64| -> [f64; 4] {
        let along = at - f64::from(segment.begins_at);
        let value =
            |part: usize| f64::from(segment.start[part]) + along * f64::from(segment.slope[part]);
        let extinction = value(3).max(0.0);
        [value(0) * extinction, value(1) * extinction, value(2) * extinction, extinction]
    };
    let ends = judge.segments.iter().skip(1).map(|next| f64::from(next.begins_at)).chain([1.0]);
    let (mut steepest, mut greatest) = (0.0f64, 0.0f64);
    let mut before: Option<[f64; 4]> = None;
    for (segment, end) in judge.segments.iter().zip(ends) {
        let begin = f64::from(segment.begins_at).max(0.0);
        let [first, last] = [begin, end].map(|at| of_segment(segment, at));
        let jump = |before: [f64; 4]| (0..4).any(|part| (before[part] - first[part]).abs() > 1e-5);
        if before.is_some_and(jump) {
            return f64::INFINITY;
        }
        let extinction_slope = f64::from(segment.slope[3]);
        for (at, values) in [(begin, first), (end, last)] {
            let along = at - f64::from(segment.begins_at);
            steepest = steepest.max(extinction_slope.abs());
            for part in 0..3 {
                let slope = f64::from(segment.slope[part]);
                let color = f64::from(segment.start[part]) + along * slope;
                steepest = steepest.max((slope * values[3] + color * extinction_slope).abs());
            }
            greatest = values.iter().fold(greatest, |greatest, value| greatest.max(*value));
        }
        before = Some(last);
    }
    let Some(first) = judge.segments.first() else { return 0.0 };
    if greatest == 0.0 {
        return 0.0;
    }
    // From the stored value to the texel, and on to the windowed value.
    let per_texel = f64::from(first.window_scale).abs();
    steepest / greatest * per_texel / judge.layout.scale.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::image_layout::{Layout, TexelLayout};
    use crate::volume::{ValueRange, VoxelFormat};

    fn judge(segments: Vec<TransferSegment>) -> Judge {
        let layout = TexelLayout::of(VoxelFormat::U8, ValueRange::of(0.0), Layout::Plain);
        Judge { format: VoxelFormat::U8, layout, segments, skipping: true }
    }

    fn segment(begins_at: f32, start: f32, slope: f32) -> TransferSegment {
        TransferSegment {
            start: [1.0, 1.0, 1.0, start],
            slope: [0.0, 0.0, 0.0, slope],
            begins_at,
            window_scale: 1.0,
            ..TransferSegment::default()
        }
    }

    #[test]
    fn a_ramp_shows_as_much_as_values_change() {
        // Over 255 values from nothing to 4: one value is 1/255 of the greatest.
        assert!(
            (shown_per_value(&judge(vec![segment(0.0, 0.0, 4.0)])) * 255.0 - 1.0).abs() < 1e-12
        );
        // Twice as steep in its half.
        let half = judge(vec![segment(0.0, 0.0, 0.0), segment(0.5, 0.0, 4.0)]);
        assert!((shown_per_value(&half) * 255.0 - 2.0).abs() < 1e-12);
        let jump = judge(vec![segment(0.0, 0.0, 0.0), segment(0.5, 1.0, 0.0)]);
        assert_eq!(shown_per_value(&jump), f64::INFINITY);
        assert_eq!(shown_per_value(&judge(vec![segment(0.0, 0.0, 0.0)])), 0.0);
        // A colour that changes shows as well.
        let mut colored = segment(0.0, 2.0, 0.0);
        colored.slope[1] = 3.0;
        assert!(shown_per_value(&judge(vec![colored])) > 0.0);
    }
}
