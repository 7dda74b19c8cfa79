//! A coarse level of the volume in memory: histograms of its channels, and where a ray meets what is shown.

use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::render::VolumeData;
use crate::scene::{Channel, View};
use crate::volume::VolumeVoxels;

/// Values of one channel, counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Scaled values at the first bin's beginning and the last one's end.
    pub range: [f64; 2],
    /// Voxels in bins of equal width.
    pub bins: Vec<u32>,
}

/// The finest level with few enough voxels.
#[derive(Clone)]
pub struct Overview {
    /// Which one.
    pub level: u8,
    voxels: Arc<VolumeVoxels>,
    /// By shown channel, in the scene's order.
    pub histograms: Vec<Histogram>,
}

/// Where a ray meets what is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    /// The place, world.
    pub at: DVec3,
    /// How far it may be off along the ray, world units: a voxel of the level that was looked at.
    pub within: f64,
}

/// Voxels of all shown channels together.
const VOXELS_MAX: u128 = 4 << 20;
/// Bins of a histogram.
const BINS: usize = 256;
/// Rays that let more through than this meet nothing.
const MEETS: f64 = 0.01;

impl Overview {
    /// Reads the finest level that has few enough voxels, else the coarsest.
    ///
    /// # Errors
    /// As reading does.
    pub fn new(data: &VolumeData) -> Result<Overview> {
        let description = data.source.description();
        let shown = data.shown().count().max(1) as u128;
        let few = |level: &u8| {
            let size = description.levels.get(*level).map(|level| level.size.voxel_count());
            size.is_some_and(|voxels| voxels * shown <= VOXELS_MAX)
        };
        let count = description.levels.count();
        let level = (0..count as u8).find(few).unwrap_or(count.saturating_sub(1) as u8);
        let voxels = data.level(level)?;
        let histograms = (0..voxels.channels.len()).map(|of| histogram(&voxels, of)).collect();
        Ok(Overview { level, voxels, histograms })
    }

    /// Where the ray of a pixel has half of what it gathers behind it: the nearest voxels' values, two samples a
    /// voxel. Nothing where hardly anything is gathered. `channels`: as the scene shows them.
    pub fn meets(
        &self,
        channels: &[Channel],
        view: &View,
        size: [u32; 2],
        pixel: [u32; 2],
    ) -> Option<Met> {
        let frame_world = view.ray_frame_world(size);
        let frame = frame_world.in_voxels(&self.voxels.world_from_voxel);
        let [column, row] = pixel;
        let (origin, direction) = frame.ray(column, row);
        let (origin_world, direction_world) = frame_world.ray(column, row);
        let extent = self.voxels.size.to_array().map(f64::from);
        let mut ends = [0.0f64, f64::INFINITY];
        for axis in 0..3 {
            if direction[axis] == 0.0 {
                if !(0.0..extent[axis]).contains(&origin[axis]) {
                    return None;
                }
                continue;
            }
            let meets = [0.0, extent[axis]].map(|face| (face - origin[axis]) / direction[axis]);
            ends = [ends[0].max(meets[0].min(meets[1])), ends[1].min(meets[0].max(meets[1]))];
        }
        let step = 0.5 / direction.abs().max_element();
        let step_world = step * direction_world.length();
        let steps = ((ends[1] - ends[0]) / step).ceil();
        if !(steps > 0.0 && steps < 1e6) {
            return None;
        }
        let depths: Vec<f64> = (0..steps as usize)
            .scan(0.0, |depth, number| {
                let at = origin + (ends[0] + (number as f64 + 0.5) * step) * direction;
                *depth += step_world * self.extinction(channels, at);
                Some(*depth)
            })
            .collect();
        let gathered = |depth: f64| -(-depth).exp_m1();
        let all = gathered(*depths.last()?);
        if all < MEETS {
            return None;
        }
        let half = depths.iter().position(|depth| gathered(*depth) >= all / 2.0)?;
        let t = ends[0] + (half as f64 + 0.5) * step;
        Some(Met { at: origin_world + t * direction_world, within: 2.0 * step_world })
    }

    /// Of all channels, at a place in voxels.
    fn extinction(&self, channels: &[Channel], at: DVec3) -> f64 {
        let size = self.voxels.size.to_array();
        let index = (0..3).rev().fold(0, |index, axis| {
            let inside = (at[axis].max(0.0) as u32).min(size[axis] - 1);
            index * size[axis] as usize + inside as usize
        });
        let of_channel = |(channel, of): (&Channel, &crate::volume::ChannelVoxels)| {
            let scaled = f64::from(of.voxels.value(index)) * of.slope + of.intercept;
            let [low, high] = channel.window;
            let at = (scaled - low) / (high - low);
            if at.is_nan() { 0.0 } else { channel.transfer.at(at).extinction }
        };
        channels.iter().zip(&self.voxels.channels).map(of_channel).sum()
    }
}

fn histogram(voxels: &VolumeVoxels, channel: usize) -> Histogram {
    let of = &voxels.channels[channel];
    let range = of.voxels.range();
    let scaled = |stored: f64| stored * of.slope + of.intercept;
    let ends = [scaled(f64::from(range.least)), scaled(f64::from(range.greatest))];
    let range = [ends[0].min(ends[1]), ends[0].max(ends[1])];
    let mut bins = vec![0u32; BINS];
    let width = range[1] - range[0];
    if !(width.is_finite() && width > 0.0) {
        return Histogram { range, bins };
    }
    for index in 0..of.voxels.len() {
        let part = (scaled(f64::from(of.voxels.value(index))) - range[0]) / width;
        // NaN is nothing here.
        if (0.0..=1.0).contains(&part) {
            let bin = &mut bins[((part * BINS as f64) as usize).min(BINS - 1)];
            *bin = bin.saturating_add(1);
        }
    }
    Histogram { range, bins }
}
