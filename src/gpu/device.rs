//! The device: chosen, checked, opened; its roles, its memory, and the end of everything on it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ash::extensions::ext::CalibratedTimestamps;
use ash::extensions::khr::Swapchain;
use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use crate::error::{Error, Result};
use crate::gpu::access::ResourceId;
use crate::gpu::calibration;
use crate::gpu::census::{Census, ObjectKind};
use crate::gpu::device_facts::{DeviceFacts, QueueFacts, facts_of};
use crate::gpu::features::Features;
use crate::gpu::instance::{Instance, Message, c_string, vulkan_failed};
use crate::gpu::memory::{Ledger, MemoryHome};
use crate::gpu::misuse::misuse;
use crate::gpu::resources::ImageFormat;
#[cfg(doc)]
use crate::gpu::resources::ImageSpec;
use crate::gpu::retirement::{Orphan, Retired, Uses};
use crate::gpu::roles::{Role, RoleKind, TimePoint};
use crate::gpu::topology::QueueTopology;
use crate::gpu::turns::Turns;

/// Which device is wanted.
#[derive(Clone, Debug, Default)]
pub struct DeviceRequest {
    /// Its index in `ashfall devices`, or part of its name; nothing: the most capable.
    pub choice: Option<String>,
    /// Whether it is to show pictures in windows.
    pub presents: bool,
    /// Which queues the roles get.
    pub queues: QueueTopology,
    /// Three staging halves in place of two: the host fills one while a copy runs and another waits.
    pub three_halves: bool,
}

/// An open device. Cheap to clone; everything made of it keeps it alive.
pub struct Gpu {
    pub(crate) instance: Arc<Instance>,
    pub(crate) device: ash::Device,
    pub(crate) physical: vk::PhysicalDevice,
    facts: DeviceFacts,
    /// What was created on it.
    pub census: Census,
    /// Bytes of device memory by purpose.
    pub ledger: Ledger,
    /// Tells the time on the device's clock, where it does.
    pub(crate) calibrated: Option<CalibratedTimestamps>,
    /// Whether shaders may store into formats beyond Vulkan's first list.
    stores_extended: bool,
    queues: [(u32, u32); RoleKind::COUNT],
    topology: QueueTopology,
    staging_halves: u64,
    roles: [OnceLock<Role>; RoleKind::COUNT],
    pub(crate) turns: Arc<Turns>,
    allocator: Mutex<Option<gpu_allocator::vulkan::Allocator>>,
    retired: Mutex<Vec<Retired>>,
    next_resource: AtomicU64,
}

impl Gpu {
    /// Every device of this machine, usable or not.
    ///
    /// # Errors
    /// Exit code 4 when the loader cannot list devices.
    pub fn list(instance: &Instance) -> Result<Vec<DeviceFacts>> {
        Ok(enumerate(instance)?.into_iter().map(|(_, facts)| facts).collect())
    }

    /// Opens the device asked for.
    ///
    /// # Errors
    /// Exit code 4 when there is none, or it lacks a feature, which is named.
    pub fn open(instance: &Arc<Instance>, request: &DeviceRequest) -> Result<Arc<Gpu>> {
        let devices = enumerate(instance)?;
        let (physical, facts) = choose(devices, request)?;
        if !facts.missing.is_empty() {
            return Err(Error::machine(format!(
                "device \"{}\" lacks {}: choose another with --device (see `ashfall devices`)",
                facts.name,
                facts.missing.join(", ")
            )));
        }
        let queues =
            request.queues.assign(&facts.queues).ok_or_else(|| not_offered(request, &facts))?;
        let features = Features::used(instance, physical);
        let stores_extended = features.core.shader_storage_image_extended_formats == vk::TRUE;
        let calibrated = calibration::offered(instance, physical);
        let mut extensions = Vec::new();
        if calibrated.is_some() {
            extensions.push(CalibratedTimestamps::name().as_ptr());
        }
        if request.presents {
            extensions.push(Swapchain::name().as_ptr());
        }
        let device = open_device(instance, physical, &queues, features, &extensions)?;
        let allocator =
            gpu_allocator::vulkan::Allocator::new(&gpu_allocator::vulkan::AllocatorCreateDesc {
                instance: instance.raw.clone(),
                device: device.clone(),
                physical_device: physical,
                debug_settings: Default::default(),
                buffer_device_address: false,
                allocation_sizes: Default::default(),
            });
        let allocator = allocator.map_err(|why| {
            // SAFETY: nothing was made of the device yet.
            unsafe { device.destroy_device(None) };
            Error::machine(format!("the device's memory cannot be managed: {why}"))
        })?;
        Ok(Arc::new(Gpu {
            instance: instance.clone(),
            device,
            physical,
            facts,
            calibrated,
            stores_extended,
            census: Census::default(),
            ledger: Ledger::default(),
            queues,
            topology: request.queues,
            staging_halves: if request.three_halves { 3 } else { 2 },
            roles: [const { OnceLock::new() }; RoleKind::COUNT],
            turns: Arc::default(),
            allocator: Mutex::new(Some(allocator)),
            retired: Mutex::default(),
            next_resource: AtomicU64::new(1),
        }))
    }

