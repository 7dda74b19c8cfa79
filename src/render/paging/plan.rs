//! What paging a volume takes: atlases, levels of every view, shapes of shaders, sizes of lists.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::gpu::{BufferSpec, Gpu, Image, MemoryHome, QueueTopology, Staging, Variant};
use crate::passes::brick_shape::{AtlasShape, BrickShape, OctreeShape};
use crate::passes::cache_buffers::{RankOrder, RankShape};
use crate::passes::march_shape::{ChannelShape, MacrocellUse, Shape};
use crate::passes::{place, rays, resolve};
use crate::render::image_layout::{Layout, TexelLayout};
use crate::render::paging::brick_numbers::{BrickNumbers, ChannelPlace};
use crate::render::paging::channel_levels::finest_level;
use crate::render::paging::host_cache::CONSTANTS_MAX;
use crate::render::paging::leaf_words::LeafWords;
use crate::render::paging::placing::Placing;
use crate::render::paging::settings::{CopyPath, LoadOrder, PagingSettings, Traversal};
use crate::render::paging::view_levels::{LevelChoice, ViewLevels};
use crate::render::paging::visibility::Judge;
use crate::render::planned_layout::{LayoutMeter, PlannedLayout, choose, quads_possible};
use crate::render::sample_rates::sample_rates;
use crate::render::scene_data::SceneData;
use crate::render::settings::Settings;
use crate::render::transfer_segments::{open_both_ends, transfer_segments};
use crate::residency::{AtlasLayout, AtlasPlan, ResidencyShape};
use crate::scene::{Filter, Integrator, Quality, Refine};
use crate::source::{ChannelDescription, Description};
use crate::twins::limits::RANK_NONE;
use crate::twins::octree::{CHANNELS_MAX, LevelLeaves, bits_of_word};
use crate::twins::octree_ranges::Coding;
use crate::twins::octree_shape::{Shape as Octree, Wanted};
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_block::RayBlock;
use crate::twins::ray_setup::ViewRays;
use crate::twins::transfer::TransferSegment;
use crate::volume::{BrickId, VoxelFormat, WorldFromVoxel};

/// Names of atlases, in the order of the scene's first channel of each texel format.
const ATLAS_NAMES: [&str; 4] = ["atlas_0", "atlas_1", "atlas_2", "atlas_3"];
/// Slots that one round grants, and requests that it lists, at most.
const LIST_MAX: u32 = 4096;
/// Updates that one round publishes, at most; where a volume has fewer entries, one each.
const UPDATES_MAX: u32 = 65_536;
/// With fewer slots than this, four times as many smaller ones are worth more than fewer fetches.
const QUADS_SLOTS_MIN: u32 = 64;
/// The octree's share of `ram_mib` is one over this at most; leaves grow to keep to it.
const OCTREE_SHARE: u64 = 2;

/// See the module.
#[derive(Clone, Debug)]
pub struct PagingPlan {
    /// Bricks' numbers.
    pub numbers: BrickNumbers,
    /// One per view of the scene.
    pub views: Vec<ViewLevels>,
    /// One per channel of the scene.
    pub layouts: Vec<TexelLayout>,
    /// How that was chosen.
    pub layout: PlannedLayout,
    /// By channel of the source.
    pub judges: HashMap<u16, Judge>,
    /// For each channel of the scene the level that it is drawn at where rays are in a finer one.
    pub finest: Vec<u8>,
    /// Transfer functions of all channels.
    pub segments: Vec<TransferSegment>,
    /// Atlas, page table, lists.
    pub residency: ResidencyShape,
    /// Nodes of the residency octree, where rays use one.
    pub octree: Option<Arc<Octree>>,
    /// Of march_bricks.
    pub bricks: BrickShape,
    /// The same with the octree, where either may draw.
    pub other_bricks: Option<BrickShape>,
    /// Bricks that are loaded first and never given up; substitute refinement alone.
    pub held: Vec<BrickId>,
    /// How voxels come into a slot.
    pub copy_path: CopyPath,
    /// Of one staging half.
    pub staging_half_bytes: u64,
}

