//! The plan: every Vulkan object, pass, variant and byte that a scene needs on a device, and what is
//! left out and why. Plain data; the renderer builds exactly this.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{BufferSpec, Gpu, Image, ImageSpec, ObjectKind, Shader, ShaderCompiler, Variant};
use crate::passes::cache_buffers::RankOrder;
use crate::passes::march_shape::{ChannelShape, FilterShape, MacrocellUse, Shape};
use crate::passes::{cast, rays, resolve};
use crate::render::image_layout::TexelLayout;
use crate::render::macrocells::PlannedMacrocells;
use crate::render::paging::{CopyPath, PagingPlan, PlannedOctree, longest_diagonal_world};
use crate::render::plan_images::{ChannelFacts, plan_images};
use crate::render::plan_objects::{copies_of, objects, plan_buffers, planned_buffers, queues_text};
use crate::render::planned_layout::{LayoutMeter, PlannedLayout};
use crate::render::sample_rates::sample_rates;
use crate::render::scene_data::SceneData;
use crate::render::settings::{Addressing, LOOP_TURNS_MAX, Settings};
use crate::render::submit_bound::may_cast;
use crate::render::transfer_segments::{classify_constant, open_both_ends, transfer_segments};
use crate::render::view_pixels::{pixels_of, pixels_of_views, tiles_of};
use crate::residency::PASSES_IN_TURNS;
use crate::scene::{Integrator, Part};
use crate::twins::limits::BLOCK_SAMPLES;
use crate::twins::ray_setup::ViewRays;
use crate::twins::transfer::TransferSegment;
use crate::volume::{VolumeVoxels, VoxelFormat};

/// March dispatches in one submit: bounds the time that a driver's watchdog sees.
pub(super) const DISPATCHES_PER_SUBMIT: u32 = 8;
/// Samples of one ray that its counters hold with room to spare.
const SAMPLES_OF_RAY_MAX: f64 = 1e9;

/// A buffer that will be made.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedBuffer {
    /// The field's name.
    pub name: &'static str,
    /// Bytes that passes use.
    pub bytes: u64,
    /// Bytes of device memory that it takes.
    pub memory_bytes: u64,
    /// "device", "upload" or "readback".
    pub home: &'static str,
    #[serde(skip)]
    pub(super) spec: BufferSpec,
}

/// An image that will be made.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedImage {
    /// The field's name.
    pub name: &'static str,
    /// Texels along x, y, z, apron included.
    pub size: [u32; 3],
    /// Texel format.
    pub format: &'static str,
    /// "plain" or "quads".
    pub layout: &'static str,
    /// Bytes of device memory that it takes.
    pub memory_bytes: u64,
    #[serde(skip)]
    pub(super) spec: ImageSpec,
    /// Which channel of the scene it holds, or which atlas it is; nothing: it holds no voxels.
    pub channel: Option<usize>,
}

/// A pass and its shader variant.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedPass {
    /// The shader's name.
    pub name: &'static str,
    /// Macros of the variant.
    pub defines: Vec<(String, String)>,
    /// What it binds, by name.
    pub bindings: Vec<String>,
    /// Bytes of push constants.
    pub push_bytes: u32,
    /// 32-bit words of its SPIR-V module.
    pub spirv_words: usize,
    /// SPIR-V instructions inside functions.
    pub spirv_instructions: u32,
    /// Dispatches per tile.
    pub dispatches_per_tile: u32,
    #[serde(skip)]
    pub(super) shader: Shader,
}

