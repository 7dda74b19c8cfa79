//! A compute step: every binding of a shader by its name, matched with what the SPIR-V says.

use std::sync::atomic::Ordering;

use crate::gpu::access::Access;
use crate::gpu::misuse::misuse;
use crate::gpu::pipeline::{ComputePipeline, Descriptor};
use crate::gpu::recorder::{Recorder, Step, Use, Work};
use crate::gpu::reflection::BindingKind;
use crate::gpu::resources::{Buffer, Image, Life, Sampler};

/// A compute step being described: every binding of the shader by its name.
pub struct Dispatch<'a, 'r> {
    recorder: &'a mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    named: Vec<(String, Vec<Descriptor>)>,
    uses: Vec<Use<'r>>,
    keeps: Vec<&'r Life>,
    push: Vec<u8>,
}

impl<'a, 'r> Dispatch<'a, 'r> {
    pub(crate) fn new(recorder: &'a mut Recorder<'r>, pipeline: &'r ComputePipeline) -> Self {
        Dispatch {
            recorder,
            pipeline,
            named: Vec::new(),
            uses: Vec::new(),
            keeps: Vec::new(),
            push: Vec::new(),
        }
    }

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
            sampler: Some(sampler.handle),
        };
        self.named.push((name.to_owned(), images.iter().map(descriptor).collect()));
        for (image, sampler) in images {
            if !image.touched.load(Ordering::Acquire) {
                misuse(format_args!("image {name} is sampled before it was written or prepared"));
            }
            self.uses.push(Use::whole(&image.life, Access::ShaderSample));
            self.keeps.push(&sampler.life);
        }
        self
    }

    /// The shader stores texels of these images, an array of one or more, and reads none.
    #[must_use]
    pub fn store(mut self, name: &str, images: &[&'r Image]) -> Self {
        let descriptor = |image: &&Image| Descriptor::Image {
            id: image.life.id,
            view: image.view,
            sampler: None,
        };
        self.named.push((name.to_owned(), images.iter().map(descriptor).collect()));
        for image in images {
            if !image.spec().stored {
                misuse(format_args!("image {name} is stored into, but was not made for it"));
            }
            self.uses.push(Use::image(image, Access::ShaderStore));
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
                BindingKind::StorageImage { count } => {
                    descriptors.len() == count as usize
                        && descriptors
                            .iter()
                            .all(|d| matches!(d, Descriptor::Image { sampler: None, .. }))
                }
                BindingKind::SampledImage { count } => {
                    descriptors.len() == count as usize
                        && descriptors
                            .iter()
                            .all(|d| matches!(d, Descriptor::Image { sampler: Some(_), .. }))
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
                BindingKind::SampledImage { .. } | BindingKind::StorageImage { .. } => {
                    misuse(format_args!("{name} is an image"))
                }
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
        self.uses.push(Use::whole(&buffer.life, access));
        self
    }
}