impl PagingPlan {
    /// Plans the paging of the scene's volume; makes nothing.
    ///
    /// # Errors
    /// Exit code 3 when `atlas_mib` holds too few slots or the volume has too many bricks.
    pub fn new(
        gpu: &Gpu,
        data: &SceneData,
        settings: &Settings,
        meter: LayoutMeter,
    ) -> Result<PagingPlan> {
        let scene = &data.scene;
        let (volume, source) = (&scene.volumes[0], &data.volumes[0]);
        let description = source.source.description();
        let (mut judges, mut segments) = (HashMap::new(), Vec::new());
        let (texel_layouts, atlases, layout) = fitting_atlases(gpu, data, settings, meter)?;
        let mut shapes = Vec::new();
        let preintegrated = scene.quality.integrator == Integrator::Preintegrated;
        if scene.quality.integrator.has_tolerance() {
            return Err(volume.place.error(format!(
                "integrator \"{}\" is not built for bricks yet: raise --atlas-mib until the volume fits, or set another integrator",
                scene.quality.integrator.name()
            )));
        }
        for ((channel, shown), layout) in
            volume.channels.iter().zip(source.shown()).zip(&texel_layouts)
        {
            let scaling = (shown.slope, shown.intercept);
            let mut of_channel = transfer_segments(channel, scaling, (layout.scale, layout.offset));
            let judged = of_channel.clone();
            if preintegrated {
                open_both_ends(&mut of_channel);
            }
            let count = of_channel.len() as u32;
            shapes.push(match shown.format {
                VoxelFormat::Rgba8 => ChannelShape::Rgba { segments: count },
                _ => ChannelShape::Scalar { segments: count },
            });
            let judge = Judge {
                format: shown.format,
                layout: *layout,
                segments: judged,
                skipping: settings.skipping,
            };
            judges.insert(source.channels[judges.len()], judge);
            segments.extend(of_channel);
        }
        let numbers = atlases.numbers;
        let stored = atlases.plans.iter().all(|atlas| atlas.layout.spec.stored);
        let copy_path = if stored { CopyPath::Placed } else { CopyPath::Straight };
        let world_from_voxel = data.world_from_voxel(0);
        let substitute = scene.quality.refine == Refine::Substitute;
        let finest: Vec<u8> = volume
            .channels
            .iter()
            .zip(&source.channels)
            .map(|(channel, of)| {
                finest_level(&*source.source, *of, channel, &judges[of], &scene.quality)
            })
            .collect();
        if !substitute && (scene.quality.level_loss.is_some() || finest.iter().any(|of| *of > 0)) {
            return Err(volume.place.error("level_min of a channel and level_loss need refine \"substitute\": set it, or leave them out".to_owned()));
        }
        // No coarser than any channel allows, and no finer than all do.
        let bounds = volume.channels.iter().filter_map(|channel| channel.level_max);
        let levels = LevelChoice {
            step: scene.quality.sample_edges(),
            level_min: finest.iter().copied().min().unwrap_or(0).max(settings.level_min),
            level_max: bounds.chain(scene.quality.level_max).min(),
            shift: settings.level_shift,
        };
        if preintegrated {
            check_spans(&scene.quality, &world_from_voxel)?;
        }
        let size = scene.picture.size;
        let mut views: Vec<ViewLevels> = scene
            .views
            .iter()
            .map(|view| {
                ViewLevels::new(view, size, description, &world_from_voxel, &numbers, levels)
            })
            .collect();
        if settings.paging.traversal == Traversal::Octree {
            if substitute {
                return Err(volume.place.error("traversal octree, which is here to compare with, only refines exactly: set refine = \"exact\" or traversal residency-octree".to_owned()));
            }
            // Coarser bricks are wanted before finer ones. All have to fit: ranks protect none of them.
            let levels = views.iter_mut().flat_map(|view| &mut view.levels);
            levels
                .filter(|level| level.rank_first == RANK_NONE)
                .for_each(|level| level.rank_first = 0);
        }
        let held = if substitute { floor(description, &atlases.plans) } else { 0..0 };
        for level in held.clone() {
            views.iter_mut().for_each(|view| view.levels[usize::from(level)].held = 1);
        }
        let of_floor =
            |id: &BrickId| held.contains(&id.level) && source.channels.contains(&id.channel);
        let held = description.bricks().filter(of_floor).collect();
        let order = match (substitute, settings.paging.order) {
            (true, _) => RankOrder::Substitute,
            (false, LoadOrder::Guarded) => RankOrder::Guarded,
            (false, LoadOrder::Papers) => RankOrder::Papers,
        };
        let ranks = RankShape { levels: description.levels.count() as u32, order };
        let places = numbers.channels.iter().map(|place| (place.atlas, place.in_atlas)).collect();
        let slots_max =
            atlases.plans.iter().map(|plan| plan.layout.slot_count()).max().unwrap_or(1);
        let slot = atlases.plans[0].layout.slot;
        let mut residency = ResidencyShape {
            ranks,
            // For any view.
            rank_count: ranks_max(&numbers, description.levels.count()),
            grants_max: slots_max.min(LIST_MAX),
            requests_max: (slots_max * 2).min(LIST_MAX),
            updates_max: UPDATES_MAX,
            atlases: atlases.plans,
        };
        residency.updates_max = UPDATES_MAX.min(residency.entries());
        let formats: Vec<_> = source.shown().map(|channel| channel.format).collect();
        let octree = octree(gpu, description, &formats, settings, scene.memory.ram_mib << 20);
        let octree_shape = |octree: &Arc<Octree>| OctreeShape {
            leaf: octree.leaf,
            word_bits: bits_of_word(volume.channels.len() as u32),
            ancestors: settings.paging.traversal == Traversal::Octree,
        };
        // Its bytes are not those of the page table's rays, between which and these `auto` may choose, and
        // depend on what is known of a box.
        let closed_form = substitute
            && settings.paging.traversal == Traversal::ResidencyOctree
            && octree.is_some()
            && !preintegrated
            && volume.channels.iter().all(|channel| channel.sample_every == 1);
        let bricks = BrickShape {
            march: Shape {
                channels: shapes,
                filter: texel_layouts[0].filter_shape(scene.quality.filter),
                early_stop: scene.quality.early_stop > 0.0,
                macrocells: MacrocellUse::Unused,
                preintegrated,
                sample_every: sample_rates(scene)?,
                nan_voxels: source.shown().any(|channel| channel.nan_voxels > 0),
            },
            places,
            atlases: residency.atlases.iter().map(|atlas| atlas.shape).collect(),
            ranks,
            finest: finest_of_rays(&finest, &views),
            several_levels: views.iter().any(ViewLevels::several),
            views: scene.views.len(),
            skipping: settings.skipping,
            octree: octree.as_ref().map(octree_shape),
            closed_form,
            show_states: settings.paging.show_states,
            marks: settings.paging.marks,
            payload: description.payload.to_array(),
            slot,
        };
        let either = settings.paging.traversal == Traversal::Auto && octree.is_some();
        let other_bricks = either.then(|| bricks.clone());
        let bricks = BrickShape { octree: bricks.octree.filter(|_| !either), ..bricks };
        let texels: u64 = slot.iter().map(|edge| u64::from(*edge)).product();
        let texel = texel_layouts.iter().map(|layout| layout.format.bytes()).max().unwrap_or(1);
        let brick_bytes = (texels * texel).next_multiple_of(16);
        let half = match settings.paging.staging_bricks {
            Some(bricks) => brick_bytes * u64::from(bricks.max(1)),
            None => (scene.memory.staging_mib << 20) / gpu.staging_halves(),
        };
        let all_slots = brick_bytes * u64::from(residency.slots());
        Ok(PagingPlan {
            numbers,
            views,
            layouts: texel_layouts,
            layout,
            judges,
            finest,
            segments,
            residency,
            octree,
            bricks,
            other_bricks,
            held,
            copy_path,
            staging_half_bytes: half.clamp(brick_bytes, all_slots.max(brick_bytes)),
        })
    }

