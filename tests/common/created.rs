//! What a renderer has created on a device of its own, against its plan.

use std::collections::BTreeMap;

use ashfall::render::Plan;

use super::drawing::Device;

/// Fails unless every object and byte is the plan's: nothing is missing, and nothing is there unplanned.
#[track_caller]
pub fn assert_as_planned(device: &Device, plan: &Plan, name: &str) {
    let counts = device.gpu.census.counts().into_iter();
    let created: BTreeMap<_, _> = counts.map(|(kind, count)| (kind.name(), count)).collect();
    assert_eq!(created, plan.objects, "{name}: objects");
    let ledger = device.gpu.ledger.entries();
    let buffers = plan.buffers.iter().map(|buffer| (buffer.name, buffer.memory_bytes));
    let images = plan.images.iter().map(|image| (image.name, image.memory_bytes));
    for (resource, bytes) in buffers.chain(images) {
        let entry = ledger.get(resource).copied().unwrap_or_default();
        assert_eq!(entry.bytes_max, bytes, "{name}: bytes of {resource}");
    }
    let total: u64 = ledger.values().map(|entry| entry.bytes_max).sum();
    assert_eq!(total, plan.memory_bytes, "{name}: nothing unplanned is allocated");
    let voxels = ["atlas_", "channel_"];
    let voxels = ledger.iter().filter(|(name, _)| voxels.iter().any(|of| name.starts_with(of)));
    let atlas_bytes: u64 = voxels.map(|(_, entry)| entry.bytes_max).sum();
    assert_eq!(atlas_bytes, plan.atlas_bytes, "{name}: bytes of voxels");
}
