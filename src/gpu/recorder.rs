//! The recorder: passes say what they read and write, by name; barriers, labels, timestamps and the
//! record that tests read follow from that.
//!
//! Steps are collected as data first and written to a command buffer at submit, so that the same
//! list makes the barriers, the record and the time measurements.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use crate::error::Result;
use crate::gpu::access::{Access, Barrier, ResourceId};
use crate::gpu::device::Gpu;
use crate::gpu::misuse::misuse;
use crate::gpu::pipeline::{ComputePipeline, Descriptor};
use crate::gpu::reflection::BindingKind;
use crate::gpu::resources::{Buffer, Image, Life, Sampler};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::timestamps::Timestamps;
use crate::gpu::write_commands;

/// Collects the steps of one submit on one role.
pub struct Recorder<'r> {
    gpu: Arc<Gpu>,
    role: RoleKind,
    timestamps: Option<&'r Timestamps>,
    steps: Vec<Step<'r>>,
    unguarded: Option<&'static str>,
}

pub(crate) struct Step<'r> {
    pub label: &'static str,
    pub work: Work<'r>,
    uses: Vec<Use<'r>>,
    /// Without hazards, but in use until the submit ends.
    keeps: Vec<&'r Life>,
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
    HostRead,
}

/// A box of an image, and where its texels lie tightly packed in a buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageRegion {
    pub buffer_offset: u64,
    pub start: [u32; 3],
    pub size: [u32; 3],
}

struct Use<'r> {
    life: &'r Life,
    access: Access,
    /// Of an image: not used before this recording.
    fresh: bool,
}

/// What kind of step was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// A compute dispatch, in workgroups.
    Dispatch([u32; 3]),
    /// A copy from a buffer into an image.
    CopyToImage,
    /// The host reads after the submit.
    HostRead,
}

/// One recorded step, as tests and traces see it.
#[derive(Clone, Debug)]
pub struct StepRecord {
    /// The pass, or what is copied.
    pub label: &'static str,
    /// What kind of step.
    pub kind: StepKind,
    /// Resource names and how they are used.
    pub accesses: Vec<(&'static str, Access)>,
    /// Barriers before the step, with the resource's name.
    pub barriers: Vec<(&'static str, Barrier)>,
}

/// All steps of one submit, in order.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// In order of execution.
    pub steps: Vec<StepRecord>,
}

/// A submit that was handed to the device.
#[derive(Clone, Debug)]
pub struct Submitted {
    /// Reached when the device has finished it.
    pub point: TimePoint,
    /// What was recorded.
    pub record: Record,
}

impl<'r> Recorder<'r> {
    /// Starts recording for a role; `timestamps` measure its steps where given.
    pub fn new(gpu: &Arc<Gpu>, role: RoleKind, timestamps: Option<&'r Timestamps>) -> Recorder<'r> {
        Recorder { gpu: gpu.clone(), role, timestamps, steps: Vec::new(), unguarded: None }
    }

    /// Starts a compute step; it is recorded by [`Dispatch::threads`].
    pub fn compute<'a>(&'a mut self, pipeline: &'r ComputePipeline) -> Dispatch<'a, 'r> {
        Dispatch {
            recorder: self,
            pipeline,
            named: Vec::new(),
            uses: Vec::new(),
            keeps: Vec::new(),
            push: Vec::new(),
        }
    }

    /// Copies a box of texels from a buffer into an image.
    pub fn copy_to_image(
        &mut self,
        label: &'static str,
        source: &'r Buffer,
        buffer_offset: u64,
        target: &'r Image,
        start: [u32; 3],
        size: [u32; 3],
    ) {
        let spec = target.spec();
        let inside = (0..3).all(|axis| {
            size[axis] > 0
                && start[axis].checked_add(size[axis]).is_some_and(|e| e <= spec.size[axis])
        });
        let texels: u64 = size.iter().map(|edge| u64::from(*edge)).product();
        if !inside || buffer_offset + texels * spec.format.bytes() > source.bytes() {
            misuse(format_args!("copy outside of {} or {}", source.name(), spec.name));
        }
        let regions = vec![ImageRegion { buffer_offset, start, size }];
        let fresh = !target.touched.swap(true, Ordering::AcqRel);
        self.steps.push(Step {
            label,
            work: Work::CopyToImage { source, target, regions },
            uses: vec![
                Use { life: &source.life, access: Access::CopyRead, fresh: false },
                Use { life: &target.life, access: Access::CopyWrite, fresh },
            ],
            keeps: Vec::new(),
        });
    }

    /// Makes what was written to a buffer visible to the host once the submit has ended.
    pub fn host_read(&mut self, buffer: &'r Buffer) {
        self.steps.push(Step {
            label: "host_read",
            work: Work::HostRead,
            uses: vec![Use { life: &buffer.life, access: Access::HostRead, fresh: false }],
            keeps: Vec::new(),
        });
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
                let barrier = tracker.use_next(used.life.id, used.access, used.fresh)?;
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
        let steps = self.steps.into_iter().zip(barriers).map(|(step, barriers)| StepRecord {
            label: step.label,
            kind: match step.work {
                Work::Dispatch { groups, .. } => StepKind::Dispatch(groups),
                Work::CopyToImage { .. } => StepKind::CopyToImage,
                Work::HostRead => StepKind::HostRead,
            },
            accesses: step.uses.iter().map(|used| (used.life.name, used.access)).collect(),
            barriers,
        });
        self.gpu.collect_retired();
        Ok(Submitted { point, record: Record { steps: steps.collect() } })
    }
}

impl Step<'_> {
    /// The handle that a barrier on this step's resource must name.
    pub fn image_of(&self, id: ResourceId) -> Option<&Image> {
        match &self.work {
            Work::CopyToImage { target, .. } if target.life.id == id => Some(target),
            _ => None,
        }
    }
}

