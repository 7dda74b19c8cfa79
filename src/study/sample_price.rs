//! The price of one sample on a device: loop, texel, each filter and format; the error each filter was
//! bought with; and the caster's own price beside the bare ones.

use std::sync::Arc;

use serde::Serialize;

use crate::error::Result;
use crate::gpu::{
    Buffer, ComputePipeline, Gpu, Image, Recorder, RoleKind, Sampler, SamplerFilter,
    ShaderCompiler, Timestamps,
};
use crate::import::DenseVolume;
use crate::passes::march_shape::FilterShape;
use crate::passes::probe::{self, ProbeShape};
use crate::render::{
    Layout, LayoutChoice, Plan, Renderer, SceneData, Settings, TexelLayout, VolumeData,
};
use crate::scene::{Overrides, Scene};
use crate::study::clock::{Clock, median};
use crate::study::sampler_precision::{filled_image, filter_error, noise, sums_spec};
use crate::twins::probe::Push;
use crate::volume::{
    BRICK_PAYLOAD_DEFAULT, ChannelVoxels, Size3, ValueRange, VolumeVoxels, VoxelFormat, Voxels,
    WorldFromVoxel,
};

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Voxels along each axis of the probed volume.
    pub edge: u32,
    /// Lines across and down.
    pub lines: u32,
    /// Samples of each line.
    pub samples: u32,
    /// Repetitions; the median counts.
    pub repeats: u32,
}

impl Effort {
    /// 256 cubed at half a voxel a step, the default: 46 million samples.
    pub const FULL: Effort = Effort { edge: 256, lines: 300, samples: 512, repeats: 5 };
    /// Enough to see that it runs.
    pub const SMALL: Effort = Effort { edge: 32, lines: 64, samples: 24, repeats: 1 };
}

/// One row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Price {
    /// What one sample did.
    pub what: String,
    /// Nanoseconds of one sample: processor time where the device is a CPU, else device time.
    pub ns: f64,
    /// Fastest and slowest repetition.
    pub ns_min_max: [f64; 2],
    /// Against the bare loop of this run.
    pub over_loop: f64,
    /// Of a caster: against the bare filtered sample of the same filter and format, measured in turns.
    pub over_bare: Option<f64>,
    /// Of a filter: greatest error against f64 arithmetic, as a part of the value range.
    pub error_max: Option<f64>,
}

/// All rows, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct PriceTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "device": whose time was measured.
    pub clock: &'static str,
    /// Samples of one measurement, millions.
    pub million_samples: f64,
    /// In order of measurement.
    pub prices: Vec<Price>,
}

const FILTERS: [(FilterShape, Layout, &str); 3] = [
    (FilterShape::Sampler, Layout::Plain, "sampler"),
    (FilterShape::Fetch, Layout::Plain, "eight texels"),
    (FilterShape::Quads, Layout::Quads, "two quads"),
];

/// Measures the whole table; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device runs out of memory or is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<PriceTable> {
    let bench = Bench { gpu, compiler, effort };
    let mut prices: Vec<Price> = Vec::new();
    let steps = 2.0 + 9.0;
    let mut done = 0.0;
    let mut step = || {
        done += 1.0;
        progress(done / steps);
    };
    let bare_loop = bench.price(ProbeShape::Loop, None)?;
    let over_loop = |ns: f64| ns / median(&bare_loop);
    prices.push(row("loop alone", &bare_loop, over_loop(median(&bare_loop))));
    step();
    let noise = bench.noise(VoxelFormat::U8);
    let plain = bench.image(&noise, Layout::Plain)?;
    let nearest = Sampler::new(gpu, SamplerFilter::Nearest)?;
    let one = bench.price(ProbeShape::OneTexel, Some((&plain.0, &nearest)))?;
    prices.push(row("one texel, u8", &one, over_loop(median(&one))));
    drop(plain);
    step();
    for format in [VoxelFormat::U8, VoxelFormat::U16, VoxelFormat::F32] {
        let noise = bench.noise(format);
        for (filter, layout, name) in FILTERS {
            let (image, texel) = bench.image(&noise, layout)?;
            let sampler = Sampler::new(gpu, sampler_filter(filter))?;
            let probed = Some((&image, &sampler));
            let mut bare = bench.probe(ProbeShape::Filtered(filter), probed)?;
            let (bare, caster) = if format == VoxelFormat::U8 {
                let mut caster = bench.caster(&noise, filter, layout)?;
                let [bare, caster] = bench.in_turns([&mut bare, &mut caster])?;
                (bare, Some(caster))
            } else {
                let [bare] = bench.in_turns([&mut bare])?;
                (bare, None)
            };
            let mut bare_row = row(&format!("{name}, {format}"), &bare, over_loop(median(&bare)));
            bare_row.error_max =
                Some(filter_error(gpu, compiler, (&image, &sampler), filter, &noise, &texel)?);
            prices.push(bare_row);
            if let Some(caster) = caster {
                let what = format!("caster, {name}, {format}");
                let mut caster_row = row(&what, &caster, over_loop(median(&caster)));
                let pairs = caster.iter().zip(&bare).map(|(caster, bare)| caster / bare);
                caster_row.over_bare = Some(median(&pairs.collect::<Vec<_>>()));
                prices.push(caster_row);
            }
            step();
        }
    }
    Ok(PriceTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: if bench.counts_processor() { "processor" } else { "device" },
        million_samples: f64::from(effort.lines).powi(2) * f64::from(effort.samples) * 1e-6,
        prices,
    })
}

