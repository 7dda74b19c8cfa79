//! Which bricks are on the device: atlas, page table, usage, requests, grants. The device holds the
//! truth; the host sees short lists.
//!
//! # Invariants
//! - A slot is in one of three hands: nobody's (free), a brick's (its owner, whose entry is mapped to
//!   it), or the host's (granted, in no mapped entry), who gives it back by an update that names its
//!   new owner, after whatever it copied there.
//! - An entry and a slot stand in at most one update of a round.
//!
//! # Source
//! gpu-paging-2019 sections 5.2 and 5.3; the order of loading is ours, see `twins/ranks.rs`.

mod atlas_layout;
mod lists;
mod shape;

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::{
    Buffer, BufferRegion, BufferSpec, ComputePipeline, Gpu, Image, MemoryHome, Recorder, Shader,
};
use crate::passes::cache_buffers::CacheBuffers;
use crate::passes::{choose, count, grant, publish, scan, tally};
use crate::twins::cache::{Answer, Progress};
use crate::twins::limits::OWNER_FREE;
use crate::twins::publish::{Push, Update};
use crate::twins::ranks::LevelView;

pub use atlas_layout::AtlasLayout;
pub use lists::{OfAtlas, Report};
pub use shape::{AtlasPlan, ENTRY_ALIGNMENT, ResidencyShape};

/// publish, count and grant bind other buffers every other round: a set of descriptors for each turn.
pub const PASSES_IN_TURNS: u64 = 3;

/// Buffers, atlases and pipelines of one volume's bricks.
pub struct Residency {
    shape: ResidencyShape,
    buffers: CacheBuffers,
    report: Buffer,
    /// When each slot was last used, where somebody traces it.
    used_copy: Option<Buffer>,
    atlases: Vec<Image>,
    publish: Arc<ComputePipeline>,
    tally: Arc<ComputePipeline>,
    choose: Arc<ComputePipeline>,
    count: Arc<ComputePipeline>,
    scan: Arc<ComputePipeline>,
    grant: Arc<ComputePipeline>,
    /// Which usage order is this round's, and which buffer of updates.
    turn: usize,
    round: u32,
    ranks: u32,
    prepared: bool,
}

/// What the host allows one atlas in a round.
#[derive(Clone, Copy, Debug)]
pub struct Allowance {
    /// Slots to grant, at most.
    pub grants_max: u32,
    /// Slots that bricks behind the nearest wish may fill.
    pub live_max: u32,
    /// Slots that the host was granted and has no brick for: as many wishes need none.
    pub held: u32,
}

impl Residency {
    /// Makes everything of `shape`; `shaders` are its variants, compiled.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory.
    pub fn new(gpu: &Arc<Gpu>, shape: ResidencyShape, shaders: &[Shader]) -> Result<Residency> {
        let specs = shape.buffers();
        let make = |name: &str| match specs.iter().find(|spec| spec.name == name) {
            Some(spec) => Buffer::new(gpu, spec),
            None => unreachable!("every residency has a buffer {name}"),
        };
        let optional = |name: &str| {
            let spec: Option<&BufferSpec> = specs.iter().find(|spec| spec.name == name);
            spec.map(|spec| Buffer::new(gpu, spec)).transpose()
        };
        let buffers = CacheBuffers {
            page_table: make("page_table")?,
            slot_owner: make("slot_owner")?,
            slot_used: make("slot_used")?,
            slot_needed: optional("slot_needed")?,
            usage_order: [make("usage_order_0")?, make("usage_order_1")?],
            wished: make("wished")?,
            wish_weight: optional("wish_weight")?,
            touched: make("touched")?,
            progress: make("progress")?,
            wishes_of_rank: make("wishes_of_rank")?,
            live_of_rank: make("live_of_rank")?,
            tallies: make("tallies")?,
            choice: make("choice")?,
            chunk_counts: make("chunk_counts")?,
            answers: make("answers")?,
            grants: make("grants")?,
            requests: make("requests")?,
            updates: [make("updates_0")?, make("updates_1")?],
            levels: make("levels")?,
        };
        let report = make("report")?;
        let atlases = shape
            .atlases
            .iter()
            .map(|atlas| Image::new(gpu, &atlas.layout.spec))
            .collect::<Result<Vec<_>>>()?;
        let pipeline = |index: usize| ComputePipeline::new(gpu, shaders[index].clone());
        // The next round begins where the last one, if any, left the order.
        Ok(Residency {
            publish: pipeline(0)?,
            tally: pipeline(1)?,
            choose: pipeline(2)?,
            count: pipeline(3)?,
            scan: pipeline(4)?,
            grant: pipeline(5)?,
            shape,
            buffers,
            report,
            used_copy: None,
            atlases,
            turn: 0,
            round: 0,
            ranks: 1,
            prepared: false,
        })
    }

    /// From now on every round tells when each slot was last used, too.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory.
    pub fn tell_use(&mut self, gpu: &Arc<Gpu>) -> Result<()> {
        let bytes = self.buffers.slot_used.bytes();
        let spec = BufferSpec { name: "slot_used_copy", bytes, home: MemoryHome::Readback };
        self.used_copy = Some(Buffer::new(gpu, &spec)?);
        Ok(())
    }

