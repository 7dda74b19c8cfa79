//! What a picture's own settings may have cost it, pixel by pixel, with no reference at hand.
//!
//! Three parts, each the greatest error of r, g and b over the background, linear:
//!
//! - *step*, an **estimate**: the same rays drawn with steps twice as long (half as long where longer ones are
//!   refused), filter exact. Where half the step has at most half the error, the difference is no less than
//!   the error. Two errors may be equal at a pixel by chance, so the greatest difference among a pixel and
//!   its eight neighbours counts.
//! - *early stop*, a **bound**: what a ray that ended still lets through, times the brightest colour there is.
//! - *levels*, an **estimate**: levels above 0 drawn one level coarser (or finer, where there is no coarser
//!   one), twice the difference; the neighbours count as for the step. It holds where a finer level takes a
//!   third off the error (or half of it). Refinement by
//!   substitution that could not end is **measured** beside it: the scene is drawn again with exact
//!   refinement, which ends in any atlas.
//!
//! The total is their sum and that of rounding in f32. What bricks that could not be read would have shown
//! is in no part.

use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Exit, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::{Addressing, Picture, Plan, Renderer, SceneData, Settings, Statistics};
use crate::scene::{Filter, Integrator, Quality, Refine};
use crate::study::layout_price;

/// Rounding of f32 over some hundred samples, for colours up to 1.
const ROUNDING: f32 = 2e-6;
/// Error of a level over its difference to the coarser one where a finer level takes a third off, and to the
/// finer one where it halves the error.
const LEVEL_FACTOR: f32 = 2.0;

/// A view as it was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Its picture.
    pub picture: Picture,
    /// What it cost.
    pub statistics: Statistics,
}

/// How a part is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum How {
    /// No error can be greater.
    Bound,
    /// From the difference to another drawing; see the module for when it holds.
    Estimate,
    /// The difference to the picture that it should have been.
    Measured,
}

impl How {
    /// The word.
    pub const fn name(self) -> &'static str {
        match self {
            How::Bound => "bound",
            How::Estimate => "estimate",
            How::Measured => "measured",
        }
    }
}

/// One part of the error of every pixel.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// "step", "early_stop" or "levels": the layer is called error.NAME.
    pub name: &'static str,
    /// How it is known.
    pub how: How,
    /// What it was found from.
    pub from: String,
    /// Greatest of all pixels.
    pub max: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// Row by row.
    #[serde(skip)]
    pub values: Vec<f32>,
}

/// The error of every pixel of a view.
#[derive(Clone, Debug, Serialize)]
pub struct ErrorEstimate {
    /// Parts that the picture has; what costs nothing is left out.
    pub parts: Vec<Part>,
    /// Greatest total of all pixels.
    pub max: f64,
    /// Root of the mean square of the total.
    pub rms: f64,
    /// PSNR that the total amounts to, dB.
    pub psnr_db: f64,
    /// Samples of the drawings that it was compared with.
    pub control_samples: u64,
    /// Time of these drawings, ms.
    pub control_ms: f64,
    /// Sum of all parts and of rounding, row by row.
    #[serde(skip)]
    pub total: Vec<f32>,
}

/// How much of the true error an estimate covers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Part of the pixels whose true error is at most the estimate.
    pub covered: f64,
    /// The greatest true error less its estimate; 0 where all are covered.
    pub beyond_max: f64,
    /// Root mean square of the estimate over that of the true error: how far it is on the safe side.
    pub over_truth: f64,
    /// Root mean square of the true error.
    pub true_rms: f64,
}

/// What a plan says of the pictures that were drawn by it.
#[derive(Clone, Debug)]
pub struct DrawnBy {
    /// Whether rays take samples at distances; else one sample is exact.
    samples: bool,
    /// Whether voxels were had from bricks.
    paged: bool,
    /// Coarsest level in each view.
    coarsest: Vec<u8>,
    /// The volume's coarsest.
    last: u8,
    /// Whether some channel was drawn coarser than rays were.
    channel_levels: bool,
}

impl DrawnBy {
    /// The facts of a plan of `data`.
    pub fn plan(plan: &Plan, data: &SceneData) -> DrawnBy {
        DrawnBy {
            samples: plan.step_world.is_some(),
            paged: plan.addressing == "paged",
            coarsest: (0..plan.views.len()).map(|view| plan.coarsest_level(view)).collect(),
            last: (data.volumes[0].source.description().levels.count() - 1) as u8,
            channel_levels: plan.finest_levels().iter().any(|level| *level > 0),
        }
    }
}

