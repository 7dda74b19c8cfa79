//! What a sample of voxels costs on a device in each layout, measured when a plan first asks.
//!
//! # Invariants
//! Measured once per process, device and texel format. What is made for it is gone when it ends.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;
use crate::gpu::{Gpu, Sampler, SamplerFilter, ShaderCompiler};
use crate::passes::march_shape::FilterShape;
use crate::passes::probe::ProbeShape;
use crate::render::{Layout, LayoutPrices, Plan, SceneData, Settings};
use crate::study::clock::median;
use crate::study::sample_price::{Bench, Effort};
use crate::volume::VoxelFormat;

/// Where the CPU samples. Half a voxel a step, as in [`Effort::FULL`]: fewer samples of a cell find less in
/// caches.
const ON_CPU: Effort = Effort { edge: 32, lines: 40, samples: 64, repeats: 3 };
/// Elsewhere threads must be many and the image larger than the nearest cache.
const ON_DEVICE: Effort = Effort { edge: 128, lines: 256, samples: 256, repeats: 5 };

/// As [`Plan::new`], with layouts chosen by what they cost on this device.
///
/// # Errors
/// As [`Plan::new`]; exit code 4 when the device runs out of memory or is lost.
pub fn plan(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    data: &SceneData,
    settings: &Settings,
) -> Result<Plan> {
    Plan::metered(gpu, compiler, data, settings, &|format| layout_prices(gpu, compiler, format))
}

/// What one texel format cost on one device.
struct Known {
    device: String,
    format: VoxelFormat,
    prices: Option<LayoutPrices>,
}

static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// The prices on this device; nothing where neither it nor the system tells the time.
///
/// # Errors
/// Exit code 4 when the device runs out of memory or is lost.
pub fn layout_prices(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    format: VoxelFormat,
) -> Result<Option<LayoutPrices>> {
    let facts = gpu.facts();
    let device = format!("{} {} {}", facts.index, facts.name, facts.driver);
    // Both are kept in the same texels.
    let format = if format == VoxelFormat::I16 { VoxelFormat::U16 } else { format };
    // Held while it is measured: two at once would disturb each other.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = known.iter().find(|known| known.device == device && known.format == format)
    {
        return Ok(known.prices);
    }
    let prices = measure(gpu, compiler, format)?;
    known.push(Known { device, format, prices });
    Ok(prices)
}

fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    format: VoxelFormat,
) -> Result<Option<LayoutPrices>> {
    let effort = if gpu.facts().kind == "cpu" { ON_CPU } else { ON_DEVICE };
    let bench = Bench { gpu, compiler, effort: &effort };
    let noise = bench.noise(format);
    let sampler = Sampler::new(gpu, SamplerFilter::Nearest)?;
    let (plain, _) = bench.image(&noise, Layout::Plain)?;
    let (quads, _) = bench.image(&noise, Layout::Quads)?;
    let probe = |filter, image| bench.probe(ProbeShape::Filtered(filter), Some((image, &sampler)));
    let mut eight = probe(FilterShape::Fetch, &plain)?;
    let mut two = probe(FilterShape::Quads, &quads)?;
    let [plain_ns, quads_ns] = bench.in_turns([&mut eight, &mut two])?.map(|ns| median(&ns));
    let told = |ns: f64| ns.is_finite() && ns > 0.0;
    Ok((told(plain_ns) && told(quads_ns)).then_some(LayoutPrices { plain_ns, quads_ns }))
}
