//! Named buffers, images and samplers.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationScheme};

use crate::error::{Error, Result};
use crate::gpu::access::ResourceId;
use crate::gpu::census::ObjectKind;
use crate::gpu::device::Gpu;
use crate::gpu::instance::vulkan_failed;
use crate::gpu::memory::MemoryHome;
use crate::gpu::misuse::misuse;
use crate::gpu::retirement::{Orphan, Uses};
use crate::gpu::roles::{RoleKind, TimePoint};

/// A buffer to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferSpec {
    /// The field's name; also its purpose in the ledger.
    pub name: &'static str,
    /// Size.
    pub bytes: u64,
    /// Where it lies.
    pub home: MemoryHome,
}

/// Texel formats that voxels are kept in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names are Vulkan's own")]
pub enum ImageFormat {
    R8Unorm,
    R16Unorm,
    R32Sfloat,
    Rgba8Unorm,
    Rgba16Unorm,
    Rgba32Sfloat,
}

impl ImageFormat {
    /// Bytes of one texel.
    pub const fn bytes(self) -> u64 {
        match self {
            ImageFormat::R8Unorm => 1,
            ImageFormat::R16Unorm => 2,
            ImageFormat::R32Sfloat | ImageFormat::Rgba8Unorm => 4,
            ImageFormat::Rgba16Unorm => 8,
            ImageFormat::Rgba32Sfloat => 16,
        }
    }

    /// Vulkan's name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            ImageFormat::R8Unorm => "r8_unorm",
            ImageFormat::R16Unorm => "r16_unorm",
            ImageFormat::R32Sfloat => "r32_sfloat",
            ImageFormat::Rgba8Unorm => "rgba8_unorm",
            ImageFormat::Rgba16Unorm => "rgba16_unorm",
            ImageFormat::Rgba32Sfloat => "rgba32_sfloat",
        }
    }

    /// Whether shaders declare it by a capability of its own when they store into it.
    pub(crate) const fn is_extended(self) -> bool {
        matches!(self, ImageFormat::R8Unorm | ImageFormat::R16Unorm | ImageFormat::Rgba16Unorm)
    }

    /// The word for it in a GLSL layout, as in `layout(r8) writeonly uniform image3D`.
    pub const fn glsl(self) -> &'static str {
        match self {
            ImageFormat::R8Unorm => "r8",
            ImageFormat::R16Unorm => "r16",
            ImageFormat::R32Sfloat => "r32f",
            ImageFormat::Rgba8Unorm => "rgba8",
            ImageFormat::Rgba16Unorm => "rgba16",
            ImageFormat::Rgba32Sfloat => "rgba32f",
        }
    }

    pub(crate) const fn vulkan(self) -> vk::Format {
        match self {
            ImageFormat::R8Unorm => vk::Format::R8_UNORM,
            ImageFormat::R16Unorm => vk::Format::R16_UNORM,
            ImageFormat::R32Sfloat => vk::Format::R32_SFLOAT,
            ImageFormat::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            ImageFormat::Rgba16Unorm => vk::Format::R16G16B16A16_UNORM,
            ImageFormat::Rgba32Sfloat => vk::Format::R32G32B32A32_SFLOAT,
        }
    }
}

/// A 3D image to be made: sampled by shaders, filled by copies, or by shaders where `stored`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSpec {
    /// The field's name; also its purpose in the ledger.
    pub name: &'static str,
    /// Texels along x, y, z.
    pub size: [u32; 3],
    /// Texel format.
    pub format: ImageFormat,
    /// Whether shaders store into it; the device must (see [`Gpu::stores`]).
    pub stored: bool,
}

/// What buffers and images have in common: identity, name, and their last use on each role.
pub(crate) struct Life {
    pub id: ResourceId,
    pub name: &'static str,
    /// It belongs to one role at a time, and is handed over.
    pub handed_over: bool,
    uses: [AtomicU64; RoleKind::COUNT],
}

impl Life {
    pub fn new(gpu: &Gpu, name: &'static str) -> Life {
        Life { id: gpu.new_resource(), name, handed_over: false, uses: Default::default() }
    }

    pub fn used(&self, point: TimePoint) {
        self.uses[point.role.index()].fetch_max(point.value, Ordering::AcqRel);
    }

    pub fn uses(&self) -> Uses {
        std::array::from_fn(|index| self.uses[index].load(Ordering::Acquire))
    }
}

