//! What all windows of a device share.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::extensions::khr;
use ash::vk;
use egui_ash::AshRenderState;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use crate::error::{Error, Result};
use crate::gpu::device::Gpu;
use crate::gpu::instance::vulkan_failed;
use crate::gpu::roles::RoleKind;
use crate::gpu::turns::Turn;

/// Memory for what egui draws with.
pub type EguiAllocator = Arc<Mutex<Allocator>>;

/// What all windows share. Lives longer than everything that egui-ash made with it.
pub struct Windows {
    // Freed before the device goes.
    allocator: EguiAllocator,
    pub(super) surfaces: khr::Surface,
    pub(super) swapchains: khr::Swapchain,
    pub(super) pool: vk::CommandPool,
    pub(super) gpu: Arc<Gpu>,
}

/// Frames that may be under way: one is shown while the next is painted.
pub(super) const FRAMES: usize = 2;

impl Windows {
    /// Of a device that was opened to present.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Arc<Windows>> {
        let instance = &gpu.instance;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: gpu.device.clone(),
            physical_device: gpu.physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        })
        .map_err(|why| Error::machine(format!("memory of windows cannot be managed: {why}")))?;
        let info = vk::CommandPoolCreateInfo::builder()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(gpu.queue_of(RoleKind::Render).0);
        // SAFETY: the family was enumerated from this device.
        let pool = unsafe { gpu.device.create_command_pool(&info, None) }
            .map_err(|why| vulkan_failed("creating a command pool for windows", why))?;
        Ok(Arc::new(Windows {
            allocator: Arc::new(Mutex::new(allocator)),
            surfaces: khr::Surface::new(&instance.entry, &instance.raw),
            swapchains: khr::Swapchain::new(&instance.raw, &gpu.device),
            pool,
            gpu: gpu.clone(),
        }))
    }

    /// What egui-ash draws with.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn render_state(&self) -> Result<AshRenderState<EguiAllocator>> {
        let gpu = &self.gpu;
        Ok(AshRenderState {
            entry: gpu.instance.entry.clone(),
            instance: gpu.instance.raw.clone(),
            physical_device: gpu.physical,
            device: gpu.device.clone(),
            surface_loader: self.surfaces.clone(),
            swapchain_loader: self.swapchains.clone(),
            queue: gpu.role(RoleKind::Render)?.queue,
            queue_family_index: gpu.queue_of(RoleKind::Render).0,
            command_pool: self.pool,
            allocator: self.allocator.clone(),
        })
    }

    /// Waits until nobody else uses a queue.
    pub fn turn(&self) -> Turn {
        self.gpu.turns.take()
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Windows {
    fn drop(&mut self) {
        // SAFETY: surfaces hold this in an Arc and free their command buffers when they go; egui-ash's
        // have gone with the event loop.
        unsafe { self.gpu.device.destroy_command_pool(self.pool, None) };
    }
}

/// All of a picture.
pub(super) const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

/// What a stage does with an image.
pub(super) type Use = (vk::PipelineStageFlags2, vk::AccessFlags2);

/// Brings an image from one layout into the other, between two uses.
///
/// # Safety
/// The image is alive, and the commands are being recorded.
pub(super) unsafe fn change_layout(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    image: vk::Image,
    [old, new]: [vk::ImageLayout; 2],
    from: Use,
    to: Use,
) {
    let barriers = [vk::ImageMemoryBarrier2::builder()
        .image(image)
        .old_layout(old)
        .new_layout(new)
        .src_stage_mask(from.0)
        .src_access_mask(from.1)
        .dst_stage_mask(to.0)
        .dst_access_mask(to.1)
        .subresource_range(WHOLE)
        .build()];
    let info = vk::DependencyInfo::builder().image_memory_barriers(&barriers);
    // SAFETY: the caller says so.
    unsafe { device.cmd_pipeline_barrier2(commands, &info) };
}
