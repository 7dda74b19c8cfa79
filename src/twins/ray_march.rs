//! A ray's way through the volume; twin of `shaders/common/ray_march.glsl`.

use crate::twins::classify::{Block, Medium, join_block};
use crate::twins::exponential::attenuate;
use crate::twins::filter::{Texels, filtered, filtered_along};
use crate::twins::fixed_point::{Fixed3, fixed_advance, fixed_float, fixed_fraction};
use crate::twins::limits::{BLOCK_SAMPLES, SAMPLES_AT_ONCE};
use crate::twins::macrocells::{
    CODE_SHOWS, LEVEL_MAX, LEVEL_WHOLE, LEVELS_OF_DEPTH, code_at, length_of, level_of,
};
use crate::twins::preintegrate::{Content, Point, Span, composite_span};
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::transfer::{TransferSegment, classify};
use crate::volume::Macrocells;

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
pub struct Settings<'a> {
    /// Blocks of samples to take at most.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted; nothing: never.
    pub early_stop: Option<f32>,
    /// A sample is two spans, between its place and half a step before and after it.
    pub preintegrated: bool,
    /// Codes of macrocells; nothing: every sample is taken.
    pub macrocells: Option<MacrocellCodes<'a>>,
    /// For each channel, of how many samples it takes one; of those that are not listed 1.
    pub sample_every: &'a [u32],
}

/// What rays do with macrocells.
#[derive(Clone, Copy, Debug)]
pub enum MacrocellCodes<'a> {
    /// Samples in those that show nothing are left out.
    Skipping(&'a Macrocells<u8>),
    /// That, and steps are as long as they allow.
    Adaptive(&'a Macrocells<u8>),
}

/// Takes up to the settings' blocks of samples of one ray.
pub fn march_ray<'a>(
    geometry: &RayGeometry,
    state: &mut RayState,
    channels: &[Channel<'a>],
    settings: &Settings<'_>,
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
        let place = |steps: f32| -> ([i32; 3], [f32; 3]) {
            let position: [f32; 3] =
                std::array::from_fn(|a| anchor_fraction[a] + steps * step_voxel[a]);
            let cell = position.map(f32::floor);
            let within = std::array::from_fn(|a| position[a] - cell[a]);
            (std::array::from_fn(|a| anchor.cell[a] + cell[a] as i32 + 1), within)
        };
        let code = |codes: &Macrocells<u8>, steps: f32| code_at(codes, place(steps).0);
        let shows = |codes: &Macrocells<u8>, index: u32, points: &[f32]| {
            points.iter().any(|point| code(codes, index as f32 + point) >= CODE_SHOWS)
        };
        let shown = |index: u32| match settings.macrocells {
            Some(MacrocellCodes::Skipping(codes)) if settings.preintegrated => {
                shows(codes, index, &ENDS_AND_MIDDLE)
            }
            Some(MacrocellCodes::Skipping(codes)) => shows(codes, index, &[0.0]),
            _ => true,
        };
        if let Some(MacrocellCodes::Adaptive(codes)) = settings.macrocells {
            let depth = state.optical_depth;
            let intervals: Vec<Interval> = (0..samples)
                .map(|index| {
                    let of = |point: &f32| code(codes, index as f32 + point);
                    let codes = ENDS_AND_MIDDLE.iter().map(of).filter(|code| *code >= CODE_SHOWS);
                    let levels = codes.map(|code| level_of(code, depth));
                    levels.min().map_or(Interval::EMPTY, |level| Interval { shows: true, level })
                })
                .collect();
            let mut taken = 0;
            let mut hidden_by = 0.0;
            for (start, level) in joined(&intervals) {
                let (mut from, mut length) = (0.0, 0.0);
                while from < 1.0 {
                    if taken % SAMPLES_AT_ONCE == 0 {
                        hidden_by = block.depth;
                    }
                    taken += 1;
                    if from == 0.0 {
                        let longer = level + (hidden_by * LEVELS_OF_DEPTH) as u32;
                        length = length_of(longer.min(level.max(LEVEL_WHOLE)));
                    }
                    let (corner, within) = place(start as f32 - 0.5 + from + 0.5 * length);
                    block.composite(
                        mixed(channels, corner, within, None),
                        length * geometry.step_world,
                    );
                    state.samples_taken += 1;
                    from += length;
                }
            }
        } else if settings.preintegrated {
            let way = step_voxel.map(|step| 0.5 * step);
            let points: Vec<Vec<Point>> = (0..2 * samples + 1)
                .map(|index| place(0.5 * index as f32 - 0.5))
                .map(|(corner, within)| points_at(channels, corner, within, way))
                .collect();
            let shown: Vec<bool> = (0..samples).map(shown).collect();
            let begins = |at: usize| shown[at] && (at == 0 || !shown[at - 1]);
            for at in (0..samples as usize).filter(|at| shown[*at]) {
                state.samples_taken += if begins(at) { 3 } else { 2 };
                let first = 2 * at;
                for half in [first, first + 1] {
                    let content = |(index, channel): (usize, &Channel<'a>)| match *channel {
                        Channel::Scalar { segments, .. } | Channel::Rgba { segments, .. } => {
                            let span = Span::between(points[half][index], points[half + 1][index]);
                            Content::Span(span, segments)
                        }
                        Channel::Constant { segment } => Content::Constant(segment.start),
                    };
                    let contents: Vec<Content> = channels.iter().enumerate().map(content).collect();
                    composite_span(&mut block, &contents, 0.5 * geometry.step_world);
                }
            }
        } else {
            for index in (0..samples).filter(|index| shown(*index)) {
                let (corner, within) = place(index as f32);
                let sampled = Some(((index, samples), settings.sample_every));
                block.composite(mixed(channels, corner, within, sampled), geometry.step_world);
                state.samples_taken += 1;
            }
        }
        join_block(state, &block);
        state.next_sample += samples;
        if let Some(early_stop) = settings.early_stop
            && attenuate(state.optical_depth).transmitted < early_stop
        {
            state.next_sample = geometry.sample_count;
        }
    }
}

