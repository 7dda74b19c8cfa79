//! Counts every Vulkan object that is created, so that a plan can be held against reality.

use std::collections::BTreeMap;
use std::sync::Mutex;

/// Kinds of Vulkan objects that the ground floor creates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the names are Vulkan's own")]
pub enum ObjectKind {
    Buffer,
    Image,
    ImageView,
    Sampler,
    DeviceMemory,
    ShaderModule,
    DescriptorSetLayout,
    PipelineLayout,
    Pipeline,
    DescriptorPool,
    DescriptorSet,
    CommandPool,
    CommandBuffer,
    QueryPool,
    Semaphore,
}

impl ObjectKind {
    /// Vulkan's name in snake case, as in `plan --json`.
    pub const fn name(self) -> &'static str {
        match self {
            ObjectKind::Buffer => "buffer",
            ObjectKind::Image => "image",
            ObjectKind::ImageView => "image_view",
            ObjectKind::Sampler => "sampler",
            ObjectKind::DeviceMemory => "device_memory",
            ObjectKind::ShaderModule => "shader_module",
            ObjectKind::DescriptorSetLayout => "descriptor_set_layout",
            ObjectKind::PipelineLayout => "pipeline_layout",
            ObjectKind::Pipeline => "pipeline",
            ObjectKind::DescriptorPool => "descriptor_pool",
            ObjectKind::DescriptorSet => "descriptor_set",
            ObjectKind::CommandPool => "command_pool",
            ObjectKind::CommandBuffer => "command_buffer",
            ObjectKind::QueryPool => "query_pool",
            ObjectKind::Semaphore => "semaphore",
        }
    }
}

/// How many objects of each kind were created since the device was.
#[derive(Debug, Default)]
pub struct Census(Mutex<BTreeMap<ObjectKind, u64>>);

impl Census {
    /// Counts one more object.
    pub(crate) fn created(&self, kind: ObjectKind) {
        let mut counts = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *counts.entry(kind).or_default() += 1;
    }

    /// Created so far, by kind; kinds never created are absent.
    pub fn counts(&self) -> BTreeMap<ObjectKind, u64> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()
    }
}