/// See the module.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// How roles map to queues.
    pub queues: String,
    /// How voxels are addressed: "direct", in one image per channel.
    pub addressing: &'static str,
    /// Pixels across and down, of the largest picture.
    pub picture: [u32; 2],
    /// Pixels of the largest tile.
    pub tile: [u32; 2],
    /// Tiles of one view.
    pub tiles: u32,
    /// Pixels of a tile that buffers have room for, also where an earlier scene was larger.
    #[serde(skip)]
    pub(super) pixels_max: u64,
    /// Views drawn.
    pub views: Vec<String>,
    /// `[view]` which pixels.
    #[serde(skip)]
    pub(super) pixels: Vec<Part>,
    /// Distance of two samples at most, world units; nothing: one sample a ray is exact.
    pub step_world: Option<f64>,
    /// Samples of a ray, at most.
    pub samples_of_ray_max: u64,
    /// Buffers.
    pub buffers: Vec<PlannedBuffer>,
    /// Images.
    pub images: Vec<PlannedImage>,
    /// How voxels lie in them, what each way would cost, and why this one; nothing where no image holds
    /// voxels.
    pub layout: Option<PlannedLayout>,
    /// Passes in the order of a frame.
    pub passes: Vec<PlannedPass>,
    /// Vulkan objects by kind, for all views of the scene.
    pub objects: BTreeMap<&'static str, u64>,
    /// Device memory of voxels, bytes: what atlas_mib limits.
    pub atlas_bytes: u64,
    /// Device memory of everything, bytes.
    pub memory_bytes: u64,
    /// What the scene does not need, and why.
    pub left_out: Vec<(String, String)>,
    /// What rays read of macrocells; nothing where they read none.
    pub macrocells: Option<PlannedMacrocells>,
    /// The residency octree; nothing where rays use none.
    pub octree: Option<PlannedOctree>,
    #[serde(skip)]
    pub(super) texel_layouts: Vec<Option<TexelLayout>>,
    #[serde(skip)]
    pub(super) segments: Vec<TransferSegment>,
    #[serde(skip)]
    pub(super) shape: Shape,
    #[serde(skip)]
    pub(super) settings: Settings,
    #[serde(skip)]
    pub(super) paging: Option<PagingPlan>,
}

impl Plan {
    /// Plans a scene on a device; makes no Vulkan object. Layouts go by the kind of the device.
    ///
    /// # Errors
    /// Exit code 3 when the volume does not fit `atlas_mib` or the step asks for too many samples.
    pub fn new(
        gpu: &Gpu,
        compiler: &ShaderCompiler,
        data: &SceneData,
        settings: &Settings,
    ) -> Result<Plan> {
        Plan::metered(gpu, compiler, data, settings, &|_| Ok(None))
    }

