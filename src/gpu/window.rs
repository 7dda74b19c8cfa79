//! Windows: a surface and swapchain each, and what is painted into them: one picture from the host, and egui's
//! triangles over it.
//!
//! egui-ash owns windows and their events; surfaces, swapchains and submits are ours, so that nothing is
//! submitted where nothing changed. It is given the render role's queue: whoever calls it holds a [`crate::gpu::Turn`].

use std::sync::Arc;

use ash::vk;
use egui_ash::raw_window_handle::{
    HasRawDisplayHandle, HasRawWindowHandle, RawDisplayHandle, RawWindowHandle,
};
use egui_ash::{EguiCommand, ImageRegistry, SwapchainUpdateInfo};

use crate::error::{Error, Result};
use crate::gpu::instance::vulkan_failed;
use crate::gpu::roles::RoleKind;
use crate::gpu::window_picture::WindowPicture;
use crate::gpu::windows::{FRAMES, WHOLE, Windows, change_layout};

/// One window's surface.
pub struct WindowSurface {
    windows: Arc<Windows>,
    handles: Handles,
    surface: vk::SurfaceKHR,
    swapchain: Option<Swapchain>,
    frames: [Frame; FRAMES],
    next: usize,
    picture: WindowPicture,
}

/// A window's own names.
#[derive(Clone, Copy)]
struct Handles {
    display: RawDisplayHandle,
    window: RawWindowHandle,
}

// SAFETY: they name a window and are handed to Vulkan alone, which may be called from any thread.
unsafe impl Send for Handles {}

impl Handles {
    /// # Safety
    /// The window is alive.
    unsafe fn surface(self, windows: &Windows) -> std::result::Result<vk::SurfaceKHR, vk::Result> {
        let instance = &windows.gpu.instance;
        // SAFETY: the caller says so.
        unsafe {
            ash_window::create_surface(
                &instance.entry,
                &instance.raw,
                self.display,
                self.window,
                None,
            )
        }
    }
}

struct Frame {
    commands: vk::CommandBuffer,
    /// The image may be painted.
    acquired: vk::Semaphore,
    /// The last submit has ended.
    ended: vk::Fence,
}

struct Swapchain {
    handle: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    /// `[image]` it is painted.
    painted: Vec<vk::Semaphore>,
    format: vk::Format,
    extent: vk::Extent2D,
    /// egui does not know its images yet.
    is_new: bool,
}

impl WindowSurface {
    /// Of a window, which has to live longer than the surface.
    ///
    /// # Errors
    /// Exit code 4 when the device cannot present to it.
    pub fn new(
        windows: &Arc<Windows>,
        window: &(impl HasRawDisplayHandle + HasRawWindowHandle),
        registry: ImageRegistry,
    ) -> Result<WindowSurface> {
        let gpu = &windows.gpu;
        let handles =
            Handles { display: window.raw_display_handle(), window: window.raw_window_handle() };
        // SAFETY: both handles are those of a living window, which the caller keeps.
        let surface = unsafe { handles.surface(windows) }
            .map_err(|why| vulkan_failed("making a window's surface", why))?;
        let family = gpu.queue_of(RoleKind::Render).0;
        // SAFETY: the surface was made of this instance.
        let presents = unsafe {
            windows.surfaces.get_physical_device_surface_support(gpu.physical, family, surface)
        };
        let frames = match presents {
            Ok(true) => Frame::make(windows),
            Ok(false) => Err(Error::machine(format!(
                "device \"{}\" cannot show pictures in a window of this desktop: choose another with --device, or use `ashfall render`",
                gpu.facts().name
            ))),
            Err(why) => Err(vulkan_failed("asking whether the device shows windows", why)),
        };
        let frames = frames.inspect_err(|_| {
            // SAFETY: nothing was made of the surface.
            unsafe { windows.surfaces.destroy_surface(surface, None) };
        })?;
        Ok(WindowSurface {
            windows: windows.clone(),
            handles,
            surface,
            swapchain: None,
            frames,
            next: 0,
            picture: WindowPicture::new(windows, registry),
        })
    }