/// Where the drawings of a scene come from.
pub struct Drawing<'a> {
    /// The device.
    pub gpu: &'a Arc<Gpu>,
    /// Of shaders.
    pub compiler: &'a ShaderCompiler,
    /// As the pictures were drawn.
    pub settings: Settings,
    /// Told what is drawn, and which part of it is done.
    pub progress: &'a mut dyn FnMut(&str, f64),
}

impl Drawing<'_> {
    /// Estimates the error of every view of `data`, drawn as `drawn`. The scene's quality is changed
    /// meanwhile, and put back.
    ///
    /// # Errors
    /// As drawing does; exit code 5 when a drawing to compare with cannot be finished.
    pub fn estimate(
        &mut self,
        data: &mut SceneData,
        by: &DrawnBy,
        drawn: &[Drawn],
    ) -> Result<Vec<ErrorEstimate>> {
        let asked = data.scene.quality.clone();
        let channels = data.scene.volumes[0].channels.clone();
        // What they are compared with has all channels at the level that rays are in.
        data.scene.volumes[0].channels.iter_mut().for_each(|channel| {
            channel.level_min = 0;
            channel.sample_every = 1;
        });
        let found = self.compared(data, by, drawn, &asked);
        data.scene.quality = asked;
        data.scene.volumes[0].channels = channels;
        found
    }

    fn compared(
        &mut self,
        data: &mut SceneData,
        by: &DrawnBy,
        drawn: &[Drawn],
        asked: &Quality,
    ) -> Result<Vec<ErrorEstimate>> {
        let settings = self.settings;
        let size = data.scene.picture.size;
        let brightest = brightest(data);
        let mut parts = vec![Vec::new(); drawn.len()];
        let mut costs = vec![(0, 0.0); drawn.len()];
        let mut controls = |quality: Quality, settings: Settings, what: &str| {
            data.scene.quality = quality;
            let controls = self.draw(data, &settings, what)?;
            for (cost, control) in costs.iter_mut().zip(&controls) {
                cost.0 += control.statistics.samples;
                cost.1 += control.statistics.wall_ms;
            }
            Ok::<_, Error>(controls)
        };
        let waits = Quality { refine: Refine::Exact, level_loss: None, ..asked.clone() };
        let exact = Quality { filter: Filter::Exact, ..waits.clone() };
        // What the pictures should have been, where they could not be finished or channels were coarser.
        let mut finished = None;
        if by.channel_levels || drawn.iter().any(|view| !view.statistics.converged) {
            let what = "refine exact";
            let controls = controls(waits.clone(), settings, what)?;
            for ((parts, view), control) in parts.iter_mut().zip(drawn).zip(&controls) {
                let values = difference(&view.picture, &control.picture, 1.0);
                parts.push(Part::new("levels", How::Measured, what.to_owned(), values));
            }
            finished = Some(controls);
        }
        let finished = finished.as_deref().unwrap_or(drawn);
        if by.samples {
            let (quality, settings, factor, what) = other_step(exact, settings, by.paged);
            let controls = controls(quality, settings, &what)?;
            for ((parts, view), control) in parts.iter_mut().zip(finished).zip(&controls) {
                let values = spread(&difference(&view.picture, &control.picture, factor), size);
                parts.push(Part::new("step", How::Estimate, what.clone(), values));
            }
        }
        let ray_end = asked.ray_end() as f32;
        if ray_end > 0.0 && by.samples {
            for (parts, view) in parts.iter_mut().zip(drawn) {
                let values =
                    view.picture.pixels.iter().map(|pixel| cut_off(*pixel, ray_end, brightest));
                let from = format!("rays end below {ray_end} transmitted");
                parts.push(Part::new("early_stop", How::Bound, from, values.collect()));
            }
        }
        if by.coarsest.iter().any(|level| *level > 0) {
            // Of the coarsest level there is no coarser one.
            let (level_shift, what) = match by.coarsest.contains(&by.last) {
                false => (1, "levels above 0 one coarser"),
                true => (-1, "levels above 0 one finer"),
            };
            let shifted = Settings { level_shift, addressing: Addressing::Paged, ..settings };
            let controls = controls(waits, shifted, what)?;
            for ((parts, view), control) in parts.iter_mut().zip(finished).zip(&controls) {
                let apart = difference(&view.picture, &control.picture, LEVEL_FACTOR);
                let values = spread(&apart, size);
                merge(parts, Part::new("levels", How::Estimate, what.to_owned(), values));
            }
        }
        let views = parts.into_iter().zip(costs).zip(drawn);
        let estimates = views
            .map(|((parts, cost), view)| ErrorEstimate::new(parts, cost, &view.picture, brightest));
        Ok(estimates.collect())
    }

    fn draw(&mut self, data: &SceneData, settings: &Settings, what: &str) -> Result<Vec<Drawn>> {
        let plan = layout_price::plan(self.gpu, self.compiler, data, settings)?;
        let mut renderer = Renderer::new(self.gpu, plan, data)?;
        let views = data.scene.views.len();
        (0..views)
            .map(|view| {
                let mut told = |part: f64| {
                    (self.progress)(what, (view as f64 + part) / views as f64);
                };
                let (picture, statistics) = renderer.draw(view, &mut told)?;
                match &statistics.unfinished {
                    None => Ok(Drawn { picture, statistics }),
                    Some(why) => Err(Error {
                        exit: Exit::Incomplete,
                        message: format!(
                            "--error: view \"{}\" drawn with {what} to compare with is unfinished: {why}",
                            data.scene.views[view].name
                        ),
                    }),
                }
            })
            .collect()
    }
}

