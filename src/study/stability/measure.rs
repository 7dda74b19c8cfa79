//! Draws a case every way and says what does not hold.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::PagingSettings;
use crate::render::{Addressing, Plan, Renderer, SceneData, Settings};
use crate::scene::Overrides;
use crate::study::stability::Case;

/// More than f32 loses where two ways differ by roundings alone: bricks of one value are not
/// interpolated.
const ROUNDING: f64 = 2e-6;
/// Pictures without a brighter component are measured against it.
const NEARLY_BLACK: f64 = 1e-3;
/// What the adaptive integrator is asked for, and then held to in every case.
const TOLERANCE: f64 = 1e-3;
/// Slots of the atlases: for a sixteenth of the bricks, but as many as the loop takes; and for more.
const BRICKS_PER_SLOT: u32 = 16;
const SLOTS_MIN: u32 = 2;
const SLOTS_MORE: u32 = 24;
/// Voxels of a brick: borders everywhere, and none.
const PAYLOADS: [u32; 2] = [8, 32];

type Pixels = Vec<[f32; 4]>;

/// What came out. Errors are in the module's units.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Against the reference, drawn directly where the device has images of that size.
    pub error: f64,
    /// The same with half the step.
    pub error_halved: f64,
    /// Of bricks against direct.
    pub paged: f64,
    /// What both errors were held to.
    pub bound: f64,
    /// What does not hold, one sentence each.
    pub complaints: Vec<String>,
}

struct Draws<'a> {
    gpu: &'a Arc<Gpu>,
    compiler: &'a ShaderCompiler,
    case: &'a Case,
    integrator: &'a str,
}

/// Draws the case and holds it to all that must hold.
///
/// # Errors
/// When the device fails. What does not hold is no error: it is in the outcome.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    case: &Case,
    integrator: &str,
) -> Result<Outcome> {
    let draws = Draws { gpu, compiler, case, integrator };
    let truth = case.truth()?;
    let brightest = truth.iter().flatten().fold(0.0, |most: f64, part| most.max(*part));
    let unit = if brightest > 0.0 && brightest < NEARLY_BLACK { brightest } else { 1.0 };
    let bound = match (integrator, case.spans) {
        // A tolerance is absolute.
        ("adaptive", _) => TOLERANCE / unit + ROUNDING,
        ("preintegrated", Some(bound)) => bound,
        _ => case.bound,
    };
    // Samples that reach beyond a brick's border are refused in pages: there is nothing to compare.
    let in_pages = match integrator {
        "preintegrated" => case.spans_fit_bricks(),
        "adaptive" => false,
        _ => true,
    };

    let direct = draws.direct(case.step, 1.0)?;
    let halved = draws.direct(0.5 * case.step, 1.0)?;
    let thicker = draws.direct(case.step, 2.0)?;
    let bricks: u32 =
        case.voxels.size.to_array().map(|edge| edge.div_ceil(PAYLOADS[0])).iter().product();
    let few = (bricks / BRICKS_PER_SLOT).max(SLOTS_MIN);
    let paged = |payload, slots| match in_pages {
        true => draws.paged(payload, slots, Some(0)),
        false => Ok(direct.clone()),
    };
    let bordered = paged(PAYLOADS[0], few)?;
    let roomy = paged(PAYLOADS[0], few + SLOTS_MORE)?;
    let whole = paged(PAYLOADS[1], few + SLOTS_MORE)?;
    let leveled =
        (case.any_level && in_pages).then(|| draws.paged(PAYLOADS[0], few, None)).transpose()?;

    let error = greatest(&direct, &truth) / unit;
    let error_halved = greatest(&halved, &truth) / unit;
    let step = apart(&direct, &halved) / unit;
    let paged = apart(&direct, &bordered).max(apart(&direct, &whole)) / unit;
    let mut complaints = Vec::new();
    let mut hold = |what: &str, got: f64, most: f64| {
        // NaN holds nothing.
        if got.is_nan() || got > most {
            complaints.push(format!("{what}: {got:.2e}, at most {most:.2e} ({})", case.reason));
        }
    };
    hold("error against the reference", error, bound);
    hold("error with half the step", error_halved, bound);
    hold("change with half the step", step, bound);
    hold("change through bricks", paged, ROUNDING);
    hold("change with the atlas", apart(&bordered, &roomy) / unit, 0.0);
    if let Some(leveled) = &leveled {
        hold("change with the level", apart(&direct, leveled) / unit, bound);
    }
    if let Some(alpha) = case.alpha {
        let truths = truth.iter().map(|pixel| (pixel[3] - alpha).abs()).fold(0.0, f64::max);
        let closed = |pixel: &[f32; 4]| (f64::from(pixel[3]) - alpha).abs();
        hold("the reference against the closed form", truths / unit, 1e-8);
        hold(
            "alpha against the closed form",
            direct.iter().map(closed).fold(0.0, f64::max) / unit,
            bound,
        );
    }
    let falls = direct.iter().zip(&thicker).map(|(thin, thick)| f64::from(thin[3] - thick[3]));
    hold("more extinction lets more through", falls.fold(0.0, f64::max) / unit, 1.2e-7);
    if case.dark != (brightest == 0.0) {
        complaints.push(format!("the brightest of the true picture is {brightest:.2e}"));
    }
    let ways = [
        ("direct", &direct),
        ("half the step", &halved),
        ("twice the extinction", &thicker),
        ("bricks of 8", &bordered),
        ("one brick", &whole),
    ];
    for (way, pixels) in ways {
        if let Some(bad) = pixels.iter().find(|pixel| !is_sound(pixel)) {
            complaints.push(format!("{way}: a pixel is {bad:?}"));
        }
    }
    Ok(Outcome { error, error_halved, paged, bound, complaints })
}

