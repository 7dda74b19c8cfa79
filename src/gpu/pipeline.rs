//! Compute pipelines made from shader variants, and the descriptor sets they are used with.

use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use crate::error::Result;
use crate::gpu::access::ResourceId;
use crate::gpu::census::ObjectKind;
use crate::gpu::device::Gpu;
use crate::gpu::instance::vulkan_failed;
use crate::gpu::reflection::{BindingKind, Reflection};
use crate::gpu::resources::Life;
use crate::gpu::retirement::Orphan;
use crate::gpu::roles::TimePoint;
use crate::gpu::shader::{Shader, Variant};

/// Objects that one pipeline and one descriptor set for it take, for plans.
pub struct ObjectsOfPipeline;

impl ObjectsOfPipeline {
    /// Kinds and how many of each.
    pub const COUNTS: [(ObjectKind, u64); 6] = [
        (ObjectKind::ShaderModule, 1),
        (ObjectKind::DescriptorSetLayout, 1),
        (ObjectKind::PipelineLayout, 1),
        (ObjectKind::Pipeline, 1),
        (ObjectKind::DescriptorPool, 1),
        (ObjectKind::DescriptorSet, 1),
    ];
}

/// Descriptor sets kept per pipeline; the oldest goes when a new one is needed.
const SETS_KEPT_MAX: usize = 8;

/// A compute pipeline of one shader variant.
pub struct ComputePipeline {
    gpu: Arc<Gpu>,
    pub(crate) life: Life,
    variant: Variant,
    reflection: Reflection,
    spirv_words: usize,
    set_layout: vk::DescriptorSetLayout,
    pub(crate) layout: vk::PipelineLayout,
    pub(crate) handle: vk::Pipeline,
    sets: Mutex<Vec<KnownSet>>,
}

struct KnownSet {
    bound: Vec<ResourceId>,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
}

/// What a descriptor points to.
#[derive(Clone, Copy)]
pub(crate) enum Descriptor {
    Buffer {
        id: ResourceId,
        handle: vk::Buffer,
    },
    /// Without a sampler: stored into.
    Image {
        id: ResourceId,
        view: vk::ImageView,
        sampler: Option<vk::Sampler>,
    },
}