impl ErrorEstimate {
    fn new(
        parts: Vec<Part>,
        (samples, ms): (u64, f64),
        picture: &Picture,
        brightest: f32,
    ) -> ErrorEstimate {
        let rounding = ROUNDING * brightest.max(1.0);
        let sum = |(at, pixel): (usize, &[f32; 4])| {
            // Of nothing there is nothing to round.
            let rounded = if pixel[3] == 0.0 { 0.0 } else { rounding };
            parts.iter().map(|part| part.values[at]).sum::<f32>() + rounded
        };
        let total: Vec<f32> = picture.pixels.iter().enumerate().map(sum).collect();
        let (max, rms) = figures(&total);
        // JSON has no infinity.
        let psnr_db = -20.0 * rms.max(1e-30).log10();
        let (control_samples, control_ms) = (samples, ms);
        ErrorEstimate { parts, max, rms, psnr_db, control_samples, control_ms, total }
    }

    /// The total and its parts as layers of a picture file.
    pub fn layers(&self) -> Vec<(String, &[f32])> {
        let parts = self.parts.iter().map(|part| (part.name, &part.values[..]));
        let all = parts.chain([("total", &self.total[..])]);
        all.map(|(name, values)| (format!("error.{name}"), values)).collect()
    }
}

/// How much of the error of `picture` against `truth` the `total` of its estimate covers. Pixels that
/// cannot be compared are not covered.
///
/// # Panics
/// When sizes differ: our own bug.
pub fn coverage(total: &[f32], picture: &[[f32; 4]], truth: &[[f64; 4]]) -> Coverage {
    assert!(total.len() == picture.len() && picture.len() == truth.len(), "pictures of one size");
    let (mut covered, mut beyond_max) = (0_usize, 0.0_f64);
    let (mut of_truth, mut of_estimate) = (0.0, 0.0);
    for ((estimate, got), truth) in total.iter().zip(picture).zip(truth) {
        let apart = (0..3).map(|part| (f64::from(got[part]) - truth[part]).abs());
        let error = apart.fold(
            0.0,
            |most: f64, apart| if apart > most || apart.is_nan() { apart } else { most },
        );
        let estimate = f64::from(*estimate);
        if error <= estimate {
            covered += 1;
        } else {
            beyond_max =
                if error.is_nan() { f64::INFINITY } else { beyond_max.max(error - estimate) };
        }
        of_truth += error * error;
        of_estimate += estimate * estimate;
    }
    let pixels = total.len().max(1) as f64;
    Coverage {
        covered: covered as f64 / pixels,
        beyond_max,
        over_truth: (of_estimate / of_truth.max(1e-60)).sqrt(),
        true_rms: (of_truth / pixels).sqrt(),
    }
}

impl Part {
    fn new(name: &'static str, how: How, from: String, values: Vec<f32>) -> Part {
        let (max, rms) = figures(&values);
        Part { name, how, from, max, rms, values }
    }
}

/// Adds a part to one of its name, which then is as uncertain as both.
fn merge(parts: &mut Vec<Part>, other: Part) {
    let Some(at) = parts.iter().position(|part| part.name == other.name) else {
        parts.push(other);
        return;
    };
    let part = parts.swap_remove(at);
    let values = part.values.iter().zip(&other.values).map(|(a, b)| a + b).collect();
    parts.push(Part::new(
        part.name,
        How::Estimate,
        format!("{}; {}", part.from, other.from),
        values,
    ));
}