fn is_sound(pixel: &[f32; 4]) -> bool {
    pixel.iter().all(|part| part.is_finite()) && (0.0..=1.0).contains(&pixel[3])
}

/// Infinite where it is no number: a NaN would hide in a maximum.
fn difference(a: f64, b: f64) -> f64 {
    let apart = (a - b).abs();
    if apart.is_nan() { f64::INFINITY } else { apart }
}

fn greatest(got: &Pixels, truth: &[[f64; 4]]) -> f64 {
    let parts = got.iter().flatten().zip(truth.iter().flatten());
    parts.map(|(got, truth)| difference(f64::from(*got), *truth)).fold(0.0, f64::max)
}

fn apart(some: &Pixels, others: &Pixels) -> f64 {
    let parts = some.iter().flatten().zip(others.iter().flatten());
    parts.map(|(a, b)| difference(f64::from(*a), f64::from(*b))).fold(0.0, f64::max)
}

impl Draws<'_> {
    fn direct(&self, step: f64, thicker: f64) -> Result<Pixels> {
        let overrides = self.overrides(step, Some(0));
        let data = self.case.data(PAYLOADS[1], thicker, &overrides)?;
        self.drawn(&data, Settings { addressing: Addressing::Auto, ..Settings::default() })
    }

    fn paged(&self, payload: u32, slots: u32, level_max: Option<i64>) -> Result<Pixels> {
        let overrides = self.overrides(self.case.step, level_max);
        let data = self.case.data(payload, 1.0, &overrides)?;
        let paging = PagingSettings { atlas_slots: Some(slots), ..PagingSettings::default() };
        self.drawn(&data, Settings { addressing: Addressing::Paged, paging, ..Settings::default() })
    }

    fn overrides(&self, step: f64, level_max: Option<i64>) -> Overrides {
        Overrides {
            size: Some(self.case.size),
            integrator: Some(self.integrator.to_owned()),
            step: Some(step),
            tolerance: (self.integrator == "adaptive").then_some(TOLERANCE),
            level_max,
            early_stop: Some(0.0),
            ..Overrides::default()
        }
    }

    fn drawn(&self, data: &SceneData, settings: Settings) -> Result<Pixels> {
        let plan = Plan::new(self.gpu, self.compiler, data, &settings.checked()?)?;
        let mut renderer = Renderer::new(self.gpu, plan, data)?;
        Ok(renderer.draw(0, &mut |_| {})?.0.pixels)
    }
}