    /// The texture of a picture of this size, sRGB with straight alpha, `smooth` where its pixels are not the
    /// window's; what it shows comes with [`WindowSurface::paint`].
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory.
    pub fn texture(&mut self, size: [u32; 2], smooth: bool) -> Result<egui::TextureId> {
        if !self.picture.is(size, smooth) {
            // The texture of before may still be painted.
            self.wait()?;
        }
        self.picture.resize(size, smooth)
    }

    /// Paints and shows the window, `picture` first if there is a new one: as large as its texture. `true`:
    /// what was painted will be shown; else there was nothing to paint into.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn paint(
        &mut self,
        size: [u32; 2],
        mut egui: EguiCommand,
        picture: Option<&[u8]>,
    ) -> Result<bool> {
        if size.contains(&0) {
            return Ok(false);
        }
        if self.swapchain.as_ref().is_none_or(|swapchain| !swapchain.has_size(size)) {
            self.remake_swapchain(size)?;
        }
        let device = self.windows.gpu.device.clone();
        let Some(swapchain) = &mut self.swapchain else { return Ok(false) };
        if swapchain.is_new || egui.swapchain_recreate_required() {
            egui.update_swapchain(SwapchainUpdateInfo {
                width: swapchain.extent.width,
                height: swapchain.extent.height,
                swapchain_images: swapchain.images.clone(),
                surface_format: swapchain.format,
            });
            swapchain.is_new = false;
        }
        let frame = &self.frames[self.next];
        let fences = [frame.ended];
        // SAFETY: the fence is this frame's.
        unsafe { device.wait_for_fences(&fences, true, u64::MAX) }
            .map_err(|why| vulkan_failed("waiting for a window", why))?;
        // SAFETY: the semaphore's last wait ended with the fence.
        let image = match unsafe {
            self.windows.swapchains.acquire_next_image(
                swapchain.handle,
                u64::MAX,
                frame.acquired,
                vk::Fence::null(),
            )
        } {
            Ok((image, _)) => image,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                self.drop_swapchain()?;
                return Ok(false);
            }
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.remake_surface()?;
                return Ok(false);
            }
            Err(why) => return Err(vulkan_failed("asking for a window's image", why)),
        };
        let begin = vk::CommandBufferBeginInfo::builder()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the frame's last submit has ended, so its commands and fence are free.
        let begun = unsafe {
            device
                .reset_fences(&fences)
                .and_then(|()| device.begin_command_buffer(frame.commands, &begin))
        };
        begun.map_err(|why| vulkan_failed("painting a window", why))?;
        self.picture.record(frame.commands, self.next, picture)?;
        clear(&device, frame.commands, swapchain.images[image as usize]);
        egui.record(frame.commands, image as usize);
        // SAFETY: recording was begun above.
        unsafe { device.end_command_buffer(frame.commands) }
            .map_err(|why| vulkan_failed("painting a window", why))?;
        let (commands, waits) = ([frame.commands], [frame.acquired]);
        let (signals, stages) =
            ([swapchain.painted[image as usize]], [vk::PipelineStageFlags::ALL_COMMANDS]);
        let submit = vk::SubmitInfo::builder()
            .command_buffers(&commands)
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .signal_semaphores(&signals)
            .build();
        let (chains, images) = ([swapchain.handle], [image]);
        let present = vk::PresentInfoKHR::builder()
            .wait_semaphores(&signals)
            .swapchains(&chains)
            .image_indices(&images);
        let queue = self.windows.gpu.role(RoleKind::Render)?.queue;
        // SAFETY: the caller has its turn at the queue; what the commands use lives until the fence.
        unsafe { device.queue_submit(queue, &[submit], frame.ended) }
            .map_err(|why| vulkan_failed("painting a window", why))?;
        self.next = (self.next + 1) % FRAMES;
        // SAFETY: as above.
        match unsafe { self.windows.swapchains.queue_present(queue, &present) } {
            Ok(false) => Ok(true),
            Ok(true) | Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                self.drop_swapchain()?;
                Ok(true)
            }
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.remake_surface()?;
                Ok(false)
            }
            Err(why) => Err(vulkan_failed("showing a window", why)),
        }
    }

    /// Until nothing painted is under way.
    fn wait(&self) -> Result<()> {
        let fences: Vec<_> = self.frames.iter().map(|frame| frame.ended).collect();
        // SAFETY: the fences are this surface's.
        unsafe { self.windows.gpu.device.wait_for_fences(&fences, true, u64::MAX) }
            .map_err(|why| vulkan_failed("waiting for a window", why))
    }

    fn drop_swapchain(&mut self) -> Result<()> {
        self.wait()?;
        if let Some(swapchain) = self.swapchain.take() {
            // SAFETY: nothing painted is under way; presenting has no fence, and ends with the queue.
            unsafe { swapchain.destroy(&self.windows) };
        }
        Ok(())
    }

    /// The desktop took the surface away, as on another monitor or after a sleep; the window is still there.
    fn remake_surface(&mut self) -> Result<()> {
        self.drop_swapchain()?;
        // SAFETY: its swapchain is gone, and the window lives longer than this.
        self.surface = unsafe {
            self.windows.surfaces.destroy_surface(self.surface, None);
            self.surface = vk::SurfaceKHR::null();
            self.handles.surface(&self.windows)
        }
        .map_err(|why| vulkan_failed("making a window's surface again", why))?;
        Ok(())
    }

    fn remake_swapchain(&mut self, size: [u32; 2]) -> Result<()> {
        self.drop_swapchain()?;
        self.swapchain = Swapchain::new(&self.windows, self.surface, size)?;
        Ok(())
    }
}