    /// What this device is.
    pub fn facts(&self) -> &DeviceFacts {
        &self.facts
    }

    /// Whether images of this format can be copied into and sampled; with `linear`, filtered too.
    pub fn samples(&self, format: ImageFormat, linear: bool) -> bool {
        let mut needed =
            vk::FormatFeatureFlags::SAMPLED_IMAGE | vk::FormatFeatureFlags::TRANSFER_DST;
        if linear {
            needed |= vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR;
        }
        self.format_features(format).contains(needed)
    }

    /// Whether compute shaders can store into images of this format (see [`ImageSpec::stored`]).
    pub fn stores(&self, format: ImageFormat) -> bool {
        (self.stores_extended || !format.is_extended())
            && self.format_features(format).contains(vk::FormatFeatureFlags::STORAGE_IMAGE)
    }

    fn format_features(&self, format: ImageFormat) -> vk::FormatFeatureFlags {
        // SAFETY: the handle was enumerated from this living instance.
        let properties = unsafe {
            self.instance.raw.get_physical_device_format_properties(self.physical, format.vulkan())
        };
        properties.optimal_tiling_features
    }

    /// What validation has said so far.
    pub fn messages(&self) -> Vec<Message> {
        self.instance.messages()
    }

    /// Queue family and index of a role.
    pub fn queue_of(&self, role: RoleKind) -> (u32, u32) {
        self.queues[role.index()]
    }

    /// Whether the roles share one queue.
    pub fn roles_share_queue(&self) -> bool {
        self.queues[0] == self.queues[1]
    }

    /// As it was asked for.
    pub fn topology(&self) -> QueueTopology {
        self.topology
    }

    /// Upload buffers that staging goes around by.
    pub fn staging_halves(&self) -> u64 {
        self.staging_halves
    }

    /// Submits of a role whose commands may wait or run at once. Of the transfer role as many as there are staging
    /// halves; of the render role a round, and the placing of the batches that the host can fill beside it: each half
    /// takes one, the first is copied at once, so that its half takes another; the next needs the second copied, which
    /// waits for the first to be placed, which waits for the round.
    pub fn in_flight_max(&self, role: RoleKind) -> usize {
        match role {
            RoleKind::Render => self.staging_halves as usize + 2,
            RoleKind::Transfer => self.staging_halves as usize,
        }
    }

    /// What a role's queue can do.
    pub(crate) fn queue_facts(&self, role: RoleKind) -> Option<&QueueFacts> {
        let family = self.queues[role.index()].0;
        self.facts.queues.iter().find(|queue| queue.family == family)
    }

    /// Families that touch resources used by both roles.
    pub(crate) fn families(&self) -> Vec<u32> {
        let mut families = vec![self.queues[0].0, self.queues[1].0];
        families.dedup();
        families
    }

    /// Whether a role's queue has timestamps.
    pub fn has_timestamps(&self, role: RoleKind) -> bool {
        let family = self.queues[role.index()].0;
        self.facts.queues.iter().any(|q| q.family == family && q.timestamp_bits > 0)
    }

    pub(crate) fn role(&self, kind: RoleKind) -> Result<&Role> {
        let slot = &self.roles[kind.index()];
        if let Some(role) = slot.get() {
            return Ok(role);
        }
        let (family, index) = self.queues[kind.index()];
        // SAFETY: the device was created with this queue.
        let queue = unsafe { self.device.get_device_queue(family, index) };
        let timestamps = self.has_timestamps(kind);
        let role = Role::new(&self.device, &self.census, kind, family, queue, timestamps)?;
        if let Err(second) = slot.set(role) {
            // SAFETY: another thread was first; this one was used for nothing.
            unsafe { second.destroy(&self.device) };
        }
        slot.get().map_or_else(|| misuse("a role vanished"), Ok)
    }

    /// Submits to all roles so far.
    pub fn submits(&self) -> u64 {
        let of_role = |role: &Role| role.submitted.load(Ordering::Acquire);
        self.roles.iter().filter_map(OnceLock::get).map(of_role).sum()
    }

    /// Whether a time point is reached.
    pub fn has_reached(&self, point: TimePoint) -> bool {
        self.role(point.role).is_ok_and(|role| role.reached(&self.device) >= point.value)
    }

