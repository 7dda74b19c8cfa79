//! Every object of a paged scene, and the submits of one round.

use std::sync::Arc;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::{
    Buffer, ComputePipeline, Gpu, Place, Record, Shader, SlotEvent, Staging, Submitted, TimePoint,
};
use crate::loading::{Loading, LoadingLimits};
use crate::passes::march_bricks::{self, RayBuffers};
use crate::passes::{rays, resolve};
use crate::render::frame::Tile;
use crate::render::paging::brick_texels::write_texels;
use crate::render::paging::host_cache::HostCache;
use crate::render::paging::plan::PagingPlan;
use crate::render::plan::{DISPATCHES_PER_SUBMIT, Plan};
use crate::render::renderer::Renderer;
use crate::render::scene_data::SceneData;
use crate::render::statistics::Statistics;
use crate::residency::{Allowance, Residency};
use crate::source::Description;
use crate::trace::Trace;
use crate::twins;
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
    pub description: Description,
    set_up: Arc<ComputePipeline>,
    march: Arc<ComputePipeline>,
    resolve: Arc<ComputePipeline>,
    /// The copy of the first usage order, until the first round has waited for it.
    first_copies: Vec<TimePoint>,
    /// Whether the device's buffers hold what a first round begins with.
    cleared: bool,
    /// Copied since the last flush: brick, slot and texel bytes.
    staged: Vec<(BrickId, u32, u64)>,
    /// Copies that the next round's publishing waits for.
    copied_until: Option<TimePoint>,
    /// The round after which granted slots may be written.
    granted_at: Option<TimePoint>,
    copy_ms_before: f64,
    /// Slots that rays may read, for the simulation of two queues.
    pub readable: std::collections::BTreeSet<u32>,
    pub trace: Option<Arc<Trace>>,
}

/// Without reading anything for so long, a brick's failure is final.
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
        let limits = LoadingLimits {
            ram_bytes: data.scene.memory.ram_mib << 20,
            loaders: whole.settings.paging.loader_count(),
            attempts: ATTEMPTS,
            ..LoadingLimits::default()
        };
        let source = data.volumes[0].source.clone();
        let slot_first =
            plan.residency.atlases.iter().map(|atlas| atlas.shape.slot_first).collect();
        let description = source.description().clone();
        let mut loading = Loading::new(vec![source], limits)?;
        trace.into_iter().for_each(|_| loading.keep_jobs());
        Ok(Paged {
            host: HostCache::new(
                plan.numbers.clone(),
                plan.judges.clone(),
                slot_first,
                plan.held.clone(),
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
            loading,
            residency,
            staging,
            description,
            plan,
            first_copies,
            cleared: false,
            staged: Vec::new(),
            copied_until: None,
            granted_at: None,
            copy_ms_before: 0.0,
            readable: std::collections::BTreeSet::new(),
            trace: trace.cloned(),
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
        let (atlas, in_atlas) = self.host.atlas_of_slot(slot);
        let layout = self.plan.residency.atlases[atlas].layout;
        let (_, size) = self.description.brick(id);
        let Some(judge) = self.plan.judges.get(&id.channel) else { return Ok(true) };
        let texels = size.len().unwrap_or(0) as u64;
        let bytes = texels * judge.layout.format.bytes();
        let place = Place::Image {
            image: atlas,
            start: layout.slot_origin(in_atlas),
            size: size.to_array(),
        };
        let fill =
            |target: &mut [u8]| write_texels(voxels, judge.format, size, &judge.layout, target);
        let staged = self.staging.stage_with(place, bytes, fill)?;
        self.trace_half_wait();
        if staged {
            self.staged.push((id, slot, bytes));
        }
        Ok(staged)
    }

    /// Copies everything staged; its bricks are published with the next round.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn flush(&mut self, records: Option<&mut Vec<Record>>) -> Result<()> {
        let begin = Instant::now();
        let atlases: Vec<_> = self.residency.atlases().iter().collect();
        let waits: Vec<_> = self.granted_at.into_iter().collect();
        let Some(mut submitted) = self.staging.flush("copy", &atlases, &[], &waits)? else {
            return Ok(());
        };
        let staged = std::mem::take(&mut self.staged);
        for (step, of_step) in
            submitted.record.steps.iter_mut().zip(atlases_of(&staged, &self.host))
        {
            let name = self.plan.residency.atlases[of_step.0].layout.spec.name;
            step.by_slot.push(name);
            step.slots = of_step.1.iter().map(|slot| (SlotEvent::CopiedInto, *slot)).collect();
        }
        self.trace_flush(begin, submitted.point, &staged);
        for (id, _, bytes) in staged {
            self.host.arrived(id, bytes);
        }
        self.copied_until = Some(submitted.point);
        if let Some(records) = records {
            records.push(submitted.record);
        }
        Ok(())
    }

    /// Counts begin anew.
    pub fn begin_view(&mut self) {
        self.host.begin_view();
        self.copy_ms_before = self.staging.copy_ms();
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
        statistics.bricks_absent = counts.absent;
        statistics.bricks_hidden = counts.hidden;
        statistics.bricks_constant = counts.constant;
        statistics.loading = Some(self.loading.statistics());
        self.trace_end();
        Ok(())
    }

    /// Bricks staged since the last flush.
    pub fn staged_count(&self) -> usize {
        self.staged.len()
    }

    /// The source changed: what is cached of it, here and on the device, is forgotten.
    pub fn new_epoch(&mut self) {
        self.loading.new_epoch(0);
        self.host.clear();
        self.readable.clear();
        self.cleared = false;
    }
}