impl ComputePipeline {
    /// Makes the pipeline; the driver compiles it here or at its first dispatch.
    ///
    /// # Errors
    /// Exit code 4 when the driver refuses.
    pub fn new(gpu: &Arc<Gpu>, shader: Shader) -> Result<Arc<ComputePipeline>> {
        let mut pipeline = ComputePipeline {
            gpu: gpu.clone(),
            life: Life::new(gpu, shader.variant.shader),
            variant: shader.variant,
            reflection: shader.reflection,
            spirv_words: shader.spirv.len(),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            handle: vk::Pipeline::null(),
            sets: Mutex::default(),
        };
        let device = &gpu.device;
        let bindings: Vec<_> = pipeline
            .reflection
            .bindings
            .iter()
            .map(|binding| {
                let (kind, count) = descriptor_type(binding.kind);
                vk::DescriptorSetLayoutBinding::builder()
                    .binding(binding.number)
                    .descriptor_type(kind)
                    .descriptor_count(count)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
                    .build()
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::builder().bindings(&bindings);
        // SAFETY: `bindings` lives until the call returns.
        pipeline.set_layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(|why| vulkan_failed("creating a descriptor set layout", why))?;
        gpu.census.created(ObjectKind::DescriptorSetLayout);
        let set_layouts = [pipeline.set_layout];
        let ranges = [vk::PushConstantRange {
            stage_flags: vk::ShaderStageFlags::COMPUTE,
            offset: 0,
            size: pipeline.reflection.push_bytes,
        }];
        let mut info = vk::PipelineLayoutCreateInfo::builder().set_layouts(&set_layouts);
        if pipeline.reflection.push_bytes > 0 {
            info = info.push_constant_ranges(&ranges);
        }
        // SAFETY: the set layout was just made; the arrays live until the call returns.
        pipeline.layout = unsafe { device.create_pipeline_layout(&info, None) }
            .map_err(|why| vulkan_failed("creating a pipeline layout", why))?;
        gpu.census.created(ObjectKind::PipelineLayout);
        let info = vk::ShaderModuleCreateInfo::builder().code(&shader.spirv);
        // SAFETY: the SPIR-V comes from shaderc, or from the cache with its hash intact.
        let module = unsafe { device.create_shader_module(&info, None) }
            .map_err(|why| vulkan_failed("creating a shader module", why))?;
        gpu.census.created(ObjectKind::ShaderModule);
        let stage = vk::PipelineShaderStageCreateInfo::builder()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .build();
        let info =
            vk::ComputePipelineCreateInfo::builder().stage(stage).layout(pipeline.layout).build();
        // SAFETY: module and layout are alive; the module is not needed after the call.
        let made = unsafe {
            let made = device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            device.destroy_shader_module(module, None);
            made
        };
        let made = made.map_err(|(_, why)| {
            vulkan_failed(&format!("compiling shader {}", pipeline.variant.shader), why)
        })?;
        pipeline.handle = made[0];
        gpu.census.created(ObjectKind::Pipeline);
        gpu.name_object(pipeline.handle, pipeline.variant.shader);
        Ok(Arc::new(pipeline))
    }

    /// What the shader says of itself.
    pub fn reflection(&self) -> &Reflection {
        &self.reflection
    }

    /// What the shader was made from.
    pub fn variant(&self) -> &Variant {
        &self.variant
    }

    /// 32-bit words of its SPIR-V module.
    pub fn spirv_words(&self) -> usize {
        self.spirv_words
    }

    /// The descriptor set for these resources, one per binding element, in order of binding.
    pub(crate) fn set(&self, bound: &[Vec<Descriptor>]) -> Result<vk::DescriptorSet> {
        let key: Vec<ResourceId> = bound
            .iter()
            .flatten()
            .map(|descriptor| match descriptor {
                Descriptor::Buffer { id, .. } | Descriptor::Image { id, .. } => *id,
            })
            .collect();
        let mut sets = self.sets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = sets.iter().find(|known| known.bound == key) {
            return Ok(known.set);
        }
        if sets.len() == SETS_KEPT_MAX {
            let oldest = sets.remove(0);
            self.gpu.retire(self.life.uses(), vec![Orphan::DescriptorPool(oldest.pool)]);
        }
        let (pool, set) = self.new_set(bound)?;
        sets.push(KnownSet { bound: key, pool, set });
        Ok(set)
    }

    fn new_set(
        &self,
        bound: &[Vec<Descriptor>],
    ) -> Result<(vk::DescriptorPool, vk::DescriptorSet)> {
        let device = &self.gpu.device;
        let count = |wanted: vk::DescriptorType| {
            let of_kind = self.reflection.bindings.iter().map(|b| descriptor_type(b.kind));
            of_kind.filter(|(kind, _)| *kind == wanted).map(|(_, count)| count).sum()
        };
        let sizes: Vec<_> = [
            vk::DescriptorType::STORAGE_BUFFER,
            vk::DescriptorType::UNIFORM_BUFFER,
            vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            vk::DescriptorType::STORAGE_IMAGE,
        ]
        .into_iter()
        .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count(ty) })
        .filter(|size| size.descriptor_count > 0)
        .collect();
        let info = vk::DescriptorPoolCreateInfo::builder().max_sets(1).pool_sizes(&sizes);
        // SAFETY: `sizes` lives until the call returns.
        let pool = unsafe { device.create_descriptor_pool(&info, None) }
            .map_err(|why| vulkan_failed("creating a descriptor pool", why))?;
        self.gpu.census.created(ObjectKind::DescriptorPool);
        let layouts = [self.set_layout];
        let info =
            vk::DescriptorSetAllocateInfo::builder().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are alive, and the pool was sized for this set.
        let set = unsafe { device.allocate_descriptor_sets(&info) }
            .map_err(|why| vulkan_failed("allocating a descriptor set", why))?[0];
        self.gpu.census.created(ObjectKind::DescriptorSet);
        for (binding, descriptors) in self.reflection.bindings.iter().zip(bound) {
            let mut buffers = Vec::new();
            let mut images = Vec::new();
            for descriptor in descriptors {
                match *descriptor {
                    Descriptor::Buffer { handle, .. } => buffers.push(vk::DescriptorBufferInfo {
                        buffer: handle,
                        offset: 0,
                        range: vk::WHOLE_SIZE,
                    }),
                    Descriptor::Image { view, sampler, .. } => {
                        images.push(vk::DescriptorImageInfo {
                            sampler: sampler.unwrap_or_default(),
                            image_view: view,
                            image_layout: vk::ImageLayout::GENERAL,
                        });
                    }
                }
            }
            let write = vk::WriteDescriptorSet::builder()
                .dst_set(set)
                .dst_binding(binding.number)
                .descriptor_type(descriptor_type(binding.kind).0);
            let write = if buffers.is_empty() {
                write.image_info(&images)
            } else {
                write.buffer_info(&buffers)
            };
            // SAFETY: the set is new, so not in use; what it points to was matched to the layout by
            // the recorder and is alive.
            unsafe { device.update_descriptor_sets(&[write.build()], &[]) };
        }
        Ok((pool, set))
    }

    pub(crate) fn used(&self, point: TimePoint) {
        self.life.used(point);
    }
}

impl Drop for ComputePipeline {
    fn drop(&mut self) {
        let mut orphans = vec![
            Orphan::Pipeline(self.handle),
            Orphan::PipelineLayout(self.layout),
            Orphan::DescriptorSetLayout(self.set_layout),
        ];
        let sets = self.sets.get_mut().unwrap_or_else(PoisonError::into_inner);
        orphans.extend(sets.drain(..).map(|known| Orphan::DescriptorPool(known.pool)));
        self.gpu.retire(self.life.uses(), orphans);
    }
}

fn descriptor_type(kind: BindingKind) -> (vk::DescriptorType, u32) {
    match kind {
        BindingKind::StorageBuffer { .. } => (vk::DescriptorType::STORAGE_BUFFER, 1),
        BindingKind::UniformBuffer => (vk::DescriptorType::UNIFORM_BUFFER, 1),
        BindingKind::StorageImage { count } => (vk::DescriptorType::STORAGE_IMAGE, count),
        BindingKind::SampledImage { count } => (vk::DescriptorType::COMBINED_IMAGE_SAMPLER, count),
    }
}