/// The quality and settings to compare with, by how much a difference is taken, and its name.
fn other_step(
    quality: Quality,
    settings: Settings,
    paged: bool,
) -> (Quality, Settings, f32, String) {
    let step = quality.step;
    match quality.integrator {
        // A greater tolerance need not give longer steps: some are as long as any.
        Integrator::Adaptive => {
            let settings = Settings { steps_longer: 1, ..settings };
            (quality, settings, 1.0, "steps twice as long".to_owned())
        }
        // Longer spans may not fit a brick's border.
        Integrator::Preintegrated if paged => {
            let step = 0.5 * step;
            (Quality { step, ..quality }, settings, 2.0, format!("step {step}"))
        }
        Integrator::Riemann | Integrator::Preintegrated => {
            let step = 2.0 * step;
            (Quality { step, ..quality }, settings, 1.0, format!("step {step}"))
        }
    }
}

/// Greatest component of any colour: of the scene's transfer functions, which voxels' own colours only
/// lessen, and of the background.
fn brightest(data: &SceneData) -> f32 {
    let scene = &data.scene;
    let channels = scene.volumes.iter().flat_map(|volume| &volume.channels);
    let points = channels.flat_map(|channel| channel.transfer.points());
    let colors = points.flat_map(|point| point.color).fold(0.0, f64::max) as f32;
    scene.picture.background.iter().copied().fold(colors, f32::max)
}

/// What a ray may have left out that ended since less than `ray_end` was transmitted.
fn cut_off(pixel: [f32; 4], ray_end: f32, brightest: f32) -> f32 {
    let transmitted = 1.0 - pixel[3] + f32::EPSILON;
    if transmitted < ray_end { transmitted * brightest } else { 0.0 }
}

/// Greatest difference of r, g and b of every pixel, times `factor`.
fn difference(picture: &Picture, other: &Picture, factor: f32) -> Vec<f32> {
    let pairs = picture.pixels.iter().zip(&other.pixels);
    let apart = |(a, b): (&[f32; 4], &[f32; 4])| {
        factor * (0..3).map(|part| (a[part] - b[part]).abs()).fold(0.0, f32::max)
    };
    pairs.map(apart).collect()
}

/// The greatest among each pixel and its neighbours.
fn spread(values: &[f32], [width, height]: [u32; 2]) -> Vec<f32> {
    let (width, height) = (width as usize, height as usize);
    let near = |at: usize, edge: usize| at.saturating_sub(1)..(at + 2).min(edge);
    let greatest = |at: usize| {
        let rows = near(at / width, height);
        let columns = near(at % width, width);
        let around = rows.flat_map(|y| columns.clone().map(move |x| values[y * width + x]));
        around.fold(0.0, f32::max)
    };
    (0..values.len()).map(greatest).collect()
}

/// Greatest, and root of the mean square.
fn figures(values: &[f32]) -> (f64, f64) {
    let wide = || values.iter().map(|value| f64::from(*value));
    let squares: f64 = wide().map(|value| value * value).sum();
    (wide().fold(0.0, f64::max), (squares / values.len().max(1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_has_the_greatest_of_its_neighbours() {
        let mut values = vec![0.0; 12];
        values[5] = 1.0; // column 1, row 1 of 4 x 3
        values[11] = 0.5; // column 3, row 2
        let wide = spread(&values, [4, 3]);
        let expected = [1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 0.5];
        assert_eq!(wide, expected);
    }

    #[test]
    fn coverage_counts_pixels_beyond_their_estimate() {
        let picture = [[0.5, 0.5, 0.5, 1.0], [0.0; 4], [f32::NAN, 0.0, 0.0, 1.0], [1.0; 4]];
        let truth = [[0.5, 0.6, 0.5, 1.0], [0.0; 4], [0.0; 4], [0.75, 1.0, 1.0, 1.0]];
        let found = coverage(&[0.2, 0.0, 9.0, 0.125], &picture, &truth);
        assert_eq!((found.covered, found.beyond_max), (0.5, f64::INFINITY));
        let found = coverage(&[0.2, 0.0], &picture[..2], &truth[..2]);
        assert_eq!((found.covered, found.beyond_max), (1.0, 0.0));
        assert!(
            (found.over_truth - 2.0).abs() < 1e-6
                && (found.true_rms - 0.005_f64.sqrt()).abs() < 1e-9
        );
    }

    #[test]
    fn only_rays_that_ended_are_cut_off() {
        assert_eq!(cut_off([0.0, 0.0, 0.0, 0.75], 0.125, 3.0), 0.0);
        let cut = cut_off([0.0, 0.0, 0.0, 0.9375], 0.125, 3.0);
        assert!((cut - 0.1875).abs() < 1e-6, "{cut}");
    }
}
