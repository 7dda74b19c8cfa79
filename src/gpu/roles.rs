//! Roles: a queue's job, with one timeline semaphore each; and time points on them.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;

use crate::error::Result;
use crate::gpu::access::Tracker;
use crate::gpu::census::{Census, ObjectKind};
use crate::gpu::instance::vulkan_failed;
use crate::gpu::misuse::misuse;

/// What a queue is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RoleKind {
    /// Marches rays and manages the cache.
    Render,
    /// Copies bricks.
    Transfer,
}

impl RoleKind {
    pub(crate) const COUNT: usize = 2;

    /// The word used in plans, traces and labels.
    pub const fn name(self) -> &'static str {
        match self {
            RoleKind::Render => "render",
            RoleKind::Transfer => "transfer",
        }
    }

    pub(crate) const fn index(self) -> usize {
        self as usize
    }
}

/// A moment on a role's timeline: reached when the submit that signals it has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TimePoint {
    /// Whose timeline.
    pub role: RoleKind,
    /// Counts submits of that role from 1; 0 was always reached.
    pub value: u64,
}

/// A role's queue and what was submitted to it. Made at the first recording for it.
pub(crate) struct Role {
    pub kind: RoleKind,
    pub queue: vk::Queue,
    pub timestamps: bool,
    pub semaphore: vk::Semaphore,
    pub pool: vk::CommandPool,
    /// Value of the last submit.
    pub submitted: AtomicU64,
    pub tracker: Mutex<Tracker>,
    /// Oldest first, each with the value of its last submit.
    pub command_buffers: Mutex<Vec<(vk::CommandBuffer, u64)>>,
}

impl Role {
    pub fn new(
        device: &ash::Device,
        census: &Census,
        kind: RoleKind,
        family: u32,
        queue: vk::Queue,
        timestamps: bool,
    ) -> Result<Role> {
        let mut timeline =
            vk::SemaphoreTypeCreateInfo::builder().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::builder().push_next(&mut timeline);
        // SAFETY: the device is alive and timeline semaphores are enabled on it.
        let semaphore = unsafe { device.create_semaphore(&info, None) }
            .map_err(|why| vulkan_failed("creating a timeline semaphore", why))?;
        census.created(ObjectKind::Semaphore);
        let info = vk::CommandPoolCreateInfo::builder()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(family);
        // SAFETY: the family was enumerated from this device.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(|why| {
            // SAFETY: the semaphore was just made and is used nowhere.
            unsafe { device.destroy_semaphore(semaphore, None) };
            vulkan_failed("creating a command pool", why)
        })?;
        census.created(ObjectKind::CommandPool);
        Ok(Role {
            kind,
            queue,
            timestamps,
            semaphore,
            pool,
            submitted: AtomicU64::new(0),
            tracker: Mutex::default(),
            command_buffers: Mutex::default(),
        })
    }

    /// The value that the timeline has reached.
    pub fn reached(&self, device: &ash::Device) -> u64 {
        // SAFETY: the semaphore belongs to this living device.
        unsafe { device.get_semaphore_counter_value(self.semaphore) }.unwrap_or(0)
    }

    /// Blocks until the timeline reaches `value`.
    pub fn wait(&self, device: &ash::Device, value: u64) -> Result<()> {
        if value > self.submitted.load(Ordering::Acquire) {
            misuse(format_args!(
                "waiting for {} {value}, which nobody submitted",
                self.kind.name()
            ));
        }
        let (semaphores, values) = ([self.semaphore], [value]);
        let info = vk::SemaphoreWaitInfo::builder().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore belongs to this living device.
        unsafe { device.wait_semaphores(&info, u64::MAX) }
            .map_err(|why| vulkan_failed("waiting for the device", why))
    }

    /// # Safety
    /// Nothing submitted to this role may still be running.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: the caller waited for every submit; the pool frees its command buffers.
        unsafe {
            device.destroy_command_pool(self.pool, None);
            device.destroy_semaphore(self.semaphore, None);
        }
    }
}
