//! The placed copy path: bricks come into an upload buffer, from which a compute pass stores them into
//! their slots.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::{
    Access, Buffer, BufferSpec, ComputePipeline, Gpu, Image, MemoryHome, Recorder, Ring, RoleKind,
    SlotEvent, Submitted, TimePoint,
};
use crate::passes::place;
use crate::render::paging::paged::StagedBrick;
use crate::twins;
use crate::twins::place::Placement;

/// The upload buffer and the passes that place bricks from it, one per atlas.
pub struct Placing {
    pub upload: Buffer,
    placements: Ring,
    pipelines: Vec<Arc<ComputePipeline>>,
    /// First byte of the upload buffer that nothing is staged for.
    pub free: u64,
    /// The upload buffer is read until then.
    pub placed_at: Option<TimePoint>,
}

/// Slots of staged bricks, atlas by atlas in the order in which the atlases were first staged for.
pub fn slots_by_atlas(staged: &[StagedBrick]) -> Vec<(usize, Vec<u32>)> {
    let mut atlases: Vec<(usize, Vec<u32>)> = Vec::new();
    for brick in staged {
        match atlases.iter_mut().find(|(known, _)| *known == brick.atlas) {
            Some((_, slots)) => slots.push(brick.slot),
            None => atlases.push((brick.atlas, vec![brick.slot])),
        }
    }
    atlases
}

impl Placing {
    /// The placements that are written while `slots` slots can be filled. Twice as many as slots, so that
    /// writing them never has to wait: bricks that the device may not have placed yet lie in different
    /// slots, and where a batch does not fit behind them, it fits in front of them.
    pub fn placements_spec(slots: usize) -> BufferSpec {
        let bytes = 2 * slots * size_of::<Placement>();
        BufferSpec { name: "placements", bytes: bytes as u64, home: MemoryHome::Upload }
    }

    /// Makes both buffers; `pipelines` are the pass's, one per atlas. `hands_over`: the upload buffer belongs to one
    /// role at a time.
    ///
    /// # Errors
    /// Exit code 4 when the device has no memory left.
    pub fn new(
        gpu: &Arc<Gpu>,
        upload: &BufferSpec,
        placements: &BufferSpec,
        pipelines: Vec<Arc<ComputePipeline>>,
        hands_over: bool,
    ) -> Result<Placing> {
        let upload = match hands_over {
            true => Buffer::handed_over(gpu, upload)?,
            false => Buffer::new(gpu, upload)?,
        };
        let placements = Ring::new(gpu, placements)?;
        Ok(Placing { upload, placements, pipelines, free: 0, placed_at: None })
    }

    /// Places what was copied into the upload buffer, after `copied`.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn place(
        &mut self,
        gpu: &Arc<Gpu>,
        atlases: &[Image],
        staged: &[StagedBrick],
        copied: TimePoint,
    ) -> Result<Submitted> {
        let by_atlas = slots_by_atlas(staged);
        let mut placements: Vec<Placement> = Vec::new();
        let mut firsts = Vec::new();
        for (atlas, _) in &by_atlas {
            firsts.push(placements.len());
            let of_atlas = staged.iter().filter(|brick| brick.atlas == *atlas);
            placements.extend(of_atlas.map(|brick| brick.placement));
        }
        let (range, host) = self.placements.write(bytemuck::cast_slice(&placements))?;
        let first_written = range.start as usize / size_of::<Placement>();
        let bytes_of = |first: usize, count: usize| {
            let start = range.start + (first * size_of::<Placement>()) as u64;
            start..start + (count * size_of::<Placement>()) as u64
        };
        let mut recorder = Recorder::new(gpu, RoleKind::Render, None);
        if self.upload.is_handed_over() {
            recorder.acquire(&self.upload, RoleKind::Transfer);
        }
        for ((atlas, slots), first) in by_atlas.iter().zip(&firsts) {
            let of_atlas = &placements[*first..][..slots.len()];
            let texels = of_atlas.iter().map(|placement| placement.size.iter().product());
            let push = twins::place::Push {
                texels_max: texels.max().unwrap_or(1),
                first_placement: (first_written + *first) as u32,
            };
            let resources = place::Resources {
                upload: &self.upload,
                placements: self.placements.buffer(),
                atlas: &atlases[*atlas],
            };
            place::record(
                &mut recorder,
                &self.pipelines[*atlas],
                &resources,
                slots.len() as u32,
                &push,
            );
        }
        let mut submitted = recorder.submit(&[copied])?;
        submitted.record.host = host;
        let places = submitted.record.steps.iter_mut().filter(|step| step.label != "acquire");
        let steps = places.zip(by_atlas);
        for ((step, (atlas, slots)), first) in steps.zip(firsts) {
            let (name, read) = (self.placements.buffer().name(), bytes_of(first, slots.len()));
            step.regions.push((name, read, Access::ShaderRead));
            step.by_slot.push(atlases[atlas].spec().name);
            step.slots = slots.into_iter().map(|slot| (SlotEvent::Placed, slot)).collect();
        }
        self.placements.read_until(submitted.point);
        self.free = 0;
        self.placed_at = Some(submitted.point);
        Ok(submitted)
    }
}