impl Drop for WindowSurface {
    fn drop(&mut self) {
        // A lost device cannot be waited for; there is nothing left to protect then.
        let _ = self.drop_swapchain();
        self.picture.destroy();
        let device = &self.windows.gpu.device;
        for frame in &self.frames {
            // SAFETY: nothing painted is under way.
            unsafe {
                device.destroy_semaphore(frame.acquired, None);
                device.destroy_fence(frame.ended, None);
                device.free_command_buffers(self.windows.pool, &[frame.commands]);
            }
        }
        // SAFETY: its swapchain is gone.
        unsafe { self.windows.surfaces.destroy_surface(self.surface, None) };
    }
}

impl Frame {
    fn make(windows: &Windows) -> Result<[Frame; FRAMES]> {
        let device = &windows.gpu.device;
        let info = vk::CommandBufferAllocateInfo::builder()
            .command_pool(windows.pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(FRAMES as u32);
        let failed = |why| vulkan_failed("making what paints a window", why);
        // SAFETY: the pool is used by the thread of windows alone.
        let commands = unsafe { device.allocate_command_buffers(&info) }.map_err(failed)?;
        let ended = vk::FenceCreateInfo::builder().flags(vk::FenceCreateFlags::SIGNALED);
        let make = |at: usize| -> std::result::Result<Frame, vk::Result> {
            // SAFETY: the device is alive.
            unsafe {
                Ok(Frame {
                    commands: commands[at],
                    acquired: device.create_semaphore(&Default::default(), None)?,
                    ended: device.create_fence(&ended, None)?,
                })
            }
        };
        Ok([make(0).map_err(failed)?, make(1).map_err(failed)?])
    }
}

impl Swapchain {
    /// Nothing where the window has no area now.
    fn new(
        windows: &Windows,
        surface: vk::SurfaceKHR,
        size: [u32; 2],
    ) -> Result<Option<Swapchain>> {
        let (gpu, surfaces) = (&windows.gpu, &windows.surfaces);
        let failed = |why| vulkan_failed("making a window's images", why);
        // SAFETY: the surface was made of this instance.
        let (can, formats) = unsafe {
            (
                surfaces
                    .get_physical_device_surface_capabilities(gpu.physical, surface)
                    .map_err(failed)?,
                surfaces
                    .get_physical_device_surface_formats(gpu.physical, surface)
                    .map_err(failed)?,
            )
        };
        // Codes are painted as they are: egui's colours and the picture's are sRGB already.
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let format =
            formats.iter().find(|known| plain.contains(&known.format)).ok_or_else(|| {
                Error::machine(
                    "this desktop has no window of 8 bits a colour: use `ashfall render`"
                        .to_owned(),
                )
            })?;
        let extent = match can.current_extent.width {
            u32::MAX => vk::Extent2D {
                width: size[0].clamp(can.min_image_extent.width, can.max_image_extent.width),
                height: size[1].clamp(can.min_image_extent.height, can.max_image_extent.height),
            },
            _ => can.current_extent,
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let info = vk::SwapchainCreateInfoKHR::builder()
            .surface(surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_color_space(format.color_space)
            .image_format(format.format)
            .image_extent(extent)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(vk::CompositeAlphaFlagsKHR::OPAQUE)
            // The one mode that every device has, and it never tears.
            .present_mode(vk::PresentModeKHR::FIFO)
            .image_array_layers(1)
            .clipped(true);
        // SAFETY: all that `info` names lives; the window's former swapchain is gone.
        let handle = unsafe { windows.swapchains.create_swapchain(&info, None) }.map_err(failed)?;
        let mut swapchain = Swapchain {
            handle,
            images: Vec::new(),
            painted: Vec::new(),
            format: format.format,
            extent,
            is_new: true,
        };
        // SAFETY: the swapchain was just made, and goes unused where its semaphores cannot be.
        let filled = unsafe { swapchain.fill(windows) };
        match filled {
            Ok(()) => Ok(Some(swapchain)),
            Err(why) => {
                // SAFETY: as above.
                unsafe { swapchain.destroy(windows) };
                Err(failed(why))
            }
        }
    }

    /// # Safety
    /// The swapchain was just made.
    unsafe fn fill(&mut self, windows: &Windows) -> std::result::Result<(), vk::Result> {
        // SAFETY: the caller made the swapchain of this device.
        self.images = unsafe { windows.swapchains.get_swapchain_images(self.handle) }?;
        for _ in &self.images {
            // SAFETY: the device is alive.
            let made = unsafe { windows.gpu.device.create_semaphore(&Default::default(), None) };
            self.painted.push(made?);
        }
        Ok(())
    }

    fn has_size(&self, size: [u32; 2]) -> bool {
        [self.extent.width, self.extent.height] == size
    }

    /// # Safety
    /// Nothing that was painted into it is under way.
    unsafe fn destroy(self, windows: &Windows) {
        let device = &windows.gpu.device;
        // Semaphores of presents have no fence: the queue is waited for. The caller has its turn.
        if let Ok(role) = windows.gpu.role(RoleKind::Render) {
            // SAFETY: the queue is this device's. A lost device has nothing left to protect.
            let _ = unsafe { device.queue_wait_idle(role.queue) };
        }
        // SAFETY: nothing uses them any more.
        unsafe {
            self.painted.iter().for_each(|semaphore| device.destroy_semaphore(*semaphore, None));
            windows.swapchains.destroy_swapchain(self.handle, None);
        }
    }
}

/// Black, and in the layout that egui's pass begins with.
fn clear(device: &ash::Device, commands: vk::CommandBuffer, image: vk::Image) {
    let clearing = (vk::PipelineStageFlags2::CLEAR, vk::AccessFlags2::TRANSFER_WRITE);
    let drawing = (
        vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
        vk::AccessFlags2::COLOR_ATTACHMENT_WRITE | vk::AccessFlags2::COLOR_ATTACHMENT_READ,
    );
    let acquired = (vk::PipelineStageFlags2::ALL_COMMANDS, vk::AccessFlags2::NONE);
    let (cleared, drawn) =
        (vk::ImageLayout::TRANSFER_DST_OPTIMAL, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL);
    // SAFETY: the image was acquired, and the commands are being recorded.
    unsafe {
        let undefined = vk::ImageLayout::UNDEFINED;
        change_layout(device, commands, image, [undefined, cleared], acquired, clearing);
        let black = vk::ClearColorValue { float32: [0.0, 0.0, 0.0, 1.0] };
        device.cmd_clear_color_image(commands, image, cleared, &black, &[WHOLE]);
        change_layout(device, commands, image, [cleared, drawn], clearing, drawing);
    }
}
