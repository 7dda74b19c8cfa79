//! The device's clock, and what time it is on it: VK_EXT_calibrated_timestamps, where a device has it.

use std::time::{Duration, Instant};

use ash::extensions::ext::CalibratedTimestamps;
use ash::vk;

use crate::gpu::device::Gpu;
use crate::gpu::instance::{Instance, name_of};

/// Readings at most, of which the quickest counts: one may be held up by the scheduler.
const READINGS_MAX: u32 = 4;
/// A reading so quick is not improved upon.
const QUICK: Duration = Duration::from_micros(2);

/// How ticks of a queue's timestamps count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceClock {
    /// Nanoseconds of one tick.
    pub period_ns: f64,
    /// Ticks wrap around after so many bits, 1 to 64.
    pub valid_bits: u32,
}

impl DeviceClock {
    /// Nanoseconds from one tick to another, the shorter way round; negative where `to` is earlier.
    pub fn ns_between(&self, from: u64, to: u64) -> f64 {
        let unused = 64 - self.valid_bits.clamp(1, 64);
        let ticks = (to.wrapping_sub(from) << unused).cast_signed() >> unused;
        ticks as f64 * self.period_ns
    }
}

/// A moment on both clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// On the device's clock.
    pub ticks: u64,
    /// On the host's.
    pub host: Instant,
    /// By how much `host` may be wrong, either way.
    pub error: Duration,
}

impl Gpu {
    /// What time it is on the device's clock; nothing where the device does not tell.
    pub fn calibrate(&self) -> Option<Calibration> {
        let calibrated = self.calibrated.as_ref()?;
        let device_clock = vk::CalibratedTimestampInfoEXT::builder()
            .time_domain(vk::TimeDomainEXT::DEVICE)
            .build();
        let mut best: Option<Calibration> = None;
        for _ in 0..READINGS_MAX {
            let before = Instant::now();
            // SAFETY: the extension is enabled on this living device, which offers this time domain.
            let read = unsafe {
                calibrated.get_calibrated_timestamps(self.device.handle(), &[device_clock])
            };
            let took = before.elapsed();
            let (ticks, _) = read.ok()?;
            // The device's clock was read at some moment of the call.
            let error = took / 2;
            if best.is_none_or(|best| error < best.error) {
                best = Some(Calibration { ticks: *ticks.first()?, host: before + error, error });
            }
            if took <= QUICK {
                break;
            }
        }
        best
    }
}

/// The extension's functions, where the device has it and tells its own time.
pub(crate) fn offered(
    instance: &Instance,
    device: vk::PhysicalDevice,
) -> Option<CalibratedTimestamps> {
    // SAFETY: the handle was enumerated from this living instance.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(device) }.ok()?;
    let wanted = CalibratedTimestamps::name();
    if !extensions.iter().any(|known| name_of(&known.extension_name) == wanted) {
        return None;
    }
    let calibrated = CalibratedTimestamps::new(&instance.entry, &instance.raw);
    // SAFETY: the device has the extension, so the function is there; the handle is of this instance.
    let domains =
        unsafe { calibrated.get_physical_device_calibrateable_time_domains(device) }.ok()?;
    domains.contains(&vk::TimeDomainEXT::DEVICE).then_some(calibrated)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_wrap_around_and_may_lie_behind() {
        let clock = DeviceClock { period_ns: 2.0, valid_bits: 36 };
        let end = (1 << 36) - 1;
        assert_eq!(clock.ns_between(10, 15), 10.0);
        assert_eq!(clock.ns_between(15, 10), -10.0);
        assert_eq!(clock.ns_between(end, 4), 10.0);
        // Another clock of the device may have more bits.
        assert_eq!(clock.ns_between((7 << 36) + 10, 15), 10.0);
        let clock = DeviceClock { period_ns: 1.0, valid_bits: 64 };
        assert_eq!(clock.ns_between(u64::MAX, 1), 2.0);
    }
}