    /// Samples of a ray, at most, over all views.
    pub fn samples_of_ray_max(&self) -> f64 {
        self.views.iter().map(|view| view.samples_of_ray_max).fold(1.0, f64::max)
    }

    /// Different values that bricks of one value may have, at most: no more than there are bricks.
    pub fn constants_max(&self) -> u32 {
        CONSTANTS_MAX.min(self.residency.entries())
    }

    /// Every buffer.
    pub fn buffers(&self, gpu: &Gpu, rays_count: u64) -> Vec<BufferSpec> {
        let spec = |name, bytes, home| BufferSpec { name, bytes, home };
        let of = |count: usize, bytes: usize| (count * bytes) as u64;
        let per_ray = |bytes: usize| rays_count * bytes as u64;
        let mut specs = vec![
            spec("views", of(self.views.len(), size_of::<ViewRays>()), MemoryHome::Upload),
            spec(
                "transfer",
                of(self.segments.len(), size_of::<TransferSegment>()),
                MemoryHome::Upload,
            ),
            spec("constants", u64::from(self.constants_max()) * 16, MemoryHome::Upload),
            spec("picture", per_ray(16), MemoryHome::Readback),
            spec("counters", 8, MemoryHome::Readback),
            spec("ray_geometry", per_ray(size_of::<RayGeometry>()), MemoryHome::Device),
            spec("ray_state", per_ray(size_of::<RayState>()), MemoryHome::Device),
            spec("ray_block", per_ray(size_of::<RayBlock>()), MemoryHome::Device),
            spec("ray_place", per_ray(4), MemoryHome::Device),
        ];
        if let Some(octree) = &self.octree {
            let words = LeafWords::bytes(octree, self.layouts.len());
            specs.push(spec("leaf_words", words, MemoryHome::Upload));
            let leaves = of(octree.trees.len(), size_of::<LevelLeaves>());
            specs.push(spec("level_leaves", leaves, MemoryHome::Upload));
        }
        if self.copy_path == CopyPath::Placed {
            specs.push(spec("upload", self.staging_half_bytes, MemoryHome::Device));
            specs.push(Placing::placements_spec(self.residency.slots() as usize));
        }
        specs.extend(self.residency.buffers());
        specs.extend(Staging::specs(gpu, self.staging_half_bytes, u64::MAX));
        specs
    }