    /// As [`Plan::new`]; where the scene leaves open how voxels lie, `meter` is asked what that costs.
    ///
    /// # Errors
    /// As [`Plan::new`], and those of `meter`.
    pub fn metered(
        gpu: &Gpu,
        compiler: &ShaderCompiler,
        data: &SceneData,
        settings: &Settings,
        meter: LayoutMeter,
    ) -> Result<Plan> {
        let scene = &data.scene;
        check_views(gpu, scene.views.len())?;
        if is_paged(gpu, data, settings)? {
            return Plan::paged(gpu, compiler, data, settings, meter);
        }
        let (volume, voxels) = data.volume()?;
        let facts: Vec<_> = voxels.channels.iter().map(ChannelFacts::of).collect();
        let mut left_out = LeftOut::default();
        let preintegrated = scene.quality.integrator == Integrator::Preintegrated;

        let ((mut images, texel_layouts), layout) =
            plan_images(gpu, data, &facts, settings, meter)?;
        let atlas_bytes = images.iter().map(|image| image.memory_bytes).sum();
        let mut segments = Vec::new();
        let mut channels = Vec::new();
        for (index, (channel, facts)) in volume.channels.iter().zip(&facts).enumerate() {
            let scaling = (voxels.channels[index].slope, voxels.channels[index].intercept);
            let Some(layout) = &texel_layouts[index] else {
                segments.push(classify_constant(channel, scaling, facts.range.least.into()));
                channels.push(ChannelShape::Constant);
                left_out.add(
                    format!("image of channel {index}"),
                    format!("every voxel is {}", facts.range.least),
                );
                continue;
            };
            let mut of_channel = transfer_segments(channel, scaling, (layout.scale, layout.offset));
            if preintegrated {
                open_both_ends(&mut of_channel);
            }
            let count = of_channel.len() as u32;
            channels.push(match facts.format {
                VoxelFormat::Rgba8 => ChannelShape::Rgba { segments: count },
                _ => ChannelShape::Scalar { segments: count },
            });
            segments.extend(of_channel);
        }
        let homogeneous = images.is_empty();
        let filter = texel_layouts.iter().flatten().next();
        let mut shape = Shape {
            channels,
            filter: filter.map_or(FilterShape::Fetch, |l| l.filter_shape(scene.quality.filter)),
            early_stop: scene.quality.early_stop > 0.0 && !homogeneous,
            nan_voxels: facts.iter().any(|facts| facts.nan_count > 0),
            preintegrated: preintegrated && !homogeneous,
            macrocells: MacrocellUse::Unused,
            sample_every: if homogeneous { Vec::new() } else { sample_rates(scene)? },
        };
        let macrocells = PlannedMacrocells::new(data, &facts, &texel_layouts, settings)?;
        if let Some(planned) = &macrocells {
            shape.macrocells = match planned.interval_edges {
                Some(_) => MacrocellUse::Adaptive,
                None => MacrocellUse::Skipping,
            };
            images.push(planned.image(gpu));
        }
        left_out.of_shape(&shape, scene.quality.early_stop, homogeneous);
        if shape.macrocells == MacrocellUse::Unused && !homogeneous {
            let why = match settings.skipping {
                true => "too few of them show nothing",
                false => "--no-skipping",
            };
            left_out.add("macrocells", why);
        }

        let step_world = (!homogeneous).then(|| {
            let planned = macrocells.as_ref().and_then(|planned| planned.interval_edges);
            let edges = planned.unwrap_or(scene.quality.sample_edges());
            edges * voxels.world_from_voxel.smallest_edge()
        });
        let samples_of_ray_max = samples_of_ray_max(&voxels, step_world)?;
        let dispatches = dispatches_of(samples_of_ray_max, settings, shape.turns_of_block());

        let (picture, tile, tiles) = tiles_of(scene, settings);
        // The longest ray fits one dispatch: no state of rays is kept between passes.
        let samples = samples_of_ray_max.saturating_mul(pixels_of(tile));
        let one_dispatch =
            dispatches == 1 && may_cast(settings.submit_ms, gpu.facts().kind, samples);
        let buffers = plan_buffers(gpu, data, tile, segments.len(), &images, one_dispatch);

        let pass = |variant, count| PlannedPass::new(compiler, variant, count);
        let views = scene.views.len();
        let passes = if one_dispatch {
            left_out.add(
                "rays and resolve as passes, ray_geometry, ray_state",
                format!("the longest ray's {samples_of_ray_max} samples fit one dispatch"),
            );
            vec![pass(cast::variant(&shape, views), 1)?]
        } else {
            vec![
                pass(rays::variant(views), 1)?,
                pass(shape.variant("march"), dispatches)?,
                pass(resolve::variant(), 1)?,
            ]
        };
        let memory_bytes = images.iter().map(|image| image.memory_bytes).sum::<u64>()
            + buffers.iter().map(|buffer| buffer.memory_bytes).sum::<u64>();
        check_limits(gpu, &buffers, memory_bytes)?;
        let submits_of_tile = u64::from(dispatches.div_ceil(DISPATCHES_PER_SUBMIT));
        let submits = u64::from(tiles) * scene.views.len() as u64 * submits_of_tile;
        let half = buffers.iter().find(|buffer| buffer.name == "staging_half_0");
        let copies = half.map_or(0, |half| copies_of(&images, half.bytes));
        Ok(Plan {
            device: gpu.facts().name.clone(),
            driver: gpu.facts().driver.clone(),
            queues: queues_text(gpu, images.is_empty()),
            addressing: "direct",
            picture,
            tile,
            pixels_max: pixels_of(tile),
            tiles,
            views: scene.views.iter().map(|view| view.name.clone()).collect(),
            pixels: pixels_of_views(scene),
            step_world,
            samples_of_ray_max,
            objects: objects(gpu, &buffers, &images, passes.len() as u64, submits, copies),
            buffers,
            images,
            layout,
            passes,
            atlas_bytes,
            memory_bytes,
            left_out: left_out.0,
            macrocells,
            octree: None,
            texel_layouts,
            segments,
            shape,
            settings: *settings,
            paging: None,
        })
    }

