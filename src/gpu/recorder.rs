//! The recorder: passes say what they read and write, by name; barriers, labels, timestamps and the
//! record that tests read follow from that.
//!
//! Steps are collected as data first and written to a command buffer at submit, so that the same
//! list makes the barriers, the record and the time measurements.

use std::ops::Range;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use crate::error::Result;
use crate::gpu::access::{Access, Barrier, ResourceId};
use crate::gpu::copies::{BufferRegion, ImageRegion};
use crate::gpu::device::Gpu;
use crate::gpu::device_facts::QueueFacts;
use crate::gpu::dispatch::Dispatch;
use crate::gpu::misuse::misuse;
use crate::gpu::pipeline::{ComputePipeline, Descriptor};
use crate::gpu::record::{Record, StepKind, StepRecord, Submitted};
use crate::gpu::resources::{Buffer, Image, Life};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::timestamps::Timestamps;
use crate::gpu::write_commands;

/// Collects the steps of one submit on one role.
pub struct Recorder<'r> {
    gpu: Arc<Gpu>,
    role: RoleKind,
    timestamps: Option<&'r Timestamps>,
    pub(crate) steps: Vec<Step<'r>>,
    unguarded: Option<&'static str>,
}

pub(crate) struct Step<'r> {
    pub label: &'static str,
    pub work: Work<'r>,
    pub uses: Vec<Use<'r>>,
    /// Without hazards, but in use until the submit ends.
    pub keeps: Vec<&'r Life>,
}

pub(crate) enum Work<'r> {
    Dispatch {
        pipeline: &'r ComputePipeline,
        bound: Vec<Vec<Descriptor>>,
        push: Vec<u8>,
        groups: [u32; 3],
    },
    CopyToImage {
        source: &'r Buffer,
        target: &'r Image,
        regions: Vec<ImageRegion>,
    },
    CopyToBuffer {
        source: &'r Buffer,
        target: &'r Buffer,
        regions: Vec<BufferRegion>,
    },
    Fill {
        target: &'r Buffer,
        offset: u64,
        bytes: u64,
        value: u32,
    },
    /// A buffer goes from one role to another; on the first's queue or the second's.
    HandOver {
        target: &'r Buffer,
        from: RoleKind,
        to: RoleKind,
    },
    /// Nothing but the barrier that sets an image's layout.
    Prepare,
    HostRead,
}

pub(crate) struct Use<'r> {
    pub life: &'r Life,
    pub access: Access,
    /// An image that was not used before this recording.
    pub fresh: Option<&'r Image>,
    /// Bytes of a buffer; none: all of it.
    pub ranges: Vec<Range<u64>>,
}

impl<'r> Recorder<'r> {
    /// Starts recording for a role; `timestamps` measure its steps where given.
    pub fn new(gpu: &Arc<Gpu>, role: RoleKind, timestamps: Option<&'r Timestamps>) -> Recorder<'r> {
        Recorder { gpu: gpu.clone(), role, timestamps, steps: Vec::new(), unguarded: None }
    }

    /// What its queue can do.
    pub(crate) fn queue_facts(&self) -> Option<QueueFacts> {
        self.gpu.queue_facts(self.role).copied()
    }

    /// Starts a compute step; it is recorded by [`Dispatch::threads`].
    pub fn compute<'a>(&'a mut self, pipeline: &'r ComputePipeline) -> Dispatch<'a, 'r> {
        Dispatch::new(self, pipeline)
    }

    /// Makes what was written to a buffer visible to the host once the submit has ended.
    pub fn host_read(&mut self, buffer: &'r Buffer) {
        self.steps.push(Step {
            label: "host_read",
            work: Work::HostRead,
            uses: vec![Use::whole(&buffer.life, Access::HostRead)],
            keeps: Vec::new(),
        });
    }

    /// Gives a buffer that belongs to one role at a time to another, after all that this submit did with it.
    pub fn release(&mut self, buffer: &'r Buffer, to: RoleKind) {
        self.hand_over("release", buffer, self.role, to);
    }

    /// Takes a buffer that another role released; the submit has to wait for that one's.
    pub fn acquire(&mut self, buffer: &'r Buffer, from: RoleKind) {
        self.hand_over("acquire", buffer, from, self.role);
    }