    /// Turns of all loops of march_bricks over one block of samples, at most.
    pub fn turns_of_block(&self) -> u32 {
        let shapes = [&self.bricks].into_iter().chain(&self.other_bricks);
        shapes.map(BrickShape::turns_of_block).max().unwrap_or(1)
    }

    /// Every pass, in the order of a round, and how often a round dispatches it.
    pub fn variants(&self, march_dispatches: u32) -> Vec<(Variant, u32)> {
        let [publish, manage @ ..] = self.residency.variants();
        let atlases = self.residency.atlases.len() as u32;
        let resolve = match self.bricks.show_states {
            true => resolve::states_variant(),
            false => resolve::variant(),
        };
        let mut variants = vec![
            (publish, 1),
            (rays::brick_variant(self.views.len(), self.residency.ranks.levels), 1),
            (self.bricks.variant(), march_dispatches),
        ];
        variants.extend(manage.map(|variant| (variant, atlases)));
        variants.push((resolve, 1));
        variants.extend(self.other_bricks.iter().map(|of| (of.variant(), march_dispatches)));
        if self.copy_path == CopyPath::Placed {
            let formats = self.residency.atlases.iter().map(|atlas| atlas.layout.spec.format);
            variants.extend(formats.map(|format| (place::variant(format), 1)));
        }
        variants
    }
}

/// The octree's nodes; nothing where rays use none, or no word has room for so many channels.
fn octree(
    gpu: &Gpu,
    description: &Description,
    formats: &[VoxelFormat],
    settings: &Settings,
    ram_bytes: u64,
) -> Option<Arc<Octree>> {
    let PagingSettings { traversal, leaf, fan_out, show_states, .. } = settings.paging;
    // A box that is crossed does not tell what is absent from what is hidden.
    let octree =
        matches!(traversal, Traversal::Auto | Traversal::ResidencyOctree | Traversal::Octree);
    let used = octree && settings.skipping && !show_states;
    if !used || formats.len() > CHANNELS_MAX as usize {
        return None;
    }
    // Ranges of all channels, the word of a node and of most leaves.
    let words: usize = formats.iter().map(|format| Coding::of(*format).words()).sum();
    let of_ram = ram_bytes / OCTREE_SHARE / (4 * (words as u64 + 2));
    let of_device =
        gpu.facts().storage_bytes_max * 8 / u64::from(bits_of_word(formats.len() as u32));
    let nodes_max = of_ram.min(of_device);
    // Nodes that have a brick each are no smaller than one.
    let leaf = if traversal == Traversal::Octree { description.payload.to_array() } else { leaf };
    let wanted = Wanted { leaf, fan_out, nodes_max };
    Octree::new(&description.levels, description.payload, &wanted).map(Arc::new)
}

/// The channels' levels where they are coarser than some level that rays are in; else 0.
fn finest_of_rays(finest: &[u8], views: &[ViewLevels]) -> Vec<u32> {
    let of_rays = views.iter().map(|view| view.in_use[0]).min().unwrap_or(0);
    let of = |finest: &u8| if u32::from(*finest) > of_rays { u32::from(*finest) } else { 0 };
    finest.iter().map(of).collect()
}

/// Ranks of any view, at most: bricks from the first to the farthest along each axis, level by level.
fn ranks_max(numbers: &BrickNumbers, levels: usize) -> u32 {
    (0..levels).map(|level| numbers.bricks(level).iter().sum::<u32>()).sum()
}