/// A compute step being described: every binding of the shader by its name.
pub struct Dispatch<'a, 'r> {
    recorder: &'a mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    named: Vec<(String, Vec<Descriptor>)>,
    uses: Vec<Use<'r>>,
    keeps: Vec<&'r Life>,
    push: Vec<u8>,
}

impl<'r> Dispatch<'_, 'r> {
    /// The shader reads this buffer.
    #[must_use]
    pub fn read(self, name: &str, buffer: &'r Buffer) -> Self {
        self.buffer(name, buffer, Access::ShaderRead)
    }

    /// The shader reads this uniform buffer.
    #[must_use]
    pub fn uniform(self, name: &str, buffer: &'r Buffer) -> Self {
        self.buffer(name, buffer, Access::UniformRead)
    }

    /// The shader writes this buffer and does not need what it held.
    #[must_use]
    pub fn write(self, name: &str, buffer: &'r Buffer) -> Self {
        self.buffer(name, buffer, Access::ShaderWrite)
    }

    /// The shader reads and writes this buffer.
    #[must_use]
    pub fn update(self, name: &str, buffer: &'r Buffer) -> Self {
        self.buffer(name, buffer, Access::ShaderUpdate)
    }

    /// The shader samples these images, an array of one or more.
    #[must_use]
    pub fn sample(mut self, name: &str, images: &[(&'r Image, &'r Sampler)]) -> Self {
        let descriptor = |(image, sampler): &(&Image, &Sampler)| Descriptor::Image {
            id: image.life.id,
            view: image.view,
            sampler: sampler.handle,
        };
        self.named.push((name.to_owned(), images.iter().map(descriptor).collect()));
        for (image, sampler) in images {
            if !image.touched.load(Ordering::Acquire) {
                misuse(format_args!("image {} is sampled before anything was copied", name));
            }
            self.uses.push(Use { life: &image.life, access: Access::ShaderSample, fresh: false });
            self.keeps.push(&sampler.life);
        }
        self
    }

    /// The shader's push constants.
    #[must_use]
    pub fn push(mut self, constants: &impl bytemuck::NoUninit) -> Self {
        self.push = bytemuck::bytes_of(constants).to_vec();
        self
    }

    /// As many of these push constants as the variant's block has: what a variant leaves out stands
    /// at the end.
    #[must_use]
    pub fn push_front(mut self, constants: &impl bytemuck::NoUninit) -> Self {
        let bytes = bytemuck::bytes_of(constants);
        let used = self.pipeline.reflection().push_bytes as usize;
        self.push = bytes[..used.min(bytes.len())].to_vec();
        self
    }

    /// Records the step with at least this many threads, in whole workgroups.
    pub fn threads(self, threads: [u32; 3]) {
        let reflection = self.pipeline.reflection();
        let shader = self.pipeline.variant().shader;
        if self.push.len() != reflection.push_bytes as usize {
            misuse(format_args!(
                "{shader}: {} bytes of push constants, the shader has {}",
                self.push.len(),
                reflection.push_bytes
            ));
        }
        let mut named = self.named;
        let mut bound = Vec::new();
        for binding in &reflection.bindings {
            let Some(at) = named.iter().position(|(name, _)| *name == binding.name) else {
                misuse(format_args!("{shader}: nothing is bound to {}", binding.name));
            };
            let (_, descriptors) = named.swap_remove(at);
            let fits = match binding.kind {
                BindingKind::StorageBuffer { .. } | BindingKind::UniformBuffer => {
                    matches!(descriptors[..], [Descriptor::Buffer { .. }])
                }
                BindingKind::SampledImage { count } => {
                    descriptors.len() == count as usize
                        && descriptors.iter().all(|d| matches!(d, Descriptor::Image { .. }))
                }
            };
            if !fits {
                misuse(format_args!("{shader}: {} is bound to the wrong thing", binding.name));
            }
            bound.push(descriptors);
        }
        if let Some((name, _)) = named.first() {
            misuse(format_args!("{shader} has no binding named {name}"));
        }
        let groups = std::array::from_fn(|axis| threads[axis].div_ceil(reflection.workgroup[axis]));
        self.recorder.steps.push(Step {
            label: shader,
            work: Work::Dispatch { pipeline: self.pipeline, bound, push: self.push, groups },
            uses: self.uses,
            keeps: self.keeps,
        });
    }

    fn buffer(mut self, name: &str, buffer: &'r Buffer, access: Access) -> Self {
        if let Some(binding) =
            self.pipeline.reflection().bindings.iter().find(|binding| binding.name == name)
        {
            let declared = match binding.kind {
                BindingKind::StorageBuffer { reads, writes } => (reads, writes, false),
                BindingKind::UniformBuffer => (true, false, true),
                BindingKind::SampledImage { .. } => misuse(format_args!("{name} is an image")),
            };
            let uniform = access == Access::UniformRead;
            let meant = (access != Access::ShaderWrite, access.writes(), uniform);
            if declared != meant {
                misuse(format_args!(
                    "{}: {name} is bound as {access:?}, but the shader reads: {}, writes: {}",
                    self.pipeline.variant().shader,
                    declared.0,
                    declared.1
                ));
            }
        }
        let descriptor = Descriptor::Buffer { id: buffer.life.id, handle: buffer.handle };
        self.named.push((name.to_owned(), vec![descriptor]));
        self.uses.push(Use { life: &buffer.life, access, fresh: false });
        self
    }
}