    /// `[slot]` the round in which a ray last used it, where that is told.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn used(&self) -> Result<Option<Vec<u32>>> {
        let Some(copy) = &self.used_copy else { return Ok(None) };
        let mut rounds = vec![0u32; self.shape.slots() as usize];
        copy.read(0, bytemuck::cast_slice_mut(&mut rounds))?;
        Ok(Some(rounds))
    }

    /// What it consists of.
    pub fn shape(&self) -> &ResidencyShape {
        &self.shape
    }

    /// Its buffers, for passes that march.
    pub fn buffers(&self) -> &CacheBuffers {
        &self.buffers
    }

    /// One image per texel format.
    pub fn atlases(&self) -> &[Image] {
        &self.atlases
    }

    /// Counts from 1.
    pub fn round(&self) -> u32 {
        self.round
    }

    /// First step of the first round, and after a change of source: every entry unmapped, every slot
    /// free. Slots in the host's hands are nobody's again.
    pub fn clear<'r>(&'r self, recorder: &mut Recorder<'r>) {
        let CacheBuffers { page_table, slot_owner, slot_used, slot_needed, .. } = &self.buffers;
        let all = |recorder: &mut Recorder<'r>, buffer: &'r Buffer, value| {
            recorder.fill("clear", buffer, 0, buffer.bytes(), value);
        };
        all(recorder, page_table, 0);
        all(recorder, slot_owner, OWNER_FREE);
        all(recorder, slot_used, 0);
        slot_needed.iter().for_each(|needed| all(recorder, needed, 0));
        if !self.prepared {
            self.atlases.iter().for_each(|atlas| recorder.prepare(atlas));
            let CacheBuffers { wished, wish_weight, wishes_of_rank, live_of_rank, .. } =
                &self.buffers;
            [wished, wishes_of_rank, live_of_rank, &self.buffers.tallies, &self.buffers.touched]
                .into_iter()
                .chain(wish_weight)
                .for_each(|buffer| all(recorder, buffer, 0));
        }
    }

    /// The usage order before the first round; goes to the device with a copy.
    pub fn first_order(&self) -> Vec<u32> {
        let of_atlas = |atlas: &AtlasPlan| {
            let first = atlas.shape.slot_first;
            first..first + atlas.layout.slot_count()
        };
        self.shape.atlases.iter().flat_map(of_atlas).collect()
    }

    /// The buffer that [`Residency::first_order`] is copied to.
    pub fn order_buffer(&self) -> &Buffer {
        &self.buffers.usage_order[self.turn]
    }

    /// Says that clear and the first order are under way.
    pub fn prepared(&mut self) {
        self.prepared = true;
    }

    /// From now on ranks are those of this view; the device must have ended its last round.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn look_through(&mut self, levels: &[LevelView], ranks: u32) -> Result<()> {
        self.ranks = ranks;
        self.buffers.levels.write(0, bytemuck::cast_slice(levels))
    }

    /// A new round with these updates; its number marks what its rays use.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn begin(&mut self, updates: &[Update]) -> Result<()> {
        self.round += 1;
        if updates.is_empty() {
            return Ok(());
        }
        self.buffers.updates[self.turn].write(0, bytemuck::cast_slice(updates))
    }

    /// Records what begins the round: the updates become visible.
    pub fn publish<'r>(&'r self, recorder: &mut Recorder<'r>, update_count: u32) {
        let updates = &self.buffers.updates[self.turn];
        let push = Push { update_count };
        publish::record(recorder, &self.publish, &self.buffers, updates, &push);
    }

    /// Records what ends the round: slots are granted, requests listed, the report made.
    pub fn manage<'r>(&'r self, recorder: &mut Recorder<'r>, allowances: &[Allowance]) {
        let buffers = &self.buffers;
        for (number, allowance) in allowances.iter().enumerate() {
            let mut cache = self.shape.round_of(number, self.round, self.ranks);
            cache.grants_max = allowance.grants_max.min(cache.grants_max);
            cache.live_max = allowance.live_max;
            cache.held = allowance.held;
            tally::record(recorder, &self.tally, buffers, &cache);
            choose::record(recorder, &self.choose, buffers, &cache);
            count::record(recorder, &self.count, buffers, self.turn, &cache);
            scan::record(recorder, &self.scan, buffers, &cache);
            grant::record(recorder, &self.grant, buffers, self.turn, &cache);
        }
        let progress_bytes = size_of::<Progress>() as u64;
        let region =
            |target_offset, bytes| [BufferRegion { source_offset: 0, target_offset, bytes }];
        recorder.copy_regions_to_buffer(
            "report",
            &buffers.progress,
            &self.report,
            &region(0, progress_bytes),
        );
        recorder.copy_regions_to_buffer(
            "report",
            &buffers.answers,
            &self.report,
            &region(progress_bytes, (allowances.len() * size_of::<Answer>()) as u64),
        );
        if let Some(copy) = &self.used_copy {
            let bytes = self.buffers.slot_used.bytes();
            recorder.copy_regions_to_buffer("report", &buffers.slot_used, copy, &region(0, bytes));
            recorder.host_read(copy);
        }
        recorder.host_read(&buffers.grants);
        recorder.host_read(&buffers.requests);
        recorder.host_read(&self.report);
    }

    /// The round was handed to the device: the next one continues from it.
    pub fn end(&mut self) {
        self.turn = 1 - self.turn;
    }

    /// What the round, once the device has ended it, tells the host.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn report(&self) -> Result<Report> {
        Report::read(&self.shape, &self.report, &self.buffers)
    }

    /// Records that bricks count anew as used for the first time.
    pub fn forget_touched<'r>(&'r self, recorder: &mut Recorder<'r>) {
        let touched = &self.buffers.touched;
        recorder.fill("forget", touched, 0, touched.bytes(), 0);
    }
}
