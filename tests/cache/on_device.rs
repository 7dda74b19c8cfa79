//! The cache on the device: its buffers, one round recorded, and all of it compared with the twins.

use std::sync::Arc;

use ashfall::gpu::{Buffer, ComputePipeline};
use ashfall::passes::cache_buffers::{CacheBuffers, RankOrder, RankShape};
use ashfall::passes::{choose, count, grant, publish, scan, tally};
use ashfall::twins::cache::{Answer, Cache, CacheRound, Choice, ChunkCounts, Progress, Tallies};
use ashfall::twins::limits::OPAQUE_DEPTH;
use ashfall::twins::publish::{Push, Update};
use ashfall::twins::ray::RayState;

use crate::common::device::Device;
use crate::twin_round::Outcome;
use crate::world::{View, World};

/// Behind every buffer that passes write: what a pass writes there is seen.
const BEHIND: usize = 8;

pub struct CacheOnDevice<'d> {
    device: &'d Device,
    publish: Arc<ComputePipeline>,
    tally: Arc<ComputePipeline>,
    choose: Arc<ComputePipeline>,
    count: Arc<ComputePipeline>,
    scan: Arc<ComputePipeline>,
    grant: Arc<ComputePipeline>,
    pub buffers: CacheBuffers,
    /// Which usage order is the next round's.
    order: usize,
    /// Lists as they should be, with what earlier rounds left in them.
    answers: Vec<Answer>,
    grants: Vec<u32>,
    requests: Vec<[u32; 2]>,
}

pub fn write<T: bytemuck::NoUninit>(buffer: &Buffer, values: &[T]) {
    buffer.write(0, bytemuck::cast_slice(values)).expect("written");
}

/// A cache's buffers that hold `cache`, each with something behind its end.
pub fn buffers(device: &Device, world: &World, cache: &Cache) -> CacheBuffers {
    let numbers = |name, values: &[u32]| device.filled(name, &[values, &[0; BEHIND]].concat());
    let room = |name, count: u32| numbers(name, &vec![0; count as usize]);
    let substitute = world.plan.substitute;
    let chunks = world.atlases.iter().map(CacheRound::chunks).max().expect("an atlas");
    let levels = world.plan.levels.len() as u32;
    let updates = || room("updates", 4 * (world.entries + world.slots));
    CacheBuffers {
        page_table: numbers("page_table", &cache.page_table),
        slot_owner: numbers("slot_owner", &cache.slot_owner),
        slot_used: numbers("slot_used", &cache.slot_used),
        slot_needed: (!substitute).then(|| numbers("slot_needed", &cache.slot_needed)),
        usage_order: [(); 2].map(|()| numbers("usage_order", &cache.usage_order)),
        wished: numbers("wished", &cache.wished),
        wish_weight: substitute.then(|| numbers("wish_weight", &cache.wish_weight)),
        touched: numbers("touched", &cache.touched),
        progress: room("progress", 4),
        wishes_of_rank: room("wishes_of_rank", world.ranks_room),
        live_of_rank: room("live_of_rank", world.ranks_room),
        tallies: room("tallies", 4),
        choice: room("choice", 4),
        chunk_counts: room("chunk_counts", 8 * (chunks + 1)),
        answers: room("answers", 8 * world.atlases.len() as u32),
        grants: room("grants", world.grants_room),
        requests: room("requests", 2 * world.requests_room),
        updates: [updates(), updates()],
        levels: device.filled("levels", &vec![0u8; 96 * levels as usize]),
    }
}

