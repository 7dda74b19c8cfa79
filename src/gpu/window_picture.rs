//! The picture in a window: a texture for egui, filled from the host.

use std::sync::Arc;

use ash::vk;
use egui_ash::ImageRegistry;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use crate::error::{Error, Result};
use crate::gpu::instance::vulkan_failed;
use crate::gpu::windows::{FRAMES, WHOLE, Windows, change_layout};

/// See the module.
pub(super) struct WindowPicture {
    windows: Arc<Windows>,
    registry: ImageRegistry,
    made: Option<Made>,
}

struct Made {
    size: [u32; 2],
    smooth: bool,
    image: vk::Image,
    view: vk::ImageView,
    sampler: vk::Sampler,
    memory: Option<Allocation>,
    texture: egui::TextureId,
    /// One for each frame that may be under way.
    staging: Vec<(vk::Buffer, Option<Allocation>)>,
    /// Something was copied into it.
    filled: bool,
}

const SHOWN: vk::ImageLayout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
const COPIED: vk::ImageLayout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;

impl WindowPicture {
    pub fn new(windows: &Arc<Windows>, registry: ImageRegistry) -> WindowPicture {
        WindowPicture { windows: windows.clone(), registry, made: None }
    }

    pub fn is(&self, size: [u32; 2], smooth: bool) -> bool {
        self.made.as_ref().is_some_and(|made| made.size == size && made.smooth == smooth)
    }