    /// As [`Plan::new`] where the volume is drawn through an atlas that need not hold all of it.
    fn paged(
        gpu: &Gpu,
        compiler: &ShaderCompiler,
        data: &SceneData,
        settings: &Settings,
        meter: LayoutMeter,
    ) -> Result<Plan> {
        let scene = &data.scene;
        let paging = PagingPlan::new(gpu, data, settings, meter)?;
        let samples_of_ray_max = checked_samples(paging.samples_of_ray_max())?;
        let dispatches = dispatches_of(samples_of_ray_max, settings, paging.turns_of_block());
        let (picture, tile, tiles) = tiles_of(scene, settings);
        let specs = paging.buffers(gpu, pixels_of(tile));
        let buffers = planned_buffers(gpu, specs);
        let images: Vec<PlannedImage> = paging
            .residency
            .atlases
            .iter()
            .enumerate()
            .map(|(atlas, plan)| PlannedImage {
                name: plan.layout.spec.name,
                size: plan.layout.spec.size,
                format: plan.layout.spec.format.name(),
                layout: paging.layouts[0].layout.name(),
                memory_bytes: Image::memory_bytes(gpu, &plan.layout.spec),
                spec: plan.layout.spec,
                channel: Some(atlas),
            })
            .collect();
        let passes: Vec<PlannedPass> = paging
            .variants(dispatches)
            .into_iter()
            .map(|(variant, count)| PlannedPass::new(compiler, variant, count))
            .collect::<Result<_>>()?;
        let mut left_out = LeftOut::default();
        let several = paging.bricks.several_levels;
        left_out.of_march(&paging.bricks.march);
        if !several {
            left_out.add("change of level along a ray", "each view uses one level");
        }
        if paging.residency.ranks.order != RankOrder::Substitute {
            left_out.add("weights of wishes, coarser levels for missing bricks", "refine is exact");
        } else {
            left_out.add("marks of bricks that waiting rays need", "rays do not wait");
        }
        if !paging.bricks.channel_levels() {
            left_out.add("levels of channels", "all are drawn at the level that rays are in");
        }
        if paging.octree.is_none() {
            left_out.add("residency octree", "rays go brick by brick");
        }
        if !paging.bricks.skipping {
            left_out.add("skipping of bricks that show nothing", "--no-skipping");
        }
        if !paging.bricks.march.early_stop {
            left_out.add("early stop", "early_stop = 0");
        }
        if paging.copy_path == CopyPath::Straight {
            left_out.add("upload buffer and its pass", "bricks are copied straight into slots");
        }
        if !paging.bricks.show_states {
            left_out.add("tints of rays by what they met", "no --show-states");
        }
        let atlas_bytes = images.iter().map(|image| image.memory_bytes).sum();
        let memory_bytes =
            atlas_bytes + buffers.iter().map(|buffer| buffer.memory_bytes).sum::<u64>();
        check_limits(gpu, &buffers, memory_bytes)?;
        // A scene's rounds are not known before: as many submits and copies as are in flight at once.
        let mut objects = objects(gpu, &buffers, &images, passes.len() as u64, u64::MAX, u64::MAX);
        for kind in [ObjectKind::DescriptorPool, ObjectKind::DescriptorSet] {
            *objects.entry(kind.name()).or_default() += PASSES_IN_TURNS;
        }
        Ok(Plan {
            device: gpu.facts().name.clone(),
            driver: gpu.facts().driver.clone(),
            queues: queues_text(gpu, false),
            addressing: "paged",
            picture,
            tile,
            pixels_max: pixels_of(tile),
            tiles,
            views: scene.views.iter().map(|view| view.name.clone()).collect(),
            pixels: pixels_of_views(scene),
            step_world: Some(
                scene.quality.sample_edges() * data.world_from_voxel(0).smallest_edge(),
            ),
            samples_of_ray_max,
            objects,
            buffers,
            images,
            layout: Some(paging.layout.clone()),
            passes,
            atlas_bytes,
            memory_bytes,
            left_out: left_out.0,
            macrocells: None,
            octree: paging.planned_octree(),
            texel_layouts: Vec::new(),
            segments: paging.segments.clone(),
            shape: paging.bricks.march.clone(),
            settings: *settings,
            paging: Some(paging),
        })
    }