/// A buffer with memory of its own.
pub struct Buffer {
    gpu: Arc<Gpu>,
    pub(crate) life: Life,
    pub(crate) handle: vk::Buffer,
    bytes: u64,
    allocation: Mutex<Option<Allocation>>,
}

impl Buffer {
    /// The create info of a spec; the same for making it and for asking how large it will be.
    fn info<'a>(spec: &BufferSpec, families: &'a [u32]) -> vk::BufferCreateInfoBuilder<'a> {
        let info = vk::BufferCreateInfo::builder().size(spec.bytes).usage(
            vk::BufferUsageFlags::STORAGE_BUFFER
                | vk::BufferUsageFlags::UNIFORM_BUFFER
                | vk::BufferUsageFlags::TRANSFER_SRC
                | vk::BufferUsageFlags::TRANSFER_DST,
        );
        if families.len() > 1 {
            info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(families)
        } else {
            info.sharing_mode(vk::SharingMode::EXCLUSIVE)
        }
    }

    /// Bytes of device memory that such a buffer will take.
    pub fn memory_bytes(gpu: &Gpu, spec: &BufferSpec) -> u64 {
        let families = gpu.families();
        let create = Buffer::info(spec, &families).build();
        let info = vk::DeviceBufferMemoryRequirements::builder().create_info(&create);
        let mut requirements = vk::MemoryRequirements2::default();
        // SAFETY: `create` and `families` live until the call returns; maintenance4 is enabled.
        unsafe { gpu.device.get_device_buffer_memory_requirements(&info, &mut requirements) };
        requirements.memory_requirements.size
    }

    /// Makes a buffer.
    ///
    /// # Errors
    /// Exit code 4 when the device has no memory left.
    pub fn new(gpu: &Arc<Gpu>, spec: &BufferSpec) -> Result<Buffer> {
        Buffer::shared(gpu, spec, &gpu.families())
    }

    /// Makes a buffer that belongs to one role at a time: who has it may use it, until it is released to the other
    /// role and acquired there. A role that only writes all of it anew may take it without: what it held is lost then
    /// (Vulkan 1.3 specification, section 7.7.4).
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn handed_over(gpu: &Arc<Gpu>, spec: &BufferSpec) -> Result<Buffer> {
        let mut buffer = Buffer::shared(gpu, spec, &[])?;
        buffer.life.handed_over = true;
        Ok(buffer)
    }

    fn shared(gpu: &Arc<Gpu>, spec: &BufferSpec, families: &[u32]) -> Result<Buffer> {
        if spec.bytes == 0 {
            misuse(format_args!("buffer {} of no bytes", spec.name));
        }
        let info = Buffer::info(spec, families);
        // SAFETY: `info` and `families` live until the call returns.
        let handle = unsafe { gpu.device.create_buffer(&info, None) }
            .map_err(|why| vulkan_failed(&format!("creating buffer {}", spec.name), why))?;
        gpu.census.created(ObjectKind::Buffer);
        // SAFETY: the buffer was just made on this device.
        let requirements = unsafe { gpu.device.get_buffer_memory_requirements(handle) };
        let scheme = AllocationScheme::DedicatedBuffer(handle);
        let allocation = match gpu.allocate(spec.name, requirements, spec.home, scheme) {
            Ok(allocation) => allocation,
            Err(why) => {
                gpu.retire([0; 2], vec![Orphan::Buffer(handle)]);
                return Err(why);
            }
        };
        // SAFETY: memory and buffer are both new, and the memory was allocated for this buffer.
        let bound = unsafe {
            gpu.device.bind_buffer_memory(handle, allocation.memory(), allocation.offset())
        };
        gpu.name_object(handle, spec.name);
        let buffer = Buffer {
            gpu: gpu.clone(),
            life: Life::new(gpu, spec.name),
            handle,
            bytes: spec.bytes,
            allocation: Mutex::new(Some(allocation)),
        };
        bound.map_err(|why| vulkan_failed("binding buffer memory", why))?;
        Ok(buffer)
    }

    /// Whether it belongs to one role at a time, [`Buffer::handed_over`].
    pub fn is_handed_over(&self) -> bool {
        self.life.handed_over
    }

    /// Size in bytes, as asked for.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The field's name.
    pub fn name(&self) -> &'static str {
        self.life.name
    }

    /// Writes from the host at `offset`, once the GPU has ended its last use.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn write(&self, offset: u64, data: &[u8]) -> Result<()> {
        self.write_with(offset, data.len() as u64, |target| target.copy_from_slice(data))
    }

    /// Lets `fill` write `bytes` bytes at `offset` in place, once the GPU has ended its last use.
    /// What it does not write keeps what it held. It must not read: the memory may be uncached.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn write_with(&self, offset: u64, bytes: u64, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        self.gpu.wait_uses(self.life.uses())?;
        self.fill(offset, bytes, fill);
        Ok(())
    }

    /// Writes bytes that no step under way uses, and waits for none: the caller, [`crate::gpu::Ring`],
    /// knows of every step's bytes. A step that did use them would read either value.
    pub(super) fn write_apart(&self, offset: u64, data: &[u8]) {
        self.fill(offset, data.len() as u64, |target| target.copy_from_slice(data));
    }

    fn fill(&self, offset: u64, bytes: u64, fill: impl FnOnce(&mut [u8])) {
        let mut allocation = self.allocation.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(mapped) = allocation.as_mut().and_then(Allocation::mapped_slice_mut) else {
            misuse(format_args!("buffer {} is not visible to the host", self.life.name))
        };
        let range = offset as usize..offset.saturating_add(bytes) as usize;
        let Some(target) = mapped.get_mut(range) else {
            misuse(format_args!("write past the end of buffer {}", self.life.name))
        };
        fill(target);
    }

    /// Reads on the host `data.len()` bytes from `offset`, once the GPU has ended its last use.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn read(&self, offset: u64, data: &mut [u8]) -> Result<()> {
        self.gpu.wait_uses(self.life.uses())?;
        let allocation = self.allocation.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(mapped) = allocation.as_ref().and_then(Allocation::mapped_slice) else {
            misuse(format_args!("buffer {} is not visible to the host", self.life.name))
        };
        let start = offset as usize;
        let Some(source) = mapped.get(start..start + data.len()) else {
            misuse(format_args!("read past the end of buffer {}", self.life.name))
        };
        data.copy_from_slice(source);
        Ok(())
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let mut orphans = vec![Orphan::Buffer(self.handle)];
        let allocation = self.allocation.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(allocation) = allocation {
            orphans.push(Orphan::Memory { purpose: self.life.name.to_owned(), allocation });
        }
        self.gpu.forget_resource(self.life.id);
        self.gpu.retire(self.life.uses(), orphans);
    }
}

