//! Every object of a paged scene, and how bricks come into its atlases.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::gpu::{
    Buffer, ComputePipeline, Gpu, Place, QueueTopology, Record, Shader, SlotEvent, Staging,
    TimePoint,
};
use crate::loading::{Delivery, Loading, LoadingLimits};
use crate::passes::cache_buffers::RankOrder;
use crate::passes::march_bricks::{OctreeBuffers, RayBuffers};
use crate::render::frame::Tile;
use crate::render::paging::brick_texels::write_texels;
use crate::render::paging::host_cache::HostCache;
use crate::render::paging::leaf_words::LeafWords;
use crate::render::paging::paced_rounds::Pace;
use crate::render::paging::placing::{Placing, slots_by_atlas};
use crate::render::paging::plan::PagingPlan;
use crate::render::paging::script::Script;
use crate::render::paging::settings::{CopyPath, Traversal};
use crate::render::paging::traversal_choice::{TraversalChoice, Way};
use crate::render::plan::Plan;
use crate::render::scene_data::SceneData;
use crate::render::statistics::Statistics;
use crate::residency::Residency;
use crate::source::{BrickSource, Description};
use crate::trace::{BrickStep, Trace};
use crate::twins;
use crate::twins::octree_ranges::Coding;
use crate::twins::place::Placement;
use crate::volume::BrickId;

/// See the module.
pub struct Paged {
    pub plan: PagingPlan,
    pub residency: Residency,
    pub rays: RayBuffers,
    pub constants: Buffer,
    pub staging: Staging,
    pub loading: Loading,
    pub host: HostCache,
    /// Where bricks are left out only if they show nothing of any channel: who tells of the others.
    pub joint: Option<Arc<dyn BrickSource>>,
    /// What is known of leaves, and the device's copy, where rays use an octree.
    pub octree: Option<(LeafWords, OctreeBuffers)>,
    pub description: Description,
    pub set_up: Arc<ComputePipeline>,
    pub march: Arc<ComputePipeline>,
    /// The march with the octree, and who chooses, where either may draw.
    pub other_march: Option<(Arc<ComputePipeline>, TraversalChoice)>,
    pub resolve: Arc<ComputePipeline>,
    /// The copy of the first usage order, until the first round has waited for it.
    pub first_copies: Vec<TimePoint>,
    /// Whether the device's buffers hold what a first round begins with.
    pub cleared: bool,
    /// Copied since the last flush: brick, slot and texel bytes.
    staged: Vec<StagedBrick>,
    /// What the placed copy path takes.
    placing: Option<Placing>,
    /// Copies that the next round's publishing waits for.
    pub copied_until: Option<TimePoint>,
    /// The round after which granted slots may be written.
    pub granted_at: Option<TimePoint>,
    /// Of the source, as the renderer counts it.
    pub epoch: u64,
    copy_ms_before: f64,
    /// The pass that forgets a channel, once some channel was.
    pub forget: Option<Arc<ComputePipeline>>,
    /// What it has to forget before the next round.
    pub forgotten: Vec<twins::forget::Push>,
    /// Slots that rays may read, for the simulation of two queues.
    pub readable: std::collections::BTreeSet<u32>,
    pub trace: Option<Arc<Trace>>,
    /// Where rounds have a target.
    pub pace: Option<Pace>,
    /// Where the run is written down, or done again.
    pub script: Option<Script>,
}

/// A brick in the staging half.
pub struct StagedBrick {
    pub id: BrickId,
    pub slot: u32,
    pub bytes: u64,
    pub atlas: usize,
    pub placement: Placement,
}

/// Staged bricks begin at multiples of the largest texel, in the upload buffer too.
const ALIGNMENT_BYTES: u64 = 16;
/// Reads of a brick before it counts as failed.
const ATTEMPTS: u32 = 3;