    /// The finest level at which each channel is drawn; empty where voxels are not in bricks.
    pub fn finest_levels(&self) -> &[u8] {
        self.paging.as_ref().map_or(&[], |paging| &paging.finest)
    }

    /// The coarsest level that a view may use; 0 where voxels are not in bricks.
    pub fn coarsest_level(&self, view: usize) -> u8 {
        self.paging.as_ref().map_or(0, |paging| paging.views[view].in_use[1] as u8)
    }

    /// A buffer of the plan.
    pub(super) fn buffer(&self, name: &str) -> &PlannedBuffer {
        match self.buffers.iter().find(|buffer| buffer.name == name) {
            Some(buffer) => buffer,
            None => unreachable!("every plan lists buffer {name}"),
        }
    }

    /// Dispatches that march each ray of a tile to its end.
    pub(super) fn march_dispatches(&self) -> u32 {
        let march = self.passes.iter().find(|pass| pass.name.starts_with("march"));
        march.map_or(1, |pass| pass.dispatches_per_tile)
    }

    /// Blocks of samples in one dispatch: no more than a ray can have.
    pub(super) fn blocks_per_dispatch(&self) -> u32 {
        let needed = self.samples_of_ray_max.div_ceil(u64::from(BLOCK_SAMPLES));
        let turns = match &self.paging {
            Some(paging) => paging.turns_of_block(),
            None => self.shape.turns_of_block(),
        };
        blocks_per_dispatch(&self.settings, turns).min(needed as u32)
    }
}

#[derive(Default)]
struct LeftOut(Vec<(String, String)>);

impl LeftOut {
    fn add(&mut self, what: impl Into<String>, why: impl Into<String>) {
        self.0.push((what.into(), why.into()));
    }

    fn of_march(&mut self, shape: &Shape) {
        if !shape.nan_voxels {
            self.add("test for NaN", "no voxel is NaN");
        }
        if shape.channels.len() == 1 {
            self.add("mixing of channels", "the scene shows one");
        }
        if !shape.searches() {
            self.add("search of transfer segments", "few enough to select from");
        }
        if !shape.preintegrated {
            self.add("spans between samples", "the integrator is riemann");
        }
    }

    fn of_shape(&mut self, shape: &Shape, early_stop: f64, homogeneous: bool) {
        if homogeneous {
            self.add("images, sampler, staging, transfer role", "no channel has an image");
            self.add("steps along the ray", "the medium is homogeneous: one sample is exact");
        }
        self.of_march(shape);
        if !shape.early_stop {
            let why = if early_stop > 0.0 { "rays have one sample" } else { "early_stop = 0" };
            self.add("early stop", why);
        }
        self.add(
            "page table, requests, loaders",
            "the volume fits the atlas: addressing is direct",
        );
    }
}

impl PlannedPass {
    fn new(compiler: &ShaderCompiler, variant: Variant, count: u32) -> Result<PlannedPass> {
        let shader = compiler.compile(&variant)?;
        Ok(PlannedPass {
            name: variant.shader,
            defines: variant.defines,
            bindings: shader.reflection.bindings.iter().map(|b| b.name.clone()).collect(),
            push_bytes: shader.reflection.push_bytes,
            spirv_words: shader.spirv.len(),
            spirv_instructions: shader.reflection.instructions,
            dispatches_per_tile: count,
            shader,
        })
    }
}

