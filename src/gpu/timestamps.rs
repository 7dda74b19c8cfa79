//! Times of steps on the device, from timestamps written before and after each.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use ash::vk;

use crate::error::Result;
use crate::gpu::calibration::DeviceClock;
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
    /// Just before the device had it.
    pub submitted: Instant,
    /// Whether [`Timestamps::take`] gave it.
    pub taken: bool,
}

/// When the steps of one submit ran, as plain data.
#[derive(Clone, Debug)]
pub struct SubmitTimes {
    /// The submit.
    pub point: TimePoint,
    /// On the host's clock, before the device had it.
    pub submitted: Instant,
    /// On the host's clock, once the host knew that it had ended.
    pub seen: Instant,
    /// How the ticks count.
    pub clock: DeviceClock,
    /// Measured steps, in order.
    pub steps: Vec<StepTicks>,
}

/// When one step ran, in ticks of the device's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepTicks {
    /// The pass, or what is copied.
    pub label: &'static str,
    /// When the queue came to it; steps before it may still have run.
    pub begin: u64,
    /// When it and all before it had ended.
    pub end: u64,
}

impl SubmitTimes {
    /// Milliseconds of each step, as [`Timestamps::step_ms`].
    pub fn step_ms(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let ms = |step: &StepTicks| self.clock.ns_between(step.begin, step.end) * 1e-6;
        self.steps.iter().map(move |step| (step.label, ms(step)))
    }
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
        Ok(self.read(written)?.step_ms().collect())
    }

    /// When the steps of the last submit ran, waiting for its end; each submit is given once.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn take(&self) -> Result<Option<SubmitTimes>> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(written) = last.as_mut().filter(|written| !written.taken) else { return Ok(None) };
        let times = self.read(written)?;
        written.taken = true;
        Ok(Some(times))
    }

    fn read(&self, written: &Written) -> Result<SubmitTimes> {
        self.gpu.wait(written.point)?;
        let seen = Instant::now();
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
        let step = |(label, pair): (&&'static str, &[u64])| StepTicks {
            label,
            begin: pair[0],
            end: pair[1],
        };
        Ok(SubmitTimes {
            point: written.point,
            submitted: written.submitted,
            seen,
            clock: DeviceClock {
                period_ns: f64::from(self.gpu.facts().timestamp_period_ns),
                valid_bits: self.valid_bits,
            },
            steps: written.labels.iter().zip(ticks.chunks_exact(2)).map(step).collect(),
        })
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
