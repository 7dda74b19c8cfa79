//! Times of steps on the device, from timestamps written before and after each.

use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use crate::error::Result;
use crate::gpu::census::ObjectKind;
use crate::gpu::device::Gpu;
use crate::gpu::instance::vulkan_failed;
use crate::gpu::retirement::Orphan;
use crate::gpu::roles::{RoleKind, TimePoint};

/// Room for the timestamps of one submit at a time.
pub struct Timestamps {
    gpu: Arc<Gpu>,
    pub(crate) pool: vk::QueryPool,
    pub(crate) steps_max: u32,
    valid_bits: u32,
    pub(crate) last: Mutex<Option<Written>>,
}

/// The submit whose timestamps the pool holds.
pub(crate) struct Written {
    pub point: TimePoint,
    pub labels: Vec<&'static str>,
}

impl Timestamps {
    /// Room for `steps_max` steps of a role, or nothing where its queue has no timestamps.
    ///
    /// # Errors
    /// Exit code 4 when the device refuses.
    pub fn new(gpu: &Arc<Gpu>, role: RoleKind, steps_max: u32) -> Result<Option<Timestamps>> {
        let family = gpu.queue_of(role).0;
        let queue = gpu.facts().queues.iter().find(|queue| queue.family == family);
        let valid_bits = queue.map_or(0, |queue| queue.timestamp_bits);
        if valid_bits == 0 {
            return Ok(None);
        }
        let info = vk::QueryPoolCreateInfo::builder()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(2 * steps_max);
        // SAFETY: timestamps are core Vulkan and this queue has valid bits.
        let pool = unsafe { gpu.device.create_query_pool(&info, None) }
            .map_err(|why| vulkan_failed("creating a query pool", why))?;
        gpu.census.created(ObjectKind::QueryPool);
        Ok(Some(Timestamps {
            gpu: gpu.clone(),
            pool,
            steps_max,
            valid_bits,
            last: Mutex::default(),
        }))
    }

    /// Milliseconds of each measured step of the last submit, waiting for its end.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn step_ms(&self) -> Result<Vec<(&'static str, f64)>> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(written) = last.as_ref() else { return Ok(Vec::new()) };
        self.gpu.wait(written.point)?;
        let mut ticks = vec![0u64; 2 * written.labels.len()];
        if !ticks.is_empty() {
            let count = ticks.len() as u32;
            let flags = vk::QueryResultFlags::TYPE_64;
            // SAFETY: the submit that wrote these queries has ended.
            unsafe {
                self.gpu.device.get_query_pool_results(self.pool, 0, count, &mut ticks, flags)
            }
            .map_err(|why| vulkan_failed("reading timestamps", why))?;
        }
        let mask = u64::MAX >> (64 - self.valid_bits.min(64));
        let period_ms = f64::from(self.gpu.facts().timestamp_period_ns) * 1e-6;
        let ms = |pair: &[u64]| (pair[1].wrapping_sub(pair[0]) & mask) as f64 * period_ms;
        Ok(written.labels.iter().copied().zip(ticks.chunks_exact(2).map(ms)).collect())
    }
}

impl Drop for Timestamps {
    fn drop(&mut self) {
        let last = self.last.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut uses = [0; RoleKind::COUNT];
        if let Some(written) = last {
            uses[written.point.role.index()] = written.point.value;
        }
        self.gpu.retire(uses, vec![Orphan::QueryPool(self.pool)]);
    }
}