/// Whether the volume is drawn in pages: asked for, or because level 0 fits neither atlas nor memory.
fn is_paged(gpu: &Gpu, data: &SceneData, settings: &Settings) -> Result<bool> {
    let volume = &data.scene.volumes[0];
    let coarse = volume.channels.iter().any(|channel| channel.level_min > 0);
    let needs_levels = coarse || data.scene.quality.level_loss.is_some();
    match settings.addressing {
        Addressing::Direct if needs_levels => {
            return Err(volume.place.error("level_min of a channel and level_loss need voxels in pages, directly there is level 0 alone: leave out --addressing direct".to_owned()));
        }
        Addressing::Direct => return Ok(false),
        Addressing::Auto if !needs_levels => {}
        Addressing::Paged | Addressing::Auto => return Ok(true),
    }
    let source = &data.volumes[0];
    let description = source.source.description();
    let size = description.size().to_array().map(|edge| edge + 2);
    let texels = size.iter().map(|edge| u128::from(*edge)).product::<u128>();
    let voxel_bytes: u128 = source
        .shown()
        .filter(|channel| channel.range.least != channel.range.greatest)
        .map(|channel| channel.format.bytes() as u128)
        .sum();
    let fits = texels * voxel_bytes <= u128::from(data.scene.memory.atlas_mib) << 20
        && size.iter().all(|edge| *edge <= gpu.facts().image_3d_edge_max);
    Ok(!(fits && data.check_memory().is_ok()))
}

fn check_views(gpu: &Gpu, views: usize) -> Result<()> {
    let bytes = (views * size_of::<ViewRays>()) as u64;
    if bytes > gpu.facts().uniform_bytes_max {
        return Err(Error::machine(format!(
            "the scene has {views} views, but this device holds at most {} at once: draw some of them with --view",
            gpu.facts().uniform_bytes_max / size_of::<ViewRays>() as u64
        )));
    }
    Ok(())
}

/// Keeps to the device's limits ourselves: lavapipe states them and enforces none.
fn check_limits(gpu: &Gpu, buffers: &[PlannedBuffer], memory_bytes: u64) -> Result<()> {
    let facts = gpu.facts();
    if let Some(buffer) = buffers.iter().find(|buffer| buffer.bytes > facts.storage_bytes_max) {
        return Err(Error::machine(format!(
            "buffer {} needs {} bytes, but this device binds at most {}: lower --tile",
            buffer.name, buffer.bytes, facts.storage_bytes_max
        )));
    }
    if memory_bytes > facts.heap_bytes {
        return Err(Error::machine(format!(
            "the scene needs {} MiB on the device, which has {}: lower --tile or choose --layout plain",
            memory_bytes.div_ceil(1 << 20),
            facts.heap_bytes >> 20
        )));
    }
    Ok(())
}

/// As the settings say, and no more than loops can turn.
fn blocks_per_dispatch(settings: &Settings, turns_of_block: u32) -> u32 {
    settings.blocks_per_dispatch().min(LOOP_TURNS_MAX / turns_of_block).max(1)
}

fn dispatches_of(samples_of_ray_max: u64, settings: &Settings, turns_of_block: u32) -> u32 {
    let samples = blocks_per_dispatch(settings, turns_of_block) * BLOCK_SAMPLES;
    samples_of_ray_max.div_ceil(u64::from(samples)) as u32
}

/// An upper bound: the box's longest diagonal in steps.
fn samples_of_ray_max(voxels: &VolumeVoxels, step_world: Option<f64>) -> Result<u64> {
    let Some(step) = step_world else { return Ok(1) };
    let longest =
        longest_diagonal_world(voxels.size.to_array().map(f64::from), &voxels.world_from_voxel);
    // A thousandth and one more for rounding in the ray's own arithmetic.
    checked_samples((longest / step * 1.001).ceil() + 1.0)
}

fn checked_samples(samples: f64) -> Result<u64> {
    if samples > SAMPLES_OF_RAY_MAX {
        return Err(Error::input(format!(
            "step asks for {samples:.0} samples along the volume's diagonal, at most {SAMPLES_OF_RAY_MAX:e} are possible: raise step"
        )));
    }
    Ok(samples as u64)
}