/// A sample's points, in steps from its middle.
const ENDS_AND_MIDDLE: [f32; 3] = [-0.5, 0.0, 0.5];

/// A step of the ray, or a part of it, or several.
#[derive(Clone, Copy, Debug)]
struct Interval {
    shows: bool,
    level: u32,
}

impl Interval {
    const EMPTY: Interval = Interval { shows: false, level: LEVEL_MAX };
}

/// Where samples start, with their levels: four or two aligned intervals that all allow it are joined;
/// those that show nothing are left out.
fn joined(intervals: &[Interval]) -> Vec<(usize, u32)> {
    let mut starts = Vec::new();
    let mut at = 0;
    while at < intervals.len() {
        let group = |edge: usize, level: u32| {
            let group = intervals.get(at..at + edge).filter(|_| at.is_multiple_of(edge));
            group.filter(|group| group.iter().all(|interval| interval.level >= level))
        };
        let (group, level) = match (group(4, LEVEL_MAX), group(2, LEVEL_MAX - 1)) {
            (Some(four), _) => (four, LEVEL_MAX),
            (None, Some(two)) => (two, LEVEL_MAX - 1),
            (None, None) => (&intervals[at..=at], intervals[at].level.min(LEVEL_WHOLE)),
        };
        if group.iter().any(|interval| interval.shows) {
            starts.push((at, level));
        }
        at += group.len();
    }
    starts
}

/// A point of every channel; of channels of one value, nothing.
fn points_at(
    channels: &[Channel],
    corner: [i32; 3],
    within: [f32; 3],
    way: [f32; 3],
) -> Vec<Point> {
    let point = |channel: &Channel| match channel {
        Channel::Scalar { texels, segments } => {
            let along = filtered_along(texels, corner, within, way, |texel| texel);
            Point::new([1.0; 3], along, segments)
        }
        Channel::Rgba { texels, segments } => {
            let rgb = filtered(texels, corner, within, |[r, g, b, _]| [r, g, b]);
            let along = filtered_along(texels, corner, within, way, |texel| texel[3]);
            Point::new(rgb, along, segments)
        }
        Channel::Constant { .. } => Point::NONE,
    };
    channels.iter().map(point).collect()
}

/// Colour and extinction of all channels together, of those that take the sample of this number in a block of
/// so many; else of all.
fn mixed(
    channels: &[Channel],
    corner: [i32; 3],
    within: [f32; 3],
    sampled: Option<((u32, u32), &[u32])>,
) -> ([f32; 3], f32) {
    let classified = |channel: &Channel| match channel {
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
    };
    let mut medium = Medium::new(channels.len() > 1);
    for (at, channel) in channels.iter().enumerate() {
        let rate = sampled.and_then(|(number, every)| Some((number, *every.get(at)?)));
        match rate.filter(|_| !matches!(channel, Channel::Constant { .. })) {
            Some((number, every)) => {
                medium.mix_in_every(|| classified(channel), number, every);
            }
            None => medium.mix_in(classified(channel)),
        }
    }
    medium.mixed()
}
