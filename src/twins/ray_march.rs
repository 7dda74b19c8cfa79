//! A ray's way through the volume; twin of `shaders/common/ray_march.glsl`.

use crate::twins::classify::{Block, Medium, join_block};
use crate::twins::exponential::attenuate;
use crate::twins::filter::{Texels, filtered};
use crate::twins::fixed_point::{Fixed3, fixed_advance, fixed_float, fixed_fraction};
use crate::twins::limits::BLOCK_SAMPLES;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::transfer::{TransferSegment, classify};

/// A channel as the shader sees it.
pub enum Channel<'a> {
    /// One value per voxel.
    Scalar {
        /// With an apron of one on every side.
        texels: Texels<'a, f32>,
        /// The channel's transfer function.
        segments: &'a [TransferSegment],
    },
    /// A colour per voxel, classified by its alpha.
    Rgba {
        /// With an apron of one on every side.
        texels: Texels<'a, [f32; 4]>,
        /// The channel's transfer function.
        segments: &'a [TransferSegment],
    },
    /// Every voxel has one value, classified by the host.
    Constant {
        /// Its one segment.
        segment: &'a TransferSegment,
    },
}

/// What shapes the shader beside its channels.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Blocks of samples to take at most.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted; nothing: never.
    pub early_stop: Option<f32>,
}

/// Takes up to the settings' blocks of samples of one ray.
pub fn march_ray(
    geometry: &RayGeometry,
    state: &mut RayState,
    channels: &[Channel],
    settings: &Settings,
) {
    let start = Fixed3 { cell: geometry.start_cell, fraction: geometry.start_fraction };
    let delta = Fixed3 { cell: geometry.delta_cell, fraction: geometry.delta_fraction };
    let step_voxel = fixed_float(delta);
    for _ in 0..settings.blocks_max {
        if state.next_sample >= geometry.sample_count {
            return;
        }
        let anchor = fixed_advance(start, delta, state.next_sample);
        let anchor_fraction = fixed_fraction(anchor.fraction);
        let samples = BLOCK_SAMPLES.min(geometry.sample_count - state.next_sample);
        let mut block = Block::EMPTY;
        for index in 0..samples {
            let position: [f32; 3] =
                std::array::from_fn(|a| anchor_fraction[a] + index as f32 * step_voxel[a]);
            let cell = position.map(f32::floor);
            let within = std::array::from_fn(|a| position[a] - cell[a]);
            let corner = std::array::from_fn(|a| anchor.cell[a] + cell[a] as i32 + 1);
            block.composite(mixed(channels, corner, within), geometry.step_world);
        }
        join_block(state, &block);
        state.samples_taken += samples;
        state.next_sample += samples;
        if let Some(early_stop) = settings.early_stop
            && attenuate(state.optical_depth).transmitted < early_stop
        {
            state.next_sample = geometry.sample_count;
        }
    }
}

/// Colour and extinction of all channels together.
fn mixed(channels: &[Channel], corner: [i32; 3], within: [f32; 3]) -> ([f32; 3], f32) {
    let classified = channels.iter().map(|channel| match channel {
        Channel::Scalar { texels, segments } => {
            let [texel] = filtered(texels, corner, within, |texel| [texel]);
            if texel.is_nan() { [0.0; 4] } else { classify(segments, texel) }
        }
        Channel::Rgba { texels, segments } => {
            let texel = filtered(texels, corner, within, |texel| texel);
            let by_alpha = classify(segments, texel[3]);
            std::array::from_fn(|part| {
                if part < 3 { texel[part] * by_alpha[part] } else { by_alpha[part] }
            })
        }
        Channel::Constant { segment } => segment.start,
    });
    let mut medium = Medium::new(channels.len() > 1);
    classified.for_each(|classified| medium.mix_in(classified));
    medium.mixed()
}
