//! The plan's buffers, and the count of every Vulkan object.

use std::collections::BTreeMap;

use crate::gpu::{
    Buffer, BufferSpec, Gpu, MemoryHome, ObjectKind, ObjectsOfPipeline, RoleKind, Staging,
};
use crate::render::plan::{PlannedBuffer, PlannedImage};
use crate::render::scene_data::SceneData;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_setup::ViewRays;
use crate::twins::transfer::TransferSegment;

/// Every buffer: for `one_dispatch`, those of ray states are not needed.
pub(super) fn plan_buffers(
    gpu: &Gpu,
    data: &SceneData,
    tile: [u32; 2],
    segments: usize,
    images: &[PlannedImage],
    one_dispatch: bool,
) -> Vec<PlannedBuffer> {
    let rays = u64::from(tile[0]) * u64::from(tile[1]);
    let views = data.scene.views.len() as u64;
    let spec = |name, bytes, home| BufferSpec { name, bytes, home };
    let mut specs = vec![
        spec("views", views * size_of::<ViewRays>() as u64, MemoryHome::Upload),
        spec("transfer", (segments * size_of::<TransferSegment>()) as u64, MemoryHome::Upload),
        spec("picture", rays * size_of::<[f32; 4]>() as u64, MemoryHome::Readback),
        spec("counters", size_of::<[u32; 2]>() as u64, MemoryHome::Readback),
    ];
    if !one_dispatch {
        specs.extend([
            spec("ray_geometry", rays * size_of::<RayGeometry>() as u64, MemoryHome::Device),
            spec("ray_state", rays * size_of::<RayState>() as u64, MemoryHome::Device),
        ]);
    }
    // Staging no larger than the largest image, and at least one row of it.
    let image_bytes = |image: &PlannedImage| {
        image.size.iter().map(|edge| u64::from(*edge)).product::<u64>() * image.spec.format.bytes()
    };
    let row_bytes = |image: &PlannedImage| u64::from(image.size[0]) * image.spec.format.bytes();
    if let Some(largest) = images.iter().map(image_bytes).max() {
        let row = images.iter().map(row_bytes).max().unwrap_or(1);
        let half =
            ((data.scene.memory.staging_mib << 20) / gpu.staging_halves()).min(largest).max(row);
        specs.extend(Staging::specs(gpu, half, copies_of(images, half)));
    }
    planned_buffers(gpu, specs)
}

/// Buffers with the memory that each takes.
pub(super) fn planned_buffers(gpu: &Gpu, specs: Vec<BufferSpec>) -> Vec<PlannedBuffer> {
    specs
        .into_iter()
        .map(|spec| PlannedBuffer {
            name: spec.name,
            bytes: spec.bytes,
            memory_bytes: Buffer::memory_bytes(gpu, &spec),
            home: spec.home.name(),
            spec,
        })
        .collect()
}

/// Copies that fill all images through staging halves of `half` bytes; see `upload`.
pub(super) fn copies_of(images: &[PlannedImage], half: u64) -> u64 {
    let copies = |image: &PlannedImage| {
        let [width, height, depth] = image.size.map(u64::from);
        let rows = (half / (width * image.spec.format.bytes())).max(1);
        match rows / height {
            0 => height.div_ceil(rows) * depth,
            slices => depth.div_ceil(slices),
        }
    };
    images.iter().map(copies).sum()
}

/// How roles map to queues, for people.
pub(super) fn queues_text(gpu: &Gpu, render_only: bool) -> String {
    let (family, index) = gpu.queue_of(RoleKind::Render);
    let render = format!("render on family {family} queue {index}");
    let (family, index) = gpu.queue_of(RoleKind::Transfer);
    match (render_only, gpu.roles_share_queue()) {
        (true, _) => render,
        (false, true) => format!("{render}, shared by transfer"),
        (false, false) => format!("{render}, transfer on family {family} queue {index}"),
    }
}

/// Vulkan objects by kind.
pub(super) fn objects(
    gpu: &Gpu,
    buffers: &[PlannedBuffer],
    images: &[PlannedImage],
    passes: u64,
    submits: u64,
    copies: u64,
) -> BTreeMap<&'static str, u64> {
    let halves = buffers.iter().filter(|b| b.name.starts_with("staging_half_")).count() as u64;
    let (buffers, images) = (buffers.len() as u64, images.len() as u64);
    let transfers = u64::from(images > 0);
    let in_flight = |role: RoleKind| gpu.in_flight_max(role) as u64;
    let timed = |role| u64::from(gpu.has_timestamps(role));
    let counts = [
        (ObjectKind::Buffer, buffers),
        (ObjectKind::Image, images),
        (ObjectKind::ImageView, images),
        (ObjectKind::Sampler, transfers),
        (ObjectKind::DeviceMemory, buffers + images),
        (ObjectKind::Semaphore, 1 + transfers),
        (ObjectKind::CommandPool, 1 + transfers),
        (
            ObjectKind::CommandBuffer,
            submits.min(in_flight(RoleKind::Render)) + copies.min(in_flight(RoleKind::Transfer)),
        ),
        (ObjectKind::QueryPool, timed(RoleKind::Render) + halves * timed(RoleKind::Transfer)),
    ];
    let of_passes = ObjectsOfPipeline::COUNTS.map(|(kind, count)| (kind, count * passes));
    counts
        .into_iter()
        .chain(of_passes)
        .filter(|(_, count)| *count > 0)
        .map(|(kind, count)| (kind.name(), count))
        .collect()
}