/// The coarsest levels that together take an eighth of every atlas at most: the floor.
fn floor(description: &Description, atlases: &[AtlasPlan]) -> Range<u8> {
    let count = description.levels.count() as u8;
    let fits = |level: u8| {
        let bricks = |level| description.grid(level).map_or(0, |grid| grid.bricks().voxel_count());
        let places: u128 = (level..count).map(bricks).sum();
        atlases.iter().all(|atlas| {
            places * u128::from(atlas.shape.channels) <= u128::from(atlas.layout.slot_count() / 8)
        })
    };
    (0..count).find(|level| fits(*level)).unwrap_or(count)..count
}

struct Atlases {
    plans: Vec<AtlasPlan>,
    numbers: BrickNumbers,
}

/// Both ends of a sample are to lie in the slot of the brick that its middle is in: less than half a voxel
/// outside the brick.
fn check_spans(quality: &Quality, world_from_voxel: &WorldFromVoxel) -> Result<()> {
    let sample_world = quality.sample_edges() * world_from_voxel.smallest_edge();
    let voxels = sample_world * world_from_voxel.voxels_per_world_max();
    if voxels < 1.0 {
        return Ok(());
    }
    Err(Error::input(format!(
        "step {} is too long for integrator \"preintegrated\" in pages: at most {:.3} keeps a sample within a brick's border, or use integrator \"riemann\"",
        quality.step,
        (quality.step / voxels * 999.0).floor() / 1000.0
    )))
}

/// The texel layout of every channel, the atlases in the layout that suits device and size, and how that
/// was chosen.
fn fitting_atlases(
    gpu: &Gpu,
    data: &SceneData,
    settings: &Settings,
    meter: LayoutMeter,
) -> Result<(Vec<TexelLayout>, Atlases, PlannedLayout)> {
    let source = &data.volumes[0];
    let formats = || source.shown().map(|channel| channel.format);
    let of_layout = |kind| -> Result<(Vec<TexelLayout>, Atlases)> {
        let layout =
            |channel: &ChannelDescription| TexelLayout::of(channel.format, channel.range, kind);
        let layouts: Vec<TexelLayout> = source.shown().map(layout).collect();
        let atlases = atlases_of(gpu, data, settings, &layouts)?;
        Ok((layouts, atlases))
    };
    let possible = quads_possible(settings.layout, data.scene.quality.filter, formats())?;
    let plain = of_layout(Layout::Plain);
    let quads = possible.then(|| of_layout(Layout::Quads));
    let enough = |plan: &AtlasPlan| {
        let slots = plan.layout.slot_count();
        slots >= QUADS_SLOTS_MIN.min(plan.entry_count) || settings.paging.atlas_slots.is_some()
    };
    let unfit = match &quads {
        None => Some("quads need filter \"exact\" and no RGBA channel".to_owned()),
        Some(Ok((_, atlases))) if atlases.plans.iter().all(enough) => None,
        Some(_) => Some(format!("atlas_mib holds fewer than {QUADS_SLOTS_MIN} bricks in quads")),
    };
    let widest = formats().max_by_key(|format| format.bytes());
    let prices = || widest.map_or(Ok(None), meter);
    let chosen = choose(settings.layout, unfit, gpu.facts().kind, prices)?;
    let cost = |found: &Result<(Vec<TexelLayout>, Atlases)>| {
        let (_, atlases) = found.as_ref().ok()?;
        let bytes = |plan: &AtlasPlan| Image::memory_bytes(gpu, &plan.layout.spec);
        let slots = |plan: &AtlasPlan| u64::from(plan.layout.slot_count());
        let plans = || atlases.plans.iter();
        Some((plans().map(bytes).sum(), Some(plans().map(slots).sum())))
    };
    let costs = [cost(&plain), quads.as_ref().and_then(cost)];
    let (layouts, atlases) = match (chosen.layout, quads) {
        (Layout::Quads, Some(quads)) => quads?,
        _ => plain?,
    };
    Ok((layouts, atlases, chosen.planned(costs)))
}