/// A 3D image with memory of its own and one view of all of it.
pub struct Image {
    gpu: Arc<Gpu>,
    pub(crate) life: Life,
    pub(crate) handle: vk::Image,
    pub(crate) view: vk::ImageView,
    spec: ImageSpec,
    /// Set by the first recording that uses it, which also sets its layout.
    pub(crate) touched: AtomicBool,
    allocation: Option<Allocation>,
}

impl Image {
    fn info<'a>(spec: &ImageSpec, families: &'a [u32]) -> vk::ImageCreateInfoBuilder<'a> {
        let [width, height, depth] = spec.size;
        let stored = match spec.stored {
            true => vk::ImageUsageFlags::STORAGE,
            false => vk::ImageUsageFlags::empty(),
        };
        let info = vk::ImageCreateInfo::builder()
            .image_type(vk::ImageType::TYPE_3D)
            .format(spec.format.vulkan())
            .extent(vk::Extent3D { width, height, depth })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST | stored);
        if families.len() > 1 {
            info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(families)
        } else {
            info.sharing_mode(vk::SharingMode::EXCLUSIVE)
        }
    }

    /// Bytes of device memory that such an image will take.
    pub fn memory_bytes(gpu: &Gpu, spec: &ImageSpec) -> u64 {
        let families = gpu.families();
        let create = Image::info(spec, &families).build();
        let info = vk::DeviceImageMemoryRequirements::builder().create_info(&create);
        let mut requirements = vk::MemoryRequirements2::default();
        // SAFETY: `create` and `families` live until the call returns; maintenance4 is enabled.
        unsafe { gpu.device.get_device_image_memory_requirements(&info, &mut requirements) };
        requirements.memory_requirements.size
    }

    /// Makes an image; its contents are undefined until copied or stored into.
    ///
    /// # Errors
    /// Exit code 4 when an edge is beyond the device's limit, its memory is full, or shaders are to
    /// store into a format that it does not let them.
    pub fn new(gpu: &Arc<Gpu>, spec: &ImageSpec) -> Result<Image> {
        let edge_max = gpu.facts().image_3d_edge_max;
        if spec.size.iter().any(|edge| !(1..=edge_max).contains(edge)) {
            return Err(Error::machine(format!(
                "{} needs an image of {:?} texels, but this device's 3D images have at most {edge_max} along an axis",
                spec.name, spec.size
            )));
        }
        if spec.stored && !gpu.stores(spec.format) {
            return Err(Error::machine(format!(
                "{} needs shaders that store into images of format {}, which this device does not: choose another with --device",
                spec.name,
                spec.format.name()
            )));
        }
        let families = gpu.families();
        let info = Image::info(spec, &families);
        // SAFETY: `info` and `families` live until the call returns.
        let handle = unsafe { gpu.device.create_image(&info, None) }
            .map_err(|why| vulkan_failed(&format!("creating image {}", spec.name), why))?;
        gpu.census.created(ObjectKind::Image);
        let mut image = Image {
            gpu: gpu.clone(),
            life: Life::new(gpu, spec.name),
            handle,
            view: vk::ImageView::null(),
            spec: *spec,
            touched: AtomicBool::new(false),
            allocation: None,
        };
        // SAFETY: the image was just made on this device.
        let requirements = unsafe { gpu.device.get_image_memory_requirements(handle) };
        let scheme = AllocationScheme::DedicatedImage(handle);
        let allocation = gpu.allocate(spec.name, requirements, MemoryHome::Device, scheme)?;
        let (memory, offset) = {
            // SAFETY: the allocation stays with the image that it is bound to.
            (unsafe { allocation.memory() }, allocation.offset())
        };
        image.allocation = Some(allocation);
        // SAFETY: memory and image are both new, and the memory was allocated for this image.
        unsafe { gpu.device.bind_image_memory(handle, memory, offset) }
            .map_err(|why| vulkan_failed("binding image memory", why))?;
        let info = vk::ImageViewCreateInfo::builder()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_3D)
            .format(spec.format.vulkan())
            .subresource_range(WHOLE_IMAGE);
        // SAFETY: the image is bound and lives as long as its view.
        image.view = unsafe { gpu.device.create_image_view(&info, None) }
            .map_err(|why| vulkan_failed("creating an image view", why))?;
        gpu.census.created(ObjectKind::ImageView);
        gpu.name_object(handle, spec.name);
        Ok(image)
    }

    /// Size and format.
    pub fn spec(&self) -> &ImageSpec {
        &self.spec
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        let mut orphans = vec![Orphan::ImageView(self.view), Orphan::Image(self.handle)];
        if let Some(allocation) = self.allocation.take() {
            orphans.push(Orphan::Memory { purpose: self.life.name.to_owned(), allocation });
        }
        self.gpu.forget_resource(self.life.id);
        self.gpu.retire(self.life.uses(), orphans);
    }
}