    /// The texture of a picture of this size; `smooth`: values between its pixels are interpolated. The one of
    /// before must not be in use.
    pub fn resize(&mut self, size: [u32; 2], smooth: bool) -> Result<egui::TextureId> {
        if let Some(made) = self.made.as_ref().filter(|_| self.is(size, smooth)) {
            return Ok(made.texture);
        }
        self.destroy();
        let device = &self.windows.gpu.device;
        let failed = |why| vulkan_failed("making a window's picture", why);
        let info = vk::ImageCreateInfo::builder()
            .image_type(vk::ImageType::TYPE_2D)
            .format(vk::Format::R8G8B8A8_UNORM)
            .extent(vk::Extent3D { width: size[0], height: size[1], depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST)
            .sharing_mode(vk::SharingMode::EXCLUSIVE)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the device is alive.
        let image = unsafe { device.create_image(&info, None) }.map_err(failed)?;
        let mut made = Made {
            size,
            smooth,
            image,
            view: vk::ImageView::null(),
            sampler: vk::Sampler::null(),
            memory: None,
            texture: egui::TextureId::default(),
            staging: Vec::new(),
            filled: false,
        };
        let done = self.fill(&mut made);
        match done {
            Ok(()) => {
                made.texture = self.registry.register_user_texture(made.view, made.sampler);
                let texture = made.texture;
                self.made = Some(made);
                Ok(texture)
            }
            Err(why) => {
                self.free(made);
                Err(why)
            }
        }
    }

    /// Memory, view, sampler and staging of an image.
    fn fill(&self, made: &mut Made) -> Result<()> {
        let device = &self.windows.gpu.device;
        let failed = |why| vulkan_failed("making a window's picture", why);
        // SAFETY: the image was just made, and memory is bound once.
        unsafe {
            let needs = device.get_image_memory_requirements(made.image);
            let memory =
                made.memory.insert(self.allocate(needs, MemoryLocation::GpuOnly, false)?);
            device
                .bind_image_memory(made.image, memory.memory(), memory.offset())
                .map_err(failed)?;
            let info = vk::ImageViewCreateInfo::builder()
                .image(made.image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(vk::Format::R8G8B8A8_UNORM)
                .subresource_range(WHOLE);
            made.view = device.create_image_view(&info, None).map_err(failed)?;
            let filter = if made.smooth { vk::Filter::LINEAR } else { vk::Filter::NEAREST };
            let info = vk::SamplerCreateInfo::builder()
                .mag_filter(filter)
                .min_filter(filter)
                .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
                .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
            made.sampler = device.create_sampler(&info, None).map_err(failed)?;
        }
        let bytes = u64::from(made.size[0]) * u64::from(made.size[1]) * 4;
        for _ in 0..FRAMES {
            let info = vk::BufferCreateInfo::builder()
                .size(bytes)
                .usage(vk::BufferUsageFlags::TRANSFER_SRC);
            // SAFETY: the device is alive; memory is bound once to the buffer just made.
            unsafe {
                let buffer = device.create_buffer(&info, None).map_err(failed)?;
                made.staging.push((buffer, None));
                let needs = device.get_buffer_memory_requirements(buffer);
                let memory = self.allocate(needs, MemoryLocation::CpuToGpu, true)?;
                let bound = device.bind_buffer_memory(buffer, memory.memory(), memory.offset());
                if let Some(last) = made.staging.last_mut() {
                    last.1 = Some(memory);
                }
                bound.map_err(failed)?;
            }
        }
        Ok(())
    }

    /// Copies `pixels`, if there are new ones, into the texture; `frame` says whose staging is free.
    pub fn record(
        &mut self,
        commands: vk::CommandBuffer,
        frame: usize,
        pixels: Option<&[u8]>,
    ) -> Result<()> {
        let device = &self.windows.gpu.device;
        let Some(made) = &mut self.made else { return Ok(()) };
        if pixels.is_none() && made.filled {
            return Ok(());
        }
        let (buffer, memory) = &mut made.staging[frame];
        let mapped = memory.as_mut().and_then(Allocation::mapped_slice_mut);
        let Some(mapped) = mapped else {
            return Err(Error::machine("a window's staging memory is not mapped".to_owned()));
        };
        let length = made.size[0] as usize * made.size[1] as usize * 4;
        match pixels.filter(|pixels| pixels.len() == length) {
            Some(pixels) => mapped[..length].copy_from_slice(pixels),
            // Nothing was drawn yet.
            None => mapped[..length].fill(0),
        }
        let sampling =
            (vk::PipelineStageFlags2::FRAGMENT_SHADER, vk::AccessFlags2::SHADER_SAMPLED_READ);
        let copying = (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_WRITE);
        let old = if made.filled { SHOWN } else { vk::ImageLayout::UNDEFINED };
        let region = vk::BufferImageCopy::builder()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                layer_count: 1,
                ..Default::default()
            })
            .image_extent(vk::Extent3D { width: made.size[0], height: made.size[1], depth: 1 })
            .build();
        let before = (sampling.0, vk::AccessFlags2::NONE);
        // SAFETY: the staging buffer holds the whole picture, and its frame's last submit has ended; the image
        // is alive and the commands are being recorded.
        unsafe {
            change_layout(device, commands, made.image, [old, COPIED], before, copying);
            device.cmd_copy_buffer_to_image(commands, *buffer, made.image, COPIED, &[region]);
            change_layout(device, commands, made.image, [COPIED, SHOWN], copying, sampling);
        }
        made.filled = true;
        Ok(())
    }

    /// The texture must not be in use.
    pub fn destroy(&mut self) {
        if let Some(made) = self.made.take() {
            self.registry.unregister_user_texture(made.texture);
            self.free(made);
        }
    }

    fn free(&self, made: Made) {
        let device = &self.windows.gpu.device;
        // SAFETY: the caller says that nothing uses them; null handles are allowed.
        unsafe {
            device.destroy_sampler(made.sampler, None);
            device.destroy_image_view(made.view, None);
            device.destroy_image(made.image, None);
            made.staging.iter().for_each(|(buffer, _)| device.destroy_buffer(*buffer, None));
        }
        let mut allocator = self.windows.allocator();
        let of_staging = made.staging.into_iter().filter_map(|(_, memory)| memory);
        for memory in made.memory.into_iter().chain(of_staging) {
            // Freeing a block that we own fails only if the allocator's books are wrong.
            let _ = allocator.free(memory);
        }
    }

    fn allocate(
        &self,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation> {
        let description = AllocationCreateDesc {
            name: "window_picture",
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        self.windows.allocator().allocate(&description).map_err(|why| {
            Error::machine(format!(
                "the device has no {} bytes left for a window's picture ({why}): lower --atlas-mib",
                requirements.size
            ))
        })
    }
}