impl<'d> CacheOnDevice<'d> {
    pub fn new(device: &'d Device, world: &World, cache: &Cache) -> CacheOnDevice<'d> {
        let order = match world.plan.substitute {
            true => RankOrder::Substitute,
            false => RankOrder::Guarded,
        };
        let ranks = RankShape { levels: world.plan.levels.len() as u32, order };
        CacheOnDevice {
            device,
            publish: device.pipeline(&publish::variant()),
            tally: device.pipeline(&tally::variant(ranks)),
            choose: device.pipeline(&choose::variant()),
            count: device.pipeline(&count::variant(ranks)),
            scan: device.pipeline(&scan::variant()),
            grant: device.pipeline(&grant::variant(ranks)),
            buffers: buffers(device, world, cache),
            order: 0,
            answers: vec![Answer::default(); world.atlases.len()],
            grants: vec![0; world.grants_room as usize],
            requests: vec![[0; 2]; world.requests_room as usize],
        }
    }

    pub fn publish(&mut self, view: &View, updates: &[Update], turn: usize) {
        let buffers = &self.buffers;
        write(&buffers.updates[turn], updates);
        write(&buffers.levels, &view.levels);
        let push = Push { update_count: updates.len() as u32 };
        self.device.run(|recorder| {
            publish::record(recorder, &self.publish, buffers, &buffers.updates[turn], &push);
            for buffer in [&buffers.page_table, &buffers.slot_owner, &buffers.progress] {
                recorder.host_read(buffer);
            }
        });
    }

    /// What rays mark, as if a march had written it.
    pub fn mark(&mut self, cache: &Cache) {
        let buffers = &self.buffers;
        write(&buffers.slot_used, &cache.slot_used);
        write(&buffers.wished, &cache.wished);
        write(&buffers.progress, &[cache.progress]);
        if let Some(needed) = &buffers.slot_needed {
            write(needed, &cache.slot_needed);
        }
        if let Some(weight) = &buffers.wish_weight {
            write(weight, &cache.wish_weight);
        }
    }

    /// Tally to grant of every atlas.
    pub fn round(&mut self, shapes: &[CacheRound]) {
        let (buffers, order) = (&self.buffers, self.order);
        self.device.run(|recorder| {
            for shape in shapes {
                tally::record(recorder, &self.tally, buffers, shape);
                choose::record(recorder, &self.choose, buffers, shape);
                count::record(recorder, &self.count, buffers, order, shape);
                scan::record(recorder, &self.scan, buffers, shape);
                grant::record(recorder, &self.grant, buffers, order, shape);
            }
            let written = [
                &buffers.page_table,
                &buffers.slot_owner,
                &buffers.usage_order[1 - order],
                &buffers.wished,
                &buffers.touched,
                &buffers.wishes_of_rank,
                &buffers.live_of_rank,
                &buffers.tallies,
                &buffers.choice,
                &buffers.chunk_counts,
                &buffers.answers,
                &buffers.grants,
                &buffers.requests,
            ];
            written.into_iter().chain(&buffers.wish_weight).for_each(|b| recorder.host_read(b));
        });
        self.order = 1 - order;
    }

    /// The device's own cache.
    pub fn read(&self) -> Result<Cache, String> {
        read(self.device, &self.buffers, self.order)
    }

    /// Every buffer against the twins' after a round.
    pub fn compare(
        &mut self,
        got: &Cache,
        cache: &Cache,
        shapes: &[CacheRound],
        outcomes: &[Outcome],
    ) -> Result<(), String> {
        for (shape, outcome) in shapes.iter().zip(outcomes) {
            self.answers[shape.atlas as usize] = outcome.answer;
            for (at, grant) in (shape.grant_first as usize..).zip(&outcome.lists.grants) {
                self.grants[at] = *grant;
            }
            for (at, request) in (shape.request_first as usize..).zip(&outcome.lists.requests) {
                self.requests[at] = *request;
            }
        }
        let buffers = &self.buffers;
        same("answers", &self.values(&buffers.answers)?, &self.answers)?;
        same("grants", &self.values(&buffers.grants)?, &self.grants)?;
        same("requests", &self.values(&buffers.requests)?, &self.requests)?;
        compare(got, cache, buffers.slot_needed.is_some())?;
        let zeros = |buffer: &Buffer| {
            same(
                buffer.name(),
                &self.values(buffer)?,
                &vec![0u32; buffer.bytes() as usize / 4 - BEHIND],
            )
        };
        zeros(&buffers.wishes_of_rank)?;
        zeros(&buffers.live_of_rank)?;
        same("tallies", &self.values(&buffers.tallies)?, &[Tallies::default()])?;
        // Of the atlas that came last.
        let last = &outcomes[outcomes.len() - 1];
        same("choice", &self.values::<Choice>(&buffers.choice)?, &[last.choice])?;
        let counts = self.values::<ChunkCounts>(&buffers.chunk_counts)?;
        same("chunk_counts", &counts[..last.scanned.len()], &last.scanned)
    }

    fn values<T: bytemuck::Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, String> {
        values(self.device, buffer)
    }
}

/// What a buffer made by [`buffers`] holds.
fn values<T: bytemuck::Pod>(device: &Device, buffer: &Buffer) -> Result<Vec<T>, String> {
    let mut numbers = device.values::<u32>(buffer);
    let behind = numbers.split_off(numbers.len() - BEHIND);
    if behind != [0; BEHIND] {
        return Err(format!("{}: written behind it", buffer.name()));
    }
    Ok(bytemuck::cast_slice(&numbers).to_vec())
}

/// The device's cache, with one of the usage orders.
pub fn read(device: &Device, buffers: &CacheBuffers, order: usize) -> Result<Cache, String> {
    let optional = |buffer: &Option<Buffer>| {
        buffer.as_ref().map_or(Ok(Vec::new()), |buffer| values(device, buffer))
    };
    Ok(Cache {
        page_table: values(device, &buffers.page_table)?,
        slot_owner: values(device, &buffers.slot_owner)?,
        slot_used: values(device, &buffers.slot_used)?,
        slot_needed: optional(&buffers.slot_needed)?,
        usage_order: values(device, &buffers.usage_order[order])?,
        wished: values(device, &buffers.wished)?,
        wish_weight: optional(&buffers.wish_weight)?,
        touched: values(device, &buffers.touched)?,
        progress: values::<Progress>(device, &buffers.progress)?[0],
    })
}

/// The device's cache against the twins'.
pub fn compare(got: &Cache, cache: &Cache, exact: bool) -> Result<(), String> {
    same("page_table", &got.page_table, &cache.page_table)?;
    same("slot_owner", &got.slot_owner, &cache.slot_owner)?;
    same("slot_used", &got.slot_used, &cache.slot_used)?;
    same("usage_order", &got.usage_order, &cache.usage_order)?;
    same("wished", &got.wished, &cache.wished)?;
    same("touched", &got.touched, &cache.touched)?;
    same("progress", &[got.progress], &[cache.progress])?;
    if exact {
        same("slot_needed", &got.slot_needed, &cache.slot_needed)
    } else {
        same("wish_weight", &got.wish_weight, &cache.wish_weight)
    }
}

fn same<T: PartialEq + std::fmt::Debug>(name: &str, got: &[T], wanted: &[T]) -> Result<(), String> {
    if got == wanted {
        return Ok(());
    }
    let at = got.iter().zip(wanted).position(|(got, wanted)| got != wanted);
    Err(match at {
        Some(at) => format!("{name}[{at}] is {:x?}, should be {:x?}", got[at], wanted[at]),
        None => format!("{name}: {} instead of {}", got.len(), wanted.len()),
    })
}

/// One sample of a box of one value, or many: the same but for rounding.
pub fn assert_near(got: &[RayState], wanted: &[RayState]) {
    for (ray, (got, wanted)) in got.iter().zip(wanted).enumerate() {
        let off = |got: f32, wanted: f32| (got - wanted).abs() / wanted.abs().max(1.0);
        let colors = got.color.iter().zip(wanted.color).map(|(got, wanted)| off(*got, wanted));
        // Of a sample, depth beyond what can be seen through is cut off.
        let depths = [got, wanted].map(|ray| ray.optical_depth.min(OPAQUE_DEPTH));
        let worst = colors.fold(off(depths[0], depths[1]), f32::max);
        assert!(worst < 2.0e-5, "ray {ray}: {got:?} is not {wanted:?}");
    }
}
