//! What a brick shows under the transfer function: nothing, one value, or what its voxels say.

use crate::render::image_layout::TexelLayout;
use crate::render::transfer_segments::{Windowed, segments_between, value_at};
use crate::source::BrickEntry;
use crate::twins::transfer::{TransferSegment, classify};
use crate::volume::{ValueRange, VoxelFormat, Voxels, sanitized};

/// What becomes of a brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shows {
    /// The source has nothing there.
    Absent,
    /// Nothing of it is visible.
    Hidden,
    /// Everywhere this texel.
    Constant([f32; 4]),
    /// Its voxels have to be there.
    Voxels,
}

/// A channel as bricks are judged by.
#[derive(Clone, Debug, PartialEq)]
pub struct Judge {
    /// Of its voxels.
    pub format: VoxelFormat,
    /// From texels to stored values.
    pub layout: TexelLayout,
    /// Its transfer function, over texels.
    pub segments: Vec<TransferSegment>,
    /// Whether bricks that show nothing are left out.
    pub skipping: bool,
}

impl Judge {
    /// What a brick of this entry shows.
    pub fn shows(&self, entry: &BrickEntry) -> Shows {
        match *entry {
            BrickEntry::Absent => Shows::Absent,
            BrickEntry::Constant(voxel) => self.constant(voxel),
            BrickEntry::Stored { range, .. } if self.skipping && self.hides(range) => Shows::Hidden,
            BrickEntry::Stored { .. } => Shows::Voxels,
        }
    }

    fn constant(&self, voxel: [u8; 4]) -> Shows {
        let texel = match Voxels::from_bytes(self.format, &voxel[..self.format.bytes()]) {
            Voxels::U8(v) => [f32::from(v[0]) / 255.0; 4],
            Voxels::U16(v) => [f32::from(v[0]) / 65535.0; 4],
            Voxels::I16(v) => [f32::from(v[0] as u16 ^ 0x8000) / 65535.0; 4],
            Voxels::Rgba8(v) => v[0].map(|part| f32::from(part) / 255.0),
            Voxels::F32(v) if v[0].is_nan() => return Shows::Hidden,
            Voxels::F32(v) => {
                let relative =
                    (f64::from(sanitized(v[0])) - self.layout.offset) / self.layout.scale;
                [relative as f32; 4]
            }
        };
        let [.., extinction] = classify(&self.segments, texel[3]);
        if self.skipping && extinction == 0.0 { Shows::Hidden } else { Shows::Constant(texel) }
    }

    /// Whether no value of the range, nor any that rounding makes of values between two of it, has an
    /// extinction above 0.
    pub(in crate::render) fn hides(&self, range: ValueRange) -> bool {
        if range.is_empty() {
            return true;
        }
        let ends = [range.least, range.greatest]
            .map(|value| Windowed::of(value, &self.layout, &self.segments));
        let least = ends.iter().map(|end| end.at - end.rounding).fold(f64::INFINITY, f64::min);
        let greatest = ends.iter().map(|end| end.at + end.rounding).fold(-f64::INFINITY, f64::max);
        segments_between(&self.segments, least, greatest)
            .all(|(segment, ends)| ends.iter().all(|at| value_at(segment, *at)[3] <= 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::image_layout::Layout;

    /// Opaque from 0.25 to 0.5 and from 0.75 on, over u8.
    fn judge() -> Judge {
        let segment = |begins_at: f32, extinction: f32| TransferSegment {
            start: [0.0, 0.0, 0.0, extinction],
            begins_at,
            window_scale: 1.0,
            ..TransferSegment::default()
        };
        Judge {
            format: VoxelFormat::U8,
            layout: TexelLayout::of(VoxelFormat::U8, ValueRange::of(0.0), Layout::Plain),
            segments: vec![
                segment(0.0, 0.0),
                segment(0.25, 1.0),
                segment(0.5, 0.0),
                segment(0.75, 2.0),
            ],
            skipping: true,
        }
    }

    fn stored(least: f32, greatest: f32) -> BrickEntry {
        BrickEntry::Stored { range: ValueRange { least, greatest }, loss: 0.0 }
    }

    #[test]
    fn only_ranges_that_reach_into_visible_values_show() {
        let judge = judge();
        assert_eq!(judge.shows(&stored(0.0, 63.0)), Shows::Hidden);
        assert_eq!(judge.shows(&stored(0.0, 64.0)), Shows::Voxels);
        assert_eq!(judge.shows(&stored(128.0, 191.0)), Shows::Hidden);
        // Between two hidden ends lies a visible value.
        assert_eq!(judge.shows(&stored(10.0, 140.0)), Shows::Voxels);
        assert_eq!(judge.shows(&BrickEntry::Absent), Shows::Absent);
        assert_eq!(judge.shows(&BrickEntry::Constant([10, 0, 0, 0])), Shows::Hidden);
        assert_eq!(judge.shows(&BrickEntry::Constant([255, 0, 0, 0])), Shows::Constant([1.0; 4]));
        let all = Judge { skipping: false, ..judge };
        assert_eq!(all.shows(&stored(0.0, 63.0)), Shows::Voxels);
        assert!(matches!(all.shows(&BrickEntry::Constant([10, 0, 0, 0])), Shows::Constant(_)));
    }
}