    /// Blocks until a time point is reached.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn wait(&self, point: TimePoint) -> Result<()> {
        if point.value == 0 {
            return Ok(());
        }
        self.role(point.role)?.wait(&self.device, point.value)
    }

    fn reached(&self) -> Uses {
        std::array::from_fn(|index| {
            self.roles[index].get().map_or(0, |role| role.reached(&self.device))
        })
    }

    /// Blocks until all of `uses` are reached.
    pub(crate) fn wait_uses(&self, uses: Uses) -> Result<()> {
        self.wait(TimePoint { role: RoleKind::Render, value: uses[RoleKind::Render.index()] })?;
        self.wait(TimePoint { role: RoleKind::Transfer, value: uses[RoleKind::Transfer.index()] })
    }

    pub(crate) fn new_resource(&self) -> ResourceId {
        self.next_resource.fetch_add(1, Ordering::Relaxed)
    }

    pub(crate) fn forget_resource(&self, id: ResourceId) {
        for role in self.roles.iter().filter_map(OnceLock::get) {
            role.tracker.lock().unwrap_or_else(PoisonError::into_inner).forget(id);
        }
    }

    /// Memory of exactly `requirements.size` bytes for one buffer or image.
    pub(crate) fn allocate(
        &self,
        purpose: &str,
        requirements: vk::MemoryRequirements,
        home: MemoryHome,
        scheme: AllocationScheme,
    ) -> Result<Allocation> {
        let linear = matches!(scheme, AllocationScheme::DedicatedBuffer(_));
        let description = AllocationCreateDesc {
            name: purpose,
            requirements,
            location: home.location(),
            linear,
            allocation_scheme: scheme,
        };
        let mut allocator = self.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(allocator) = allocator.as_mut() else { misuse("allocation after the end") };
        let allocation = allocator.allocate(&description).map_err(|why| {
            Error::machine(format!(
                "the device has no {} bytes left for {purpose} ({why}): lower --atlas-mib or --size",
                requirements.size
            ))
        })?;
        self.census.created(ObjectKind::DeviceMemory);
        self.ledger.add(purpose, allocation.size());
        Ok(allocation)
    }

    /// Gives up orphans once `uses` are reached; now, where they are.
    pub(crate) fn retire(&self, uses: Uses, orphans: Vec<Orphan>) {
        let mut retired = self.retired.lock().unwrap_or_else(PoisonError::into_inner);
        retired.push(Retired { uses, orphans });
        drop(retired);
        self.collect_retired();
    }

    /// Destroys whatever is retired and no longer used.
    pub(crate) fn collect_retired(&self) {
        let reached = self.reached();
        let mut retired = self.retired.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, waiting): (Vec<_>, Vec<_>) = std::mem::take(&mut *retired)
            .into_iter()
            .partition(|entry| entry.uses.iter().zip(reached).all(|(use_, now)| *use_ <= now));
        *retired = waiting;
        drop(retired);
        for orphan in done.into_iter().flat_map(|entry| entry.orphans) {
            self.destroy(orphan);
        }
    }

    fn destroy(&self, orphan: Orphan) {
        let device = &self.device;
        // SAFETY: orphans have no owner left and their last time points were reached.
        unsafe {
            match orphan {
                Orphan::Buffer(handle) => device.destroy_buffer(handle, None),
                Orphan::Image(handle) => device.destroy_image(handle, None),
                Orphan::ImageView(handle) => device.destroy_image_view(handle, None),
                Orphan::Sampler(handle) => device.destroy_sampler(handle, None),
                Orphan::Pipeline(handle) => device.destroy_pipeline(handle, None),
                Orphan::PipelineLayout(handle) => device.destroy_pipeline_layout(handle, None),
                Orphan::DescriptorSetLayout(handle) => {
                    device.destroy_descriptor_set_layout(handle, None);
                }
                Orphan::DescriptorPool(handle) => device.destroy_descriptor_pool(handle, None),
                Orphan::QueryPool(handle) => device.destroy_query_pool(handle, None),
                Orphan::Memory { purpose, allocation } => {
                    self.ledger.remove(&purpose, allocation.size());
                    let mut allocator =
                        self.allocator.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some(allocator) = allocator.as_mut() {
                        // Freeing a block that we own fails only if the allocator's books are wrong.
                        let _ = allocator.free(allocation);
                    }
                }
            }
        }
    }

    /// Names an object for debuggers and validation messages.
    pub(crate) fn name_object<T: vk::Handle>(&self, handle: T, name: &str) {
        if let Some(debug_utils) = &self.instance.debug_utils {
            let name = c_string(name);
            let info = vk::DebugUtilsObjectNameInfoEXT::builder()
                .object_type(T::TYPE)
                .object_handle(handle.as_raw())
                .object_name(&name);
            // SAFETY: the handle belongs to this living device. A failure costs only the name.
            let _ = unsafe { debug_utils.set_debug_utils_object_name(self.device.handle(), &info) };
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        for role in self.roles.iter().filter_map(OnceLock::get) {
            // A lost device cannot be waited for; there is nothing left to protect then.
            let _ = role.wait(&self.device, role.submitted.load(Ordering::Acquire));
        }
        let retired = self.retired.get_mut().unwrap_or_else(PoisonError::into_inner);
        for orphan in std::mem::take(retired).into_iter().flat_map(|entry| entry.orphans) {
            self.destroy(orphan);
        }
        // The allocator frees its blocks through the device, so it goes first.
        self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        // SAFETY: all submits have ended and every object made of the device is gone.
        unsafe {
            for role in self.roles.iter().filter_map(OnceLock::get) {
                role.destroy(&self.device);
            }
            self.device.destroy_device(None);
        }
    }
}