/// Slots of staged bricks, atlas by atlas in the order in which the atlases were first staged for.
pub fn atlases_of(staged: &[(BrickId, u32, u64)], host: &HostCache) -> Vec<(usize, Vec<u32>)> {
    let mut atlases: Vec<(usize, Vec<u32>)> = Vec::new();
    for (_, slot, _) in staged {
        let (atlas, _) = host.atlas_of_slot(*slot);
        match atlases.iter_mut().find(|(known, _)| *known == atlas) {
            Some((_, slots)) => slots.push(*slot),
            None => atlases.push((atlas, vec![*slot])),
        }
    }
    atlases
}

/// What a round is to do.
#[derive(Clone, Copy, Debug)]
pub struct Round<'a> {
    pub tile: Tile,
    /// Rays begin anew.
    pub first: bool,
    /// Bricks count anew as touched.
    pub forget: bool,
    pub allowances: &'a [Allowance],
    pub level: u32,
}

impl Renderer {
    /// Submits a round; the last submit's time point ends it.
    pub(super) fn submit_round(
        &self,
        paged: &mut Paged,
        round: &Round,
        mut submitted: impl FnMut(Submitted) -> Result<()>,
    ) -> Result<TimePoint> {
        if let Some((first, texels)) = paged.host.new_constants() {
            paged.constants.write(first as u64 * 16, bytemuck::cast_slice(texels))?;
        }
        let updates = paged.host.take_updates(paged.plan.residency.updates_max as usize);
        paged.residency.begin(&updates)?;
        let mut waits: Vec<TimePoint> = std::mem::take(&mut paged.first_copies);
        waits.extend(paged.copied_until.take());
        let push = twins::march_bricks::Push {
            tile_origin_pixel: round.tile.origin_pixel,
            tile_size_pixel: round.tile.size_pixel,
            volume_size: self.volume_size,
            view: round.tile.view,
            blocks_max: self.plan.blocks_per_dispatch(),
            early_stop: self.early_stop,
            round: paged.residency.round(),
            last: 0,
        };
        let published: Vec<u32> = updates
            .iter()
            .filter(|update| update.slot != twins::limits::OWNER_FREE)
            .map(|update| update.slot)
            .collect();
        if self.plan.settings.paging.keep_records {
            paged.readable.extend(&published);
        }
        let dispatches = self.plan.march_dispatches();
        let mut point = None;
        for first in (0..dispatches).step_by(DISPATCHES_PER_SUBMIT as usize) {
            let last = dispatches.min(first + DISPATCHES_PER_SUBMIT);
            let mut recorder = self.recorder();
            if first == 0 {
                if !paged.cleared {
                    paged.residency.clear(&mut recorder);
                }
                if round.forget {
                    paged.residency.forget_touched(&mut recorder);
                }
                paged.residency.publish(&mut recorder, updates.len() as u32);
                if round.first {
                    let push = twins::rays::BrickPush {
                        tile_origin_pixel: round.tile.origin_pixel,
                        tile_size_pixel: round.tile.size_pixel,
                        volume_size: self.volume_size,
                        view: round.tile.view,
                        step_world: 0.0,
                        level: round.level,
                        unused_0: 0,
                    };
                    rays::record_for_bricks(
                        &mut recorder,
                        &paged.set_up,
                        &self.buffers.views,
                        paged.residency.buffers(),
                        &paged.rays,
                        &push,
                    );
                }
            }
            let Some(sampler) = &self.sampler else { unreachable!("atlases have a sampler") };
            let resources = march_bricks::Resources {
                views: &self.buffers.views,
                transfer: &self.buffers.transfer,
                constants: &paged.constants,
                atlases: paged.residency.atlases(),
                sampler,
            };
            for dispatch in first..last {
                let push = twins::march_bricks::Push {
                    last: u32::from(dispatch + 1 == dispatches),
                    ..push
                };
                let cache = paged.residency.buffers();
                march_bricks::record(
                    &mut recorder,
                    &paged.march,
                    cache,
                    &paged.rays,
                    &resources,
                    &push,
                );
            }
            if last == dispatches {
                paged.residency.manage(&mut recorder, round.allowances);
            }
            let mut ended = recorder.submit(&waits)?;
            waits.clear();
            point = Some(ended.point);
            if self.plan.settings.paging.keep_records {
                annotate(&mut ended.record, paged, &published);
            }
            submitted(ended)?;
        }
        paged.cleared = true;
        paged.residency.prepared();
        paged.residency.end();
        paged.granted_at = point;
        Ok(point.unwrap_or_else(|| unreachable!("a round has a dispatch")))
    }