    fn hand_over(&mut self, label: &'static str, target: &'r Buffer, from: RoleKind, to: RoleKind) {
        if !target.life.handed_over || from == to {
            misuse(format_args!("{} is not handed over", target.name()));
        }
        let work = Work::HandOver { target, from, to };
        self.steps.push(Step { label, work, uses: Vec::new(), keeps: vec![&target.life] });
    }

    /// Leaves out the barriers before steps of this label: a planted fault, for tests that show it
    /// is caught.
    pub fn leave_out_barriers_before(&mut self, label: &'static str) {
        self.unguarded = Some(label);
    }

    /// Hands the steps to the role's queue; they start when `waits` are reached.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost or out of memory.
    pub fn submit(self, waits: &[TimePoint]) -> Result<Submitted> {
        let role = self.gpu.role(self.role)?;
        let mut tracker = role.tracker.lock().unwrap_or_else(PoisonError::into_inner);
        let mut barriers: Vec<Vec<(&'static str, Barrier)>> = Vec::new();
        for step in &self.steps {
            let needed = step.uses.iter().filter_map(|used| {
                let barrier = tracker.use_next(used.life.id, used.access, used.fresh.is_some())?;
                Some((used.life.name, barrier))
            });
            let mut needed: Vec<_> = needed.collect();
            if self.unguarded == Some(step.label) {
                needed.retain(|(_, barrier)| barrier.discard);
            }
            barriers.push(needed);
        }
        let point = write_commands::submit(
            &self.gpu,
            role,
            &self.steps,
            &barriers,
            self.timestamps,
            waits,
        )?;
        drop(tracker);
        for step in &self.steps {
            for used in &step.uses {
                used.life.used(point);
            }
            step.keeps.iter().for_each(|life| life.used(point));
            if let Work::Dispatch { pipeline, .. } = &step.work {
                pipeline.used(point);
            }
        }
        let role_kind = self.role;
        let steps = self.steps.into_iter().zip(barriers).map(|(step, barriers)| StepRecord {
            label: step.label,
            kind: match step.work {
                Work::Dispatch { groups, .. } => StepKind::Dispatch(groups),
                Work::CopyToImage { .. } => StepKind::CopyToImage,
                Work::CopyToBuffer { .. } => StepKind::CopyToBuffer,
                Work::Fill { .. } => StepKind::Fill,
                Work::Prepare => StepKind::Prepare,
                Work::HostRead => StepKind::HostRead,
                Work::HandOver { target, from, to } if from == role_kind => {
                    StepKind::Release { buffer: target.name(), to }
                }
                Work::HandOver { target, from, .. } => {
                    StepKind::Acquire { buffer: target.name(), from }
                }
            },
            handed_over: (step.uses.iter().filter(|used| used.life.handed_over))
                .map(|used| used.life.name)
                .collect(),
            accesses: step.uses.iter().map(|used| (used.life.name, used.access)).collect(),
            regions: step.uses.iter().flat_map(Use::regions).collect(),
            barriers,
            slots: Vec::new(),
            by_slot: Vec::new(),
        });
        let record = Record {
            role: self.role,
            point,
            waits: waits.to_vec(),
            host: Vec::new(),
            steps: steps.collect(),
        };
        self.gpu.collect_retired();
        Ok(Submitted { point, record })
    }
}

impl<'r> Use<'r> {
    /// All of a buffer, or of an image that holds something.
    pub fn whole(life: &'r Life, access: Access) -> Use<'r> {
        Use { life, access, fresh: None, ranges: Vec::new() }
    }

    /// An image, whose layout is still to be set where nothing used it before.
    pub fn image(image: &'r Image, access: Access) -> Use<'r> {
        let fresh = !image.touched.swap(true, Ordering::AcqRel);
        Use { fresh: fresh.then_some(image), ..Use::whole(&image.life, access) }
    }

    /// Parts of a buffer.
    pub fn parts(buffer: &'r Buffer, access: Access, ranges: Vec<Range<u64>>) -> Use<'r> {
        Use { ranges, ..Use::whole(&buffer.life, access) }
    }

    fn regions(&self) -> impl Iterator<Item = (&'static str, Range<u64>, Access)> {
        self.ranges.iter().map(|range| (self.life.name, range.clone(), self.access))
    }
}

impl Step<'_> {
    /// The image whose layout a barrier of this step sets.
    pub fn fresh_image(&self, id: ResourceId) -> Option<&Image> {
        self.uses.iter().filter_map(|used| used.fresh).find(|image| image.life.id == id)
    }
}