impl Paged {
    /// Makes everything of `plan`; `shaders` are its passes' variants, compiled, in their order.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory or loader threads cannot be started.
    pub fn new(
        gpu: &Arc<Gpu>,
        plan: PagingPlan,
        shaders: &[Shader],
        data: &SceneData,
        whole: &Plan,
        trace: Option<&Arc<Trace>>,
    ) -> Result<Paged> {
        let make = |name| Buffer::new(gpu, &whole.buffer(name).spec);
        let pipeline = |index: usize| ComputePipeline::new(gpu, shaders[index].clone());
        // As PagingPlan::variants lists them: publish, rays, march_bricks, five that manage, resolve.
        let manage: Vec<Shader> =
            [0, 3, 4, 5, 6, 7].iter().map(|index| shaders[*index].clone()).collect();
        let mut residency = Residency::new(gpu, plan.residency.clone(), &manage)?;
        let mut staging = Staging::new(gpu, plan.staging_half_bytes)?;
        trace.into_iter().for_each(|_| staging.keep_times());
        let mut first_copies = Vec::new();
        let order = residency.first_order();
        let words = (plan.staging_half_bytes / 4) as usize;
        for (index, part) in order.chunks(words).enumerate() {
            let bytes = bytemuck::cast_slice(part);
            staging.stage_buffer(bytes, 0, (index * words * 4) as u64)?;
            let submitted = staging.flush("order", &[], &[residency.order_buffer()], &[])?;
            first_copies.extend(submitted.map(|submitted| submitted.point));
        }
        let octree = match &plan.octree {
            None => None,
            Some(octree) => {
                let buffers = OctreeBuffers {
                    level_leaves: make("level_leaves")?,
                    leaf_words: make("leaf_words")?,
                };
                let leaves = octree.level_leaves();
                buffers.level_leaves.write(0, bytemuck::cast_slice(&leaves))?;
                let stand_ins = plan.residency.ranks.order == RankOrder::Substitute;
                Some((LeafWords::new(octree.clone(), plan.leaf_channels(), stand_ins), buffers))
            }
        };
        let codings: Vec<_> = plan.judges.values().map(|judge| Coding::of(judge.format)).collect();
        let of_octree =
            plan.octree.as_ref().map_or(0, |octree| LeafWords::host_bytes(octree, &codings));
        let target_ms = whole.settings.paging.round_target_ms(whole.views.len());
        let limits = LoadingLimits {
            ram_bytes: (data.scene.memory.ram_mib << 20).saturating_sub(of_octree),
            loaders: whole.settings.paging.loader_count(),
            attempts: ATTEMPTS,
            yielding: target_ms.is_some(),
            ..LoadingLimits::default()
        };
        let source = data.volumes[0].source.clone();
        let slot_first =
            plan.residency.atlases.iter().map(|atlas| atlas.shape.slot_first).collect();
        let description = source.description().clone();
        let mut loading = match &octree {
            Some((words, _)) => {
                let formats = description.channels.iter().map(|of| of.format).collect();
                Loading::inspecting(vec![source], limits, words.inspect(formats))?
            }
            None => Loading::new(vec![source], limits)?,
        };
        if let Some(trace) = &trace {
            trace.loaders(limits.loaders);
            loading.keep_jobs();
            residency.tell_use(gpu)?;
        }
        Ok(Paged {
            host: HostCache::new(
                plan.numbers.clone(),
                plan.judges.clone(),
                slot_first,
                plan.held.clone(),
                plan.constants_max(),
            ),
            rays: RayBuffers {
                ray_geometry: make("ray_geometry")?,
                ray_state: make("ray_state")?,
                ray_block: make("ray_block")?,
                ray_place: make("ray_place")?,
            },
            constants: make("constants")?,
            set_up: pipeline(1)?,
            march: pipeline(2)?,
            resolve: pipeline(8)?,
            other_march: match plan.other_bricks {
                Some(_) => Some((pipeline(9)?, TraversalChoice::default())),
                None => None,
            },
            placing: match plan.copy_path {
                CopyPath::Straight => None,
                CopyPath::Placed => Some(Placing::new(
                    gpu,
                    &whole.buffer("upload").spec,
                    &whole.buffer("placements").spec,
                    (9 + usize::from(plan.other_bricks.is_some())..shaders.len())
                        .map(pipeline)
                        .collect::<Result<_>>()?,
                    whole.settings.paging.hands_over || gpu.topology() == QueueTopology::Ownership,
                )?),
            },
            loading,
            joint: (whole.settings.paging.traversal == Traversal::PageTableOfPaper)
                .then(|| data.volumes[0].source.clone()),
            octree,
            residency,
            staging,
            description,
            plan,
            first_copies,
            cleared: false,
            staged: Vec::new(),
            copied_until: None,
            granted_at: None,
            epoch: 0,
            copy_ms_before: 0.0,
            forget: None,
            forgotten: Vec::new(),
            readable: std::collections::BTreeSet::new(),
            trace: trace.cloned(),
            pace: target_ms.map(Pace::new),
            script: None,
        })
    }