/// The one layer and level that our images have.
pub(crate) const WHOLE_IMAGE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

/// How a sampler finds values between texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplerFilter {
    /// No filtering; for shaders that fetch texels themselves.
    Nearest,
    /// The device's own trilinear filter.
    Linear,
}

/// A sampler; coordinates beyond the edge take the edge's texel.
pub struct Sampler {
    gpu: Arc<Gpu>,
    pub(crate) life: Life,
    pub(crate) handle: vk::Sampler,
}

impl Sampler {
    /// Makes a sampler.
    ///
    /// # Errors
    /// Exit code 4 when the device refuses.
    pub fn new(gpu: &Arc<Gpu>, filter: SamplerFilter) -> Result<Sampler> {
        let filter = match filter {
            SamplerFilter::Nearest => vk::Filter::NEAREST,
            SamplerFilter::Linear => vk::Filter::LINEAR,
        };
        let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
        let info = vk::SamplerCreateInfo::builder()
            .mag_filter(filter)
            .min_filter(filter)
            .address_mode_u(edge)
            .address_mode_v(edge)
            .address_mode_w(edge);
        // SAFETY: `info` asks for nothing beyond core Vulkan.
        let handle = unsafe { gpu.device.create_sampler(&info, None) }
            .map_err(|why| vulkan_failed("creating a sampler", why))?;
        gpu.census.created(ObjectKind::Sampler);
        Ok(Sampler { gpu: gpu.clone(), life: Life::new(gpu, "sampler"), handle })
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        self.gpu.retire(self.life.uses(), vec![Orphan::Sampler(self.handle)]);
    }
}
