//! What each feature costs: the fullest scene of the ladder against the same without the feature, in
//! objects, shader instructions, bytes and the time of a frame.
//!
//! # Invariants
//! Frames are drawn with everything on the device already; all scenes take turns, and each ratio is of
//! frames of one turn.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;

use crate::error::Result;
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::Plan;
use crate::study::ladder::{Extent, Feature, inventory, scene};
use crate::study::repeated::{Spread, Timer};
use crate::study::resident_frames::{ResidentScene, draw_in_turns};

/// What a plan counts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Counts {
    /// Vulkan objects of all kinds.
    pub objects: u64,
    /// The same by kind.
    pub objects_of_kind: BTreeMap<&'static str, u64>,
    /// Passes, each a shader variant.
    pub passes: usize,
    /// Buffers.
    pub buffers: usize,
    /// Images.
    pub images: usize,
    /// Bindings of all passes.
    pub bindings: usize,
    /// SPIR-V instructions of all passes.
    pub spirv_instructions: u32,
    /// Device memory of everything, bytes.
    pub memory_bytes: u64,
}

impl Counts {
    /// Of a plan.
    pub fn of(plan: &Plan) -> Counts {
        Counts {
            objects: plan.objects.values().sum(),
            objects_of_kind: plan.objects.clone(),
            passes: plan.passes.len(),
            buffers: plan.buffers.len(),
            images: plan.images.len(),
            bindings: plan.passes.iter().map(|pass| pass.bindings.len()).sum(),
            spirv_instructions: plan.passes.iter().map(|pass| pass.spirv_instructions).sum(),
            memory_bytes: plan.memory_bytes,
        }
    }
}

/// A feature that was taken away.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its name.
    pub feature: &'static str,
    /// Features that mean nothing without it, and went too.
    pub and: Vec<&'static str>,
    /// What is left.
    pub without: Counts,
    /// Names that the fullest scene's plan lists and this one does not.
    pub gone: Vec<String>,
    /// Names that only this one lists: what is done in another way.
    pub instead: Vec<String>,
    /// A frame, by the table's clock.
    pub ms: Spread,
    /// A frame of the fullest scene over this one: above 1, the feature costs time.
    pub time_ratio: Spread,
    /// Samples of a frame.
    pub samples: u64,
}

/// All features, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct FeatureTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "device": whose time frames are measured by.
    pub clock: &'static str,
    /// Voxels along each axis.
    pub edge: u32,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Turns that count.
    pub repeats: u32,
    /// The scene with all features.
    pub fullest: Counts,
    /// Its frame.
    pub fullest_ms: Spread,
    /// Samples of its frame.
    pub fullest_samples: u64,
    /// In the order of the ladder.
    pub features: Vec<Row>,
}

/// Measures every feature; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device lacks memory for all bricks or is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    extent: &Extent,
    repeats: u32,
    progress: &mut dyn FnMut(f64),
) -> Result<FeatureTable> {
    let timer = Timer::of(gpu);
    // One turn to make each, one that warms up.
    let steps = f64::from(repeats + 2) * (Feature::ALL.len() + 1) as f64;
    let mut done = 0.0;
    let mut step = || {
        done += 1.0;
        progress(done / steps);
    };
    let mut scenes = Vec::new();
    let without = Feature::ALL.map(Feature::all_without);
    for features in std::iter::once(&Feature::ALL[..]).chain(without.iter().map(Vec::as_slice)) {
        let (data, settings) = scene(features, extent)?;
        scenes.push(ResidentScene::new(gpu, compiler, &data, &settings)?.0);
        step();
    }
    draw_in_turns(&mut scenes, timer, repeats, step)?;
    let (fullest, others) = (&scenes[0], &scenes[1..]);
    let fullest_ms = fullest.frames_ms();
    let names = inventory(fullest.plan());
    let row = |((feature, left), other): ((Feature, &Vec<Feature>), &ResidentScene)| {
        let left_names = inventory(other.plan());
        let went = |other: &Feature| *other != feature && !left.contains(other);
        Row {
            feature: feature.name(),
            and: Feature::ALL.into_iter().filter(went).map(Feature::name).collect(),
            without: Counts::of(other.plan()),
            gone: names.difference(&left_names).cloned().collect(),
            instead: left_names.difference(&names).cloned().collect(),
            ms: Spread::of(&other.frames_ms()),
            time_ratio: Spread::of_ratios(&fullest_ms, &other.frames_ms()),
            samples: other.samples(),
        }
    };
    Ok(FeatureTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: timer.name("device"),
        edge: extent.edge,
        payload: extent.payload,
        size: extent.size,
        repeats,
        fullest: Counts::of(fullest.plan()),
        fullest_ms: Spread::of(&fullest_ms),
        fullest_samples: fullest.samples(),
        features: Feature::ALL.into_iter().zip(&without).zip(others).map(row).collect(),
    })
}