    /// Submits what turns ray states into pixels.
    pub(super) fn submit_resolve(&self, paged: &Paged, tile: Tile) -> Result<Submitted> {
        let push = resolve::Push {
            background: self.background,
            unused_0: 0,
            tile_size_pixel: tile.size_pixel,
        };
        let states = self.plan.settings.paging.show_states;
        let resources = resolve::Resources {
            ray_state: &paged.rays.ray_state,
            picture: &self.buffers.picture,
            counters: &self.buffers.counters,
            states: states.then_some((&paged.rays.ray_block, &paged.rays.ray_place)),
        };
        let mut recorder = self.recorder();
        resolve::record(&mut recorder, &paged.resolve, &resources, &push);
        recorder.submit(&[])
    }
}

/// Adds to a record what it does with slots.
fn annotate(record: &mut Record, paged: &Paged, published: &[u32]) {
    let names: Vec<_> =
        paged.plan.residency.atlases.iter().map(|atlas| atlas.layout.spec.name).collect();
    for step in &mut record.steps {
        match step.label {
            "publish" => {
                step.slots = published.iter().map(|s| (SlotEvent::Published, *s)).collect();
            }
            "march_bricks" => {
                step.by_slot.extend(&names);
                step.slots = paged.readable.iter().map(|s| (SlotEvent::MayRead, *s)).collect();
            }
            _ => {}
        }
    }
}

/// Adds to the round's last record which slots it granted, once that is known.
pub fn annotate_grants(record: &mut Record, grants: &[u32]) {
    if let Some(step) = record.steps.iter_mut().rev().find(|step| step.label == "grant") {
        step.slots = grants.iter().map(|slot| (SlotEvent::Granted, *slot)).collect();
    }
}