    /// Ranks and levels of a view from now on; the device must have ended its rounds.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn look_through(&mut self, view: usize) -> Result<()> {
        let levels = &self.plan.views[view];
        self.residency.look_through(&levels.levels, levels.ranks)
    }

    /// Converts a brick's voxels into its slot's texels in the staging half; false when that half is
    /// full.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn stage(&mut self, id: BrickId, slot: u32, voxels: &[u8]) -> Result<bool> {
        let _span = self.stage_span(id, voxels);
        let begun = self.pace.as_ref().map(|_| Instant::now());
        let (atlas, in_atlas) = self.host.atlas_of_slot(slot);
        let layout = self.plan.residency.atlases[atlas].layout;
        let (_, size) = self.description.brick(id);
        let Some(judge) = self.plan.judges.get(&id.channel) else { return Ok(true) };
        let texels = size.len().unwrap_or(0) as u64;
        let bytes = texels * judge.layout.format.bytes();
        let start = layout.slot_origin(in_atlas);
        let size_texels = size.to_array();
        let mut placement = Placement { start, first_word: 0, size: size_texels, unused_0: 0 };
        let place = match &self.placing {
            None => Place::Image { image: atlas, start, size: size_texels },
            Some(placing) => {
                placement.first_word = (placing.free / 4) as u32;
                Place::Buffer { buffer: 0, offset: placing.free }
            }
        };
        let fill =
            |target: &mut [u8]| write_texels(voxels, judge.format, size, &judge.layout, target);
        let staged = self.staging.stage_with(place, bytes, fill)?;
        let waited = self.staging.take_wait();
        self.trace_half_wait(waited);
        if staged {
            self.staged.push(StagedBrick { id, slot, bytes, atlas, placement });
            if let (Some(pace), Some(begun)) = (&mut self.pace, begun) {
                // Waiting for the device is not the host's work.
                let waited = waited.map_or(Duration::ZERO, |[from, to]| to - from);
                pace.staged(begun.elapsed().saturating_sub(waited));
            }
            self.trace_bricks(std::iter::once((id, BrickStep::Staged)));
            if let Some(placing) = &mut self.placing {
                placing.free += bytes.next_multiple_of(ALIGNMENT_BYTES);
            }
        }
        Ok(staged)
    }

    /// Copies everything staged; its bricks are published with the next round.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn flush(&mut self, gpu: &Arc<Gpu>, records: Option<&mut Vec<Record>>) -> Result<()> {
        let begin = Instant::now();
        let atlases: Vec<_> = self.residency.atlases().iter().collect();
        let mut waits: Vec<_> = self.granted_at.into_iter().collect();
        let upload: Vec<_> = self.placing.iter().map(|placing| &placing.upload).collect();
        waits.extend(self.placing.iter().filter_map(|placing| placing.placed_at));
        let Some(mut submitted) = self.staging.flush("copy", &atlases, &upload, &waits)? else {
            return Ok(());
        };
        let staged = std::mem::take(&mut self.staged);
        let straight = self.placing.is_none();
        let steps = submitted.record.steps.iter_mut().filter(|_| straight);
        for (step, of_step) in steps.zip(slots_by_atlas(&staged)) {
            let name = self.plan.residency.atlases[of_step.0].layout.spec.name;
            step.by_slot.push(name);
            step.slots = of_step.1.iter().map(|slot| (SlotEvent::CopiedInto, *slot)).collect();
        }
        self.trace_flush(begin, submitted.point, &staged);
        let mut made = vec![submitted];
        let span = self.place_span();
        if let Some(placing) = &mut self.placing {
            made.push(placing.place(gpu, self.residency.atlases(), &staged, made[0].point)?);
        }
        drop(span);
        self.copied_until = made.last().map(|submitted| submitted.point);
        if let Some(records) = records {
            records.extend(made.into_iter().map(|submitted| submitted.record));
        }
        for brick in staged {
            self.host.arrived(brick.id, brick.bytes);
        }
        Ok(())
    }

    /// Counts begin anew.
    pub fn begin_view(&mut self) {
        self.host.begin_view();
        self.pace.iter_mut().for_each(|pace| pace.pacer().begin_view());
        // What failed before may have recovered.
        if !self.host.failures().is_empty() {
            self.loading.forget_failures();
            self.forget_failures();
        }
        self.copy_ms_before = self.staging.copy_ms();
    }

    /// Failed bricks may be asked for again.
    pub fn forget_failures(&mut self) {
        if let Some((words, _)) = &mut self.octree {
            self.host.failures().keys().for_each(|id| words.forget_failed(*id));
        }
        self.host.forget_failures();
    }

    /// Tells the octree what a delivery says of leaves.
    pub fn learn(&mut self, delivery: &Delivery) {
        let Some((words, _)) = &mut self.octree else { return };
        match delivery {
            Delivery::Surveyed { entries, .. } => words.take_survey(entries),
            Delivery::Failed { id, .. } => words.failed(*id),
            Delivery::Brick { id, leaf_ranges: Some(ranges), .. } => words.take_brick(*id, ranges),
            Delivery::Brick { id, bytes, .. } => words.take_cached(*id, bytes),
        }
    }

    /// Writes what leaves were learned since the last round; the device must have ended it.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn tell_leaves(&mut self) -> Result<()> {
        let Some((words, buffers)) = &mut self.octree else { return Ok(()) };
        let changed = words.changed();
        for (offset, bytes) in &changed {
            buffers.leaf_words.write(*offset, bytes)?;
        }
        if let Some((_, choice)) = self.other_march.as_mut().filter(|_| !changed.is_empty()) {
            choice.leaves_changed(words.hidden_share());
        }
        Ok(())
    }

    /// What draws a view's next round, where either may.
    pub fn way(&self, view: u32) -> Option<Way> {
        let (_, choice) = self.other_march.as_ref()?;
        Some(match &self.script {
            Some(Script::Replay(replay)) if replay.octree => Way::Octree,
            Some(Script::Replay(_)) => Way::PageTable,
            _ => choice.way(view),
        })
    }

    /// What a tile's marching took on the device; `one_round`: all that it needed was there.
    pub fn tell_marched(&mut self, tile: Tile, ms: f64, one_round: bool) {
        let way = self.way(tile.view);
        // One tile stands for its view. Without timestamps there is nothing to compare.
        let stands = one_round && tile.is_first && ms > 0.0;
        if let (Some((_, choice)), Some(way), true) = (&mut self.other_march, way, stands) {
            choice.timed(tile.view, way, ms);
        }
    }

    /// Adds what the view cost to its statistics.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn tell(&mut self, statistics: &mut Statistics) -> Result<()> {
        let copy_ms = self.staging.finish()? - self.copy_ms_before;
        if copy_ms > 0.0 {
            statistics.add_step("copy", copy_ms);
        }
        let counts = &self.host.counts;
        statistics.bricks_uploaded = counts.uploaded;
        statistics.bricks_uploaded_by_level.clone_from(&counts.uploaded_by_level);
        statistics.bytes_uploaded = counts.uploaded_bytes;
        statistics.bricks_failed = self.host.failures().len() as u64;
        statistics.first_failure =
            self.host.failures().values().next().map(|why| why.message.clone());
        statistics.bricks_absent = counts.absent;
        statistics.bricks_hidden = counts.hidden;
        statistics.bricks_constant = counts.constant;
        statistics.constants_overflow = counts.constants_overflow;
        statistics.loading = Some(self.loading.statistics());
        statistics.paced = self.pace.as_ref().map(Pace::paced);
        self.trace_end();
        Ok(())
    }

    /// Whether bricks go through the upload buffer.
    pub fn places(&self) -> bool {
        self.placing.is_some()
    }

    /// Bricks staged since the last flush.
    pub fn staged_count(&self) -> usize {
        self.staged.len()
    }

    /// The source changed: what is cached of it, here and on the device, is forgotten.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn new_epoch(&mut self, gpu: &Arc<Gpu>) -> Result<()> {
        // What is staged goes where it was promised; nothing will show it.
        self.flush(gpu, None)?;
        self.loading.new_epoch(0);
        self.host.clear();
        self.octree.iter_mut().for_each(|(words, _)| words.forget());
        self.readable.clear();
        self.cleared = false;
        Ok(())
    }
}