fn atlases_of(
    gpu: &Gpu,
    data: &SceneData,
    settings: &Settings,
    layouts: &[TexelLayout],
) -> Result<Atlases> {
    let scene = &data.scene;
    let (volume, source) = (&scene.volumes[0], &data.volumes[0]);
    let description = source.source.description();
    let linear = scene.quality.filter == Filter::Hardware;
    let mut formats = Vec::new();
    let mut channels = Vec::new();
    for (layout, in_source) in layouts.iter().zip(&source.channels) {
        let format = layout.format;
        if !gpu.samples(format, linear) {
            return Err(Error::machine(format!(
                "device \"{}\" cannot sample{} images of {}: choose another with --device{}",
                gpu.facts().name,
                if linear { " and filter" } else { "" },
                format.name(),
                if linear { ", or --filter exact" } else { "" }
            )));
        }
        let atlas = formats.iter().position(|known| *known == format).unwrap_or_else(|| {
            formats.push(format);
            formats.len() - 1
        });
        let in_atlas = channels.iter().filter(|c: &&ChannelPlace| c.atlas == atlas).count() as u32;
        channels.push(ChannelPlace { in_source: *in_source, atlas, in_atlas });
    }
    let numbers = BrickNumbers::new(description, channels, formats.len()).ok_or_else(|| {
        volume.at(Error::input(format!(
            "{} voxels in bricks of {} are more bricks than this program numbers: lower size or import with larger bricks",
            description.size(),
            description.payload
        )))
    })?;
    let (_, slot) = description.brick(description.brick_largest());
    let slot = slot.to_array();
    let can_place = formats.iter().all(|format| gpu.stores(*format));
    let hands_over = settings.paging.hands_over || gpu.topology() == QueueTopology::Ownership;
    let placed = match settings.paging.copy_path {
        Some(CopyPath::Straight) if hands_over => {
            return Err(Error::arguments(
                "--copy-path straight: --queues ownership hands an upload buffer over, which bricks are placed from: leave one out",
            ));
        }
        None if hands_over && !can_place => {
            return Err(Error::machine(format!(
                "--queues ownership: device \"{}\" has shaders store into no such images: use transfer-family",
                gpu.facts().name
            )));
        }
        None if hands_over => true,
        Some(CopyPath::Placed) if !can_place => {
            return Err(Error::machine(format!(
                "--copy-path placed: device \"{}\" has shaders store into no such images: use straight",
                gpu.facts().name
            )));
        }
        Some(path) => path == CopyPath::Placed,
        // Straight copies are the faster ones everywhere we measured (`ashfall bench upload`), and
        // the transfer role never gets a queue that copies whole images alone.
        None => false,
    };
    let texels: u64 = slot.iter().map(|edge| u64::from(*edge)).product();
    let atlas_bytes = scene.memory.atlas_mib << 20;
    let weight = |atlas: usize| u64::from(numbers.atlas(atlas).1) * formats[atlas].bytes();
    let weights: u64 = (0..formats.len()).map(weight).sum();
    let mut plans: Vec<AtlasPlan> = Vec::new();
    for (atlas, format) in formats.iter().enumerate() {
        let (entry_first, channels, entry_count) = numbers.atlas(atlas);
        let bytes_max = atlas_bytes / weights * weight(atlas);
        let least = (2 * channels).max(2).min(entry_count);
        let slots_max = settings.paging.atlas_slots.unwrap_or(u32::MAX).min(entry_count);
        let name = ATLAS_NAMES[atlas];
        let layout = AtlasLayout::fit(gpu, name, *format, placed, slot, slots_max, bytes_max)
            .filter(|layout| layout.slot_count() >= least.min(slots_max));
        let Some(layout) = layout else {
            // What the device takes for them, which is more than their texels.
            let smallest = AtlasLayout::fit(gpu, name, *format, placed, slot, least, u64::MAX)
                .map_or(u64::from(least) * texels * format.bytes(), |layout| {
                    Image::memory_bytes(gpu, &layout.spec)
                });
            let needed = smallest.div_ceil(weight(atlas)) * weights;
            return Err(volume.place.error(format!(
                "volume \"{}\" needs room for {least} bricks of {} bytes, {} MiB with all its channels, but atlas_mib is {}: raise --atlas-mib or import with smaller bricks",
                volume.name,
                texels * format.bytes(),
                needed.div_ceil(1 << 20),
                scene.memory.atlas_mib
            )));
        };
        if layout.slot_count() < least {
            return Err(Error::arguments(format!(
                "--atlas-slots: the scene needs at least {least}, got {}",
                layout.slot_count()
            )));
        }
        let slot_first =
            plans.last().map_or(0, |plan| plan.shape.slot_first + plan.layout.slot_count());
        let slots_across = [layout.slots[0], layout.slots[1]];
        let shape = AtlasShape { entry_first, channels, slot_first, slots_across };
        plans.push(AtlasPlan { layout, shape, entry_count });
    }
    Ok(Atlases { plans, numbers })
}