fn not_offered(request: &DeviceRequest, facts: &DeviceFacts) -> Error {
    let offered: Vec<_> =
        QueueTopology::offered(&facts.queues).iter().map(|of| of.name()).collect();
    let lacks = request.queues.lacks(&facts.queues).unwrap_or("nobody knows why");
    Error::machine(match offered.is_empty() {
        true => format!("device \"{}\" cannot be used: {lacks}", facts.name),
        false => format!(
            "device \"{}\" does not offer --queues {}: {lacks}; it offers {}",
            facts.name,
            request.queues.name(),
            offered.join(", ")
        ),
    })
}

fn enumerate(instance: &Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceFacts)>> {
    // SAFETY: the instance is alive.
    let devices = unsafe { instance.raw.enumerate_physical_devices() }
        .map_err(|why| vulkan_failed("listing Vulkan devices", why))?;
    Ok(devices
        .into_iter()
        .enumerate()
        .map(|(index, device)| (device, facts_of(instance, index, device)))
        .collect())
}

fn choose(
    devices: Vec<(vk::PhysicalDevice, DeviceFacts)>,
    request: &DeviceRequest,
) -> Result<(vk::PhysicalDevice, DeviceFacts)> {
    if devices.is_empty() {
        return Err(Error::machine(
            "no Vulkan device on this machine: install a driver, or mesa-vulkan-drivers for one that needs no GPU",
        ));
    }
    let Some(wanted) = &request.choice else {
        let rank = |facts: &DeviceFacts| {
            let kinds = ["discrete", "integrated", "virtual", "other", "cpu"];
            let kind = kinds.iter().position(|kind| *kind == facts.kind);
            (!facts.missing.is_empty(), kind, facts.index)
        };
        let best = devices.into_iter().min_by_key(|(_, facts)| rank(facts));
        return best.ok_or_else(|| Error::machine("no Vulkan device on this machine"));
    };
    let names: Vec<String> =
        devices.iter().map(|(_, facts)| format!("{}: {}", facts.index, facts.name)).collect();
    devices
        .into_iter()
        .find(|(_, facts)| {
            wanted.parse() == Ok(facts.index)
                || facts.name.to_lowercase().contains(&wanted.to_lowercase())
        })
        .ok_or_else(|| {
            Error::machine(format!(
                "no device matches \"{wanted}\": choose among {}",
                names.join("; ")
            ))
        })
}

fn open_device(
    instance: &Instance,
    physical: vk::PhysicalDevice,
    queues: &[(u32, u32); RoleKind::COUNT],
    mut features: Features,
    extensions: &[*const std::ffi::c_char],
) -> Result<ash::Device> {
    let priorities = [1.0, 1.0];
    let mut infos = Vec::new();
    for (family, _) in queues {
        if infos.iter().any(|info: &vk::DeviceQueueCreateInfo| info.queue_family_index == *family) {
            continue;
        }
        let count = queues
            .iter()
            .filter(|(f, _)| f == family)
            .map(|(_, index)| index + 1)
            .max()
            .unwrap_or(1);
        infos.push(
            vk::DeviceQueueCreateInfo::builder()
                .queue_family_index(*family)
                .queue_priorities(&priorities[..count as usize])
                .build(),
        );
    }
    let info = vk::DeviceCreateInfo::builder()
        .queue_create_infos(&infos)
        .enabled_extension_names(extensions)
        .enabled_features(&features.core)
        .push_next(&mut features.vulkan12)
        .push_next(&mut features.vulkan13);
    // SAFETY: every pointer in `info` lives until the call returns; features and extensions were checked.
    unsafe { instance.raw.create_device(physical, &info, None) }
        .map_err(|why| vulkan_failed("opening the Vulkan device", why))
}
