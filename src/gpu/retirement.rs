//! What was dropped while the GPU may still use it, kept until its time points are reached.

use ash::vk;
use gpu_allocator::vulkan::Allocation;

use crate::gpu::roles::RoleKind;

/// The last use of something on each role, as values of their timelines.
pub(crate) type Uses = [u64; RoleKind::COUNT];

/// A Vulkan object without an owner.
pub(crate) enum Orphan {
    Buffer(vk::Buffer),
    Image(vk::Image),
    ImageView(vk::ImageView),
    Sampler(vk::Sampler),
    Pipeline(vk::Pipeline),
    PipelineLayout(vk::PipelineLayout),
    DescriptorSetLayout(vk::DescriptorSetLayout),
    DescriptorPool(vk::DescriptorPool),
    QueryPool(vk::QueryPool),
    Memory { purpose: String, allocation: Allocation },
}

/// Orphans in the order in which they must go, and when they may.
pub(crate) struct Retired {
    pub uses: Uses,
    pub orphans: Vec<Orphan>,
}