fn row(what: &str, ns: &[f64], over_loop: f64) -> Price {
    let least = ns.iter().copied().fold(f64::INFINITY, f64::min);
    let most = ns.iter().copied().fold(0.0, f64::max);
    Price {
        what: what.to_owned(),
        ns: median(ns),
        ns_min_max: [least, most],
        over_loop,
        over_bare: None,
        error_max: None,
    }
}

fn sampler_filter(filter: FilterShape) -> SamplerFilter {
    match filter {
        FilterShape::Sampler => SamplerFilter::Linear,
        FilterShape::Fetch | FilterShape::Quads => SamplerFilter::Nearest,
    }
}

/// Where something is measured, and how much.
pub(super) struct Bench<'a> {
    pub gpu: &'a Arc<Gpu>,
    pub compiler: &'a ShaderCompiler,
    pub effort: &'a Effort,
}

impl Bench<'_> {
    fn counts_processor(&self) -> bool {
        self.gpu.facts().kind == "cpu" && Clock::start().elapsed().cpu_ns.is_some()
    }

    pub fn noise(&self, format: VoxelFormat) -> Voxels {
        noise(format, self.effort.edge)
    }

    pub fn image(&self, voxels: &Voxels, layout: Layout) -> Result<(Image, TexelLayout)> {
        let range = ValueRange { least: 0.0, greatest: 1.0 };
        let texel = TexelLayout::of(voxels.format(), range, layout);
        Ok((filled_image(self.gpu, voxels, self.effort.edge, &texel)?, texel))
    }

    /// Nanoseconds of one sample of the bare probe, one per repetition.
    fn price(&self, shape: ProbeShape, probed: Option<(&Image, &Sampler)>) -> Result<Vec<f64>> {
        let mut probe = self.probe(shape, probed)?;
        let [ns] = self.in_turns([&mut probe])?;
        Ok(ns)
    }

    /// Lines of samples of an image, a little aslant, as a camera's rays are; without one the loop alone.
    pub fn probe<'b>(
        &'b self,
        shape: ProbeShape,
        probed: Option<(&'b Image, &'b Sampler)>,
    ) -> Result<Measured<'b>> {
        let Effort { edge, lines, samples, .. } = *self.effort;
        let shader = self.compiler.compile(&probe::variant(shape))?;
        let pipeline = ComputePipeline::new(self.gpu, shader)?;
        let sums = Buffer::new(self.gpu, &sums_spec(lines))?;
        let timestamps = Timestamps::new(self.gpu, RoleKind::Render, 1)?;
        // Through the whole volume.
        let (inner, across) = (edge as f32 - 2.0, lines as f32);
        let push = Push {
            origin_voxel: [0.3; 3],
            lines_across: lines,
            column_voxel: [inner * 0.9 / across, 0.0, 0.0],
            lines_down: lines,
            row_voxel: [0.0, inner * 0.9 / across, 0.0],
            samples,
            step_voxel: [0.08, 0.06, 0.9].map(|part| part * inner / samples as f32),
        };
        let run = move || {
            let mut recorder = Recorder::new(self.gpu, RoleKind::Render, timestamps.as_ref());
            probe::record(&mut recorder, &pipeline, probed, &sums, &push);
            self.gpu.wait(recorder.submit(&[])?.point)?;
            let ms = timestamps.as_ref().map_or(Ok(Vec::new()), Timestamps::step_ms)?;
            Ok(ms.iter().map(|(_, ms)| ms).sum())
        };
        let samples = u64::from(lines).pow(2) * u64::from(samples);
        Ok(Measured { samples, run: Box::new(run) })
    }

    /// The real caster, all its passes included.
    fn caster(&self, voxels: &Voxels, filter: FilterShape, layout: Layout) -> Result<Measured<'_>> {
        let edge = self.effort.edge;
        let hardware = filter == FilterShape::Sampler;
        let overrides = Overrides {
            size: Some([self.effort.lines; 2]),
            step: Some(f64::from(edge) / f64::from(self.effort.samples)),
            filter: Some(if hardware { "hardware" } else { "exact" }.to_owned()),
            ..Overrides::default()
        };
        let mut scene = Scene::from_toml(CASTER_SCENE, "bench".as_ref(), &overrides)?;
        let unit = WorldFromVoxel::from_spacing([1.0 / f64::from(edge); 3])?;
        scene.volumes[0].world_from_voxel = Some(unit);
        let channel = ChannelVoxels { voxels: voxels.clone(), slope: 1.0, intercept: 0.0 };
        let size = Size3::cube(edge);
        let volume = VolumeVoxels { size, world_from_voxel: unit, channels: vec![channel] };
        let dense = DenseVolume::new("noise", Arc::new(volume), Size3::cube(BRICK_PAYLOAD_DEFAULT));
        let whole = dense.voxels().clone();
        let volume = VolumeData::of_whole(Arc::new(dense), whole);
        let data = SceneData::new(scene, vec![volume])?;
        let settings = Settings { layout: LayoutChoice::Only(layout), ..Settings::default() };
        let plan = Plan::new(self.gpu, self.compiler, &data, &settings)?;
        let mut renderer = Renderer::new(self.gpu, plan, &data)?;
        let (_, statistics) = renderer.draw(0, &mut |_| {})?;
        let run = move || {
            let (_, statistics) = renderer.draw(0, &mut |_| {})?;
            let passes = statistics.gpu_ms.iter().filter(|time| time.pass != "upload");
            Ok(passes.map(|time| time.ms).sum())
        };
        Ok(Measured { samples: statistics.samples, run: Box::new(run) })
    }

    /// Nanoseconds of one sample of each, one per repetition. Each runs once to warm up (drivers
    /// compile at the first dispatch); then they take turns, so that what disturbs the machine
    /// disturbs all of them alike.
    pub fn in_turns<const N: usize>(
        &self,
        mut measured: [&mut Measured; N],
    ) -> Result<[Vec<f64>; N]> {
        let processor = self.counts_processor();
        let mut ns = [const { Vec::new() }; N];
        for turn in 0..=self.effort.repeats {
            for (index, one) in measured.iter_mut().enumerate() {
                let clock = Clock::start();
                let device_ms = (one.run)()?;
                let spent = match clock.elapsed().cpu_ns {
                    Some(cpu_ns) if processor => cpu_ns,
                    _ => device_ms * 1e6,
                };
                if turn > 0 {
                    ns[index].push(spent / one.samples as f64);
                }
            }
        }
        Ok(ns)
    }
}

/// Something to measure: `run` returns the device's milliseconds.
pub(super) struct Measured<'b> {
    samples: u64,
    run: Box<dyn FnMut() -> Result<f64> + 'b>,
}

const CASTER_SCENE: &str = r#"
format = 1
[quality]
early_stop = 0.0
[memory]
atlas_mib = 4096
[[volume]]
source = { computed = "constant", size = [1, 1, 1] }
[[volume.channel]]
window = [0.0, 255.0]
transfer = [
  { at = 0.0, color = [0.2, 0.2, 0.3], extinction = 0.0 },
  { at = 0.3, color = [0.3, 0.5, 0.3], extinction = 0.1 },
  { at = 0.5, color = [0.6, 0.4, 0.2], extinction = 0.0 },
  { at = 0.8, color = [0.8, 0.7, 0.5], extinction = 0.3 },
  { at = 1.0, color = [1.0, 1.0, 1.0], extinction = 0.5 },
]
[[view]]
eye = [0.5, 0.42, -4.0]
target = [0.5, 0.5, 0.5]
up = [0.0, 1.0, 0.0]
height = 0.9
"#;
