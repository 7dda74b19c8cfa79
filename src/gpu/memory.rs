//! Device memory: one allocation per buffer or image, and a ledger of bytes by purpose.

use std::collections::BTreeMap;
use std::sync::Mutex;

use gpu_allocator::MemoryLocation;

/// Where memory should lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryHome {
    /// Fast for the device.
    Device,
    /// Written by the host, read by the device.
    Upload,
    /// Written by the device, read by the host, cached for it.
    Readback,
}

impl MemoryHome {
    pub(crate) const fn location(self) -> MemoryLocation {
        match self {
            MemoryHome::Device => MemoryLocation::GpuOnly,
            MemoryHome::Upload => MemoryLocation::CpuToGpu,
            MemoryHome::Readback => MemoryLocation::GpuToCpu,
        }
    }

    /// The word used in plans.
    pub const fn name(self) -> &'static str {
        match self {
            MemoryHome::Device => "device",
            MemoryHome::Upload => "upload",
            MemoryHome::Readback => "readback",
        }
    }
}

/// Bytes of one purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LedgerEntry {
    /// Allocated now.
    pub bytes: u64,
    /// The most that was ever allocated at once.
    pub bytes_max: u64,
    /// Allocations made so far.
    pub allocations: u64,
}

/// Bytes of device memory by purpose (the resource's name).
#[derive(Debug, Default)]
pub struct Ledger(Mutex<BTreeMap<String, LedgerEntry>>);

impl Ledger {
    pub(crate) fn add(&self, purpose: &str, bytes: u64) {
        let mut entries = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let entry = entries.entry(purpose.to_owned()).or_default();
        entry.bytes += bytes;
        entry.bytes_max = entry.bytes_max.max(entry.bytes);
        entry.allocations += 1;
    }

    pub(crate) fn remove(&self, purpose: &str, bytes: u64) {
        let mut entries = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(entry) = entries.get_mut(purpose) {
            entry.bytes = entry.bytes.saturating_sub(bytes);
        }
    }

    /// Every purpose there ever was, by name.
    pub fn entries(&self) -> BTreeMap<String, LedgerEntry> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()
    }

    /// Allocated now, over all purposes.
    pub fn bytes(&self) -> u64 {
        self.entries().values().map(|entry| entry.bytes).sum()
    }
}
