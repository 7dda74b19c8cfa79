//! The submits of one round, and what their records say of slots.

use crate::error::Result;
use crate::gpu::{Record, SlotEvent, Submitted, TimePoint};
use crate::passes::{forget, march_bricks, rays};
use crate::render::frame::Tile;
use crate::render::paging::paged::Paged;
use crate::render::paging::traversal_choice::Way;
use crate::render::renderer::Renderer;
use crate::render::submit_bound::Portion;
use crate::residency::Allowance;
use crate::twins;

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
    /// What marches.
    pub portion: Portion,
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
        paged.tell_leaves()?;
        let updates = paged.next_updates(round.tile.view, round.portion.blocks)?;
        paged.residency.begin(&updates)?;
        paged.trace_published(&updates);
        let mut waits: Vec<TimePoint> = std::mem::take(&mut paged.first_copies);
        waits.extend(paged.copied_until.take());
        let push = twins::march_bricks::Push {
            tile_origin_pixel: round.tile.origin_pixel,
            tile_size_pixel: round.tile.size_pixel,
            volume_size: self.volume_size,
            view: round.tile.view,
            blocks_max: round.portion.blocks,
            early_stop: self.early_stop,
            round: paged.residency.round(),
            last: 0,
        };
        let published: Vec<u32> = updates
            .iter()
            .filter(|update| paged.host.published(update).is_some())
            .map(|update| update.slot)
            .collect();
        if self.plan.settings.paging.keep_records {
            paged.readable.extend(&published);
        }
        let Portion { dispatches, per_submit, .. } = round.portion;
        let march = match (paged.way(round.tile.view), &paged.other_march) {
            (Some(Way::Octree), Some((march, _))) => march.clone(),
            _ => paged.march.clone(),
        };
        let mut point = None;
        for first in (0..dispatches).step_by(per_submit as usize) {
            let last = dispatches.min(first + per_submit);
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
                octree: paged.octree.as_ref().map(|(_, buffers)| buffers),
            };
            for dispatch in first..last {
                let push = twins::march_bricks::Push {
                    last: u32::from(dispatch + 1 == dispatches),
                    ..push
                };
                let cache = paged.residency.buffers();
                march_bricks::record(&mut recorder, &march, cache, &paged.rays, &resources, &push);
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

    /// Submits a round without rays, in which channels are forgotten: what other bricks are in counts as used,
    /// so that free slots come first from then on. Nothing where there is nothing to forget.
    pub(super) fn submit_forget(&self, paged: &mut Paged) -> Result<Option<Submitted>> {
        let mut forgotten = std::mem::take(&mut paged.forgotten);
        // A page table that is cleared forgets everything.
        let Some(pipeline) =
            paged.forget.clone().filter(|_| paged.cleared && !forgotten.is_empty())
        else {
            return Ok(None);
        };
        paged.residency.begin(&[])?;
        let round = paged.residency.round();
        let waits: Vec<TimePoint> = paged.copied_until.take().into_iter().collect();
        let none = vec![
            Allowance { grants_max: 0, live_max: 0, held: 0 };
            paged.residency.atlases().len()
        ];
        let mut recorder = self.recorder();
        for push in &mut forgotten {
            push.round = round;
            forget::record(&mut recorder, &pipeline, paged.residency.buffers(), push);
        }
        paged.residency.publish(&mut recorder, 0);
        paged.residency.manage(&mut recorder, &none);
        let submitted = recorder.submit(&waits)?;
        paged.residency.end();
        Ok(Some(submitted))
    }

    /// Submits what turns ray states into pixels.
    pub(super) fn submit_resolve(&self, paged: &Paged, tile: Tile) -> Result<Submitted> {
        let rays = &paged.rays;
        let shows = self.plan.settings.paging.show_states;
        let states = shows.then_some((&rays.ray_block, &rays.ray_place));
        let mut recorder = self.recorder();
        self.resolve_rays(&mut recorder, &paged.resolve, &rays.ray_state, states, tile);
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

/// Adds to the last round's record which slots it granted, once that is known. Copies may have been
/// recorded since.
pub fn annotate_grants(records: &mut [Record], grants: &[u32]) {
    let mut steps = records.iter_mut().rev().flat_map(|record| record.steps.iter_mut().rev());
    if let Some(step) = steps.find(|step| step.label == "grant") {
        step.slots = grants.iter().map(|slot| (SlotEvent::Granted, *slot)).collect();
    }
}
