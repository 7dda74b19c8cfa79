//! What a device is and can do, as plain data.

use ash::vk;

use crate::gpu::features::Features;
use crate::gpu::instance::{Instance, name_of};

/// One queue family, as far as roles care.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueFacts {
    /// Index of the family.
    pub family: u32,
    /// Queues in it.
    pub count: u32,
    /// Whether it runs compute shaders.
    pub compute: bool,
    /// Whether it draws.
    pub graphics: bool,
    /// Whether it copies (every compute family does).
    pub transfer: bool,
    /// Valid bits of its timestamps; 0: it has none.
    pub timestamp_bits: u32,
    /// Texels per axis that an image copy must be a multiple of; zeros: whole images only.
    pub copy_granularity: [u32; 3],
}

/// What a device is and can do, as plain data.
#[derive(Clone, Debug)]
pub struct DeviceFacts {
    /// Index in the order of the loader.
    pub index: usize,
    /// The device's name.
    pub name: String,
    /// Driver name and version, in the driver's words.
    pub driver: String,
    /// "discrete", "integrated", "virtual", "cpu" or "other".
    pub kind: &'static str,
    /// Vulkan version: major, minor, patch.
    pub version: [u32; 3],
    /// What it lacks of what we need; empty: usable.
    pub missing: Vec<String>,
    /// Its queue families.
    pub queues: Vec<QueueFacts>,
    /// Edge of the largest 3D image, in texels.
    pub image_3d_edge_max: u32,
    /// Bytes of the largest uniform buffer binding.
    pub uniform_bytes_max: u64,
    /// Bytes of the largest storage buffer binding.
    pub storage_bytes_max: u64,
    /// Bytes of its largest device-local heap.
    pub heap_bytes: u64,
    /// Nanoseconds of one timestamp tick.
    pub timestamp_period_ns: f32,
}

pub(super) fn facts_of(
    instance: &Instance,
    index: usize,
    device: vk::PhysicalDevice,
) -> DeviceFacts {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::builder().push_next(&mut driver).build();
    // SAFETY: the handle was enumerated from this living instance; the chain outlives the call.
    let (queues, memory) = unsafe {
        instance.raw.get_physical_device_properties2(device, &mut properties);
        (
            instance.raw.get_physical_device_queue_family_properties(device),
            instance.raw.get_physical_device_memory_properties(device),
        )
    };
    let core = properties.properties;
    let text = |chars: &[std::ffi::c_char]| name_of(chars).to_string_lossy().into_owned();
    DeviceFacts {
        index,
        name: text(&core.device_name),
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)),
        kind: match core.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
            vk::PhysicalDeviceType::CPU => "cpu",
            _ => "other",
        },
        version: [
            vk::api_version_major(core.api_version),
            vk::api_version_minor(core.api_version),
            vk::api_version_patch(core.api_version),
        ],
        missing: Features::missing(instance, device),
        queues: queues
            .iter()
            .enumerate()
            .map(|(family, queue)| QueueFacts {
                family: family as u32,
                count: queue.queue_count,
                compute: queue.queue_flags.contains(vk::QueueFlags::COMPUTE),
                graphics: queue.queue_flags.contains(vk::QueueFlags::GRAPHICS),
                transfer: queue.queue_flags.intersects(
                    vk::QueueFlags::TRANSFER | vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS,
                ),
                timestamp_bits: queue.timestamp_valid_bits,
                copy_granularity: {
                    let grain = queue.min_image_transfer_granularity;
                    [grain.width, grain.height, grain.depth]
                },
            })
            .collect(),
        image_3d_edge_max: core.limits.max_image_dimension3_d,
        uniform_bytes_max: u64::from(core.limits.max_uniform_buffer_range),
        storage_bytes_max: u64::from(core.limits.max_storage_buffer_range),
        heap_bytes: memory.memory_heaps[..memory.memory_heap_count as usize]
            .iter()
            .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|heap| heap.size)
            .max()
            .unwrap_or(0),
        timestamp_period_ns: core.limits.timestamp_period,
    }
}
