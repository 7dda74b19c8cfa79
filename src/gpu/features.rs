//! What a device must offer, each item checked by itself.

use ash::vk;

use crate::gpu::instance::Instance;

/// The features we enable, in the chain that Vulkan wants.
pub(crate) struct Features {
    pub core: vk::PhysicalDeviceFeatures,
    pub vulkan12: vk::PhysicalDeviceVulkan12Features,
    pub vulkan13: vk::PhysicalDeviceVulkan13Features,
}

impl Features {
    /// Exactly what this program uses and nothing more; what it can do without, where it is there.
    pub fn used(instance: &Instance, device: vk::PhysicalDevice) -> Features {
        // SAFETY: the handle was enumerated from this living instance.
        let has = unsafe { instance.raw.get_physical_device_features(device) };
        Features {
            core: vk::PhysicalDeviceFeatures {
                shader_float64: vk::TRUE,
                shader_storage_image_extended_formats: has.shader_storage_image_extended_formats,
                ..Default::default()
            },
            vulkan12: vk::PhysicalDeviceVulkan12Features {
                timeline_semaphore: vk::TRUE,
                ..Default::default()
            },
            vulkan13: vk::PhysicalDeviceVulkan13Features {
                synchronization2: vk::TRUE,
                maintenance4: vk::TRUE,
                ..Default::default()
            },
        }
    }

    /// What this device lacks of [`Features::used`], one sentence part each.
    pub fn missing(instance: &Instance, device: vk::PhysicalDevice) -> Vec<String> {
        // SAFETY: the device handle was enumerated from this living instance.
        let properties = unsafe { instance.raw.get_physical_device_properties(device) };
        if properties.api_version < vk::API_VERSION_1_3 {
            return vec![format!(
                "Vulkan 1.3 (it offers {}.{})",
                vk::api_version_major(properties.api_version),
                vk::api_version_minor(properties.api_version)
            )];
        }
        let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut vulkan13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut all = vk::PhysicalDeviceFeatures2::builder()
            .push_next(&mut vulkan12)
            .push_next(&mut vulkan13)
            .build();
        // SAFETY: the chain's structs live until the call returns; the device is at least 1.3.
        unsafe { instance.raw.get_physical_device_features2(device, &mut all) };
        let needed = [
            (all.features.shader_float64, "shaderFloat64 (rays are set up in f64)"),
            (vulkan12.timeline_semaphore, "timelineSemaphore (time points)"),
            (vulkan13.synchronization2, "synchronization2 (barriers)"),
            (vulkan13.maintenance4, "maintenance4 (memory sizes known before objects are made)"),
        ];
        needed
            .into_iter()
            .filter(|(has, _)| *has == vk::FALSE)
            .map(|(_, name)| name.to_owned())
            .collect()
    }
}
