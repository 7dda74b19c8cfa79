//! Turns recorded steps into a command buffer and submits it.

use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::time::Instant;

use ash::vk;

use crate::error::Result;
use crate::gpu::access::{Access, Barrier};
use crate::gpu::census::ObjectKind;
use crate::gpu::device::Gpu;
use crate::gpu::instance::{c_string, vulkan_failed};
use crate::gpu::misuse::misuse;
use crate::gpu::recorder::{Step, Work};
use crate::gpu::resources::WHOLE_IMAGE;
use crate::gpu::roles::{Role, TimePoint};
use crate::gpu::timestamps::{Timestamps, Written};

/// Writes and submits; the caller holds the role's tracker, which keeps submits in order.
pub(crate) fn submit(
    gpu: &Gpu,
    role: &Role,
    steps: &[Step],
    barriers: &[Vec<(&'static str, Barrier)>],
    timestamps: Option<&Timestamps>,
    waits: &[TimePoint],
) -> Result<TimePoint> {
    let device = &gpu.device;
    let commands = free_command_buffer(gpu, role)?;
    let begin =
        vk::CommandBufferBeginInfo::builder().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
    // SAFETY: the command buffer's last submit has ended; its pool is ours under the tracker's lock.
    unsafe { device.begin_command_buffer(commands, &begin) }
        .map_err(|why| vulkan_failed("recording commands", why))?;
    let timestamps = timestamps.filter(|_| role.timestamps);
    if let Some(timestamps) = timestamps {
        // Queries may not be reset while an earlier submit still writes them.
        let last = timestamps.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(written) = last.as_ref() {
            gpu.wait(written.point)?;
        }
        // SAFETY: the queries are not in use.
        unsafe {
            device.cmd_reset_query_pool(commands, timestamps.pool, 0, 2 * timestamps.steps_max);
        }
    }
    let mut labels = Vec::new();
    for (step, barriers) in steps.iter().zip(barriers) {
        write_barriers(gpu, commands, step, barriers);
        let idle = matches!(step.work, Work::HostRead | Work::Prepare | Work::HandOver { .. });
        let measured = timestamps.filter(|_| !idle);
        if let Some(timestamps) = measured {
            let query = 2 * labels.len() as u32;
            if query >= 2 * timestamps.steps_max {
                misuse("more steps than there is room for timestamps");
            }
            let stage = vk::PipelineStageFlags2::TOP_OF_PIPE;
            // SAFETY: the query was reset above.
            unsafe { device.cmd_write_timestamp2(commands, stage, timestamps.pool, query) };
        }
        write_step(gpu, role, commands, step)?;
        if let Some(timestamps) = measured {
            let query = 2 * labels.len() as u32 + 1;
            let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
            // SAFETY: the query was reset above.
            unsafe { device.cmd_write_timestamp2(commands, stage, timestamps.pool, query) };
            labels.push(step.label);
        }
    }
    // SAFETY: recording was begun above.
    unsafe { device.end_command_buffer(commands) }
        .map_err(|why| vulkan_failed("recording commands", why))?;

    let point = TimePoint { role: role.kind, value: role.submitted.load(Ordering::Acquire) + 1 };
    let mut wait_infos = Vec::new();
    for wait in waits.iter().filter(|wait| wait.value > 0) {
        wait_infos.push(
            vk::SemaphoreSubmitInfo::builder()
                .semaphore(gpu.role(wait.role)?.semaphore)
                .value(wait.value)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                .build(),
        );
    }
    let signals = [vk::SemaphoreSubmitInfo::builder()
        .semaphore(role.semaphore)
        .value(point.value)
        .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        .build()];
    let buffers = [vk::CommandBufferSubmitInfo::builder().command_buffer(commands).build()];
    let info = vk::SubmitInfo2::builder()
        .wait_semaphore_infos(&wait_infos)
        .command_buffer_infos(&buffers)
        .signal_semaphore_infos(&signals)
        .build();
    let turn = gpu.turns.take();
    let submitted = Instant::now();
    // SAFETY: the queue is used in its turn; all that the commands touch is stamped with `point` by
    // the recorder right after, and dropped only once it is reached.
    unsafe { device.queue_submit2(role.queue, &[info], vk::Fence::null()) }
        .map_err(|why| vulkan_failed("submitting work", why))?;
    role.submitted.store(point.value, Ordering::Release);
    drop(turn);
    let mut known = role.command_buffers.lock().unwrap_or_else(PoisonError::into_inner);
    known.push((commands, point.value));
    if let Some(timestamps) = timestamps {
        let mut last = timestamps.last.lock().unwrap_or_else(PoisonError::into_inner);
        *last = Some(Written { point, labels, submitted, taken: false });
    }
    Ok(point)
}

/// A new command buffer while fewer than the role's most exist, else the oldest one, once its
/// submit has ended: how many there are depends on the number of submits, never on timing.
fn free_command_buffer(gpu: &Gpu, role: &Role) -> Result<vk::CommandBuffer> {
    let mut known = role.command_buffers.lock().unwrap_or_else(PoisonError::into_inner);
    if known.len() >= gpu.in_flight_max(role.kind) {
        let (oldest, value) = known.remove(0);
        role.wait(&gpu.device, value)?;
        return Ok(oldest);
    }
    let info = vk::CommandBufferAllocateInfo::builder()
        .command_pool(role.pool)
        .level(vk::CommandBufferLevel::PRIMARY)
        .command_buffer_count(1);
    // SAFETY: the pool is used under the tracker's lock.
    let made = unsafe { gpu.device.allocate_command_buffers(&info) }
        .map_err(|why| vulkan_failed("allocating a command buffer", why))?;
    gpu.census.created(ObjectKind::CommandBuffer);
    Ok(made[0])
}

fn write_barriers(
    gpu: &Gpu,
    commands: vk::CommandBuffer,
    step: &Step,
    barriers: &[(&'static str, Barrier)],
) {
    if barriers.is_empty() {
        return;
    }
    let mut memory = Vec::new();
    let mut images = Vec::new();
    for (_, barrier) in barriers {
        let ((before_stage, before_access), (after_stage, after_access)) =
            (barrier.before, barrier.after);
        match step.fresh_image(barrier.resource).filter(|_| barrier.discard) {
            Some(image) => images.push(
                vk::ImageMemoryBarrier2::builder()
                    .src_stage_mask(before_stage)
                    .src_access_mask(before_access)
                    .dst_stage_mask(after_stage)
                    .dst_access_mask(after_access)
                    .old_layout(vk::ImageLayout::UNDEFINED)
                    .new_layout(vk::ImageLayout::GENERAL)
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .image(image.handle)
                    .subresource_range(WHOLE_IMAGE)
                    .build(),
            ),
            // Drivers widen buffer barriers to memory barriers; one of those says the same.
            None => memory.push(
                vk::MemoryBarrier2::builder()
                    .src_stage_mask(before_stage)
                    .src_access_mask(before_access)
                    .dst_stage_mask(after_stage)
                    .dst_access_mask(after_access)
                    .build(),
            ),
        }
    }
    let info =
        vk::DependencyInfo::builder().memory_barriers(&memory).image_memory_barriers(&images);
    // SAFETY: the arrays live until the call returns; images are alive.
    unsafe { gpu.device.cmd_pipeline_barrier2(commands, &info) };
}

fn write_step(gpu: &Gpu, role: &Role, commands: vk::CommandBuffer, step: &Step) -> Result<()> {
    let device = &gpu.device;
    if matches!(step.work, Work::HostRead | Work::Prepare) {
        return Ok(());
    }
    let label = c_string(step.label);
    if let Some(debug_utils) = &gpu.instance.debug_utils {
        let info = vk::DebugUtilsLabelEXT::builder().label_name(&label);
        // SAFETY: the command buffer is being recorded; the label lives until the call returns.
        unsafe { debug_utils.cmd_begin_debug_utils_label(commands, &info) };
    }
    match &step.work {
        Work::HostRead | Work::Prepare => {}
        Work::HandOver { target, from, to } => {
            let (release, acquire) = (Access::CopyWrite, Access::ShaderRead);
            let all = vk::PipelineStageFlags2::ALL_COMMANDS;
            let none = vk::AccessFlags2::NONE;
            // Chained to the semaphore between both: it covers all commands on either side.
            let (before, after) = match *from == role.kind {
                true => ((release.stage(), release.mask()), (all, none)),
                false => ((all, none), (acquire.stage(), acquire.mask())),
            };
            let [from, to] = [from, to].map(|role| gpu.queue_of(*role).0);
            // Within one family there is nothing to hand over.
            let families = if from == to { [vk::QUEUE_FAMILY_IGNORED; 2] } else { [from, to] };
            let barriers = [vk::BufferMemoryBarrier2::builder()
                .src_stage_mask(before.0)
                .src_access_mask(before.1)
                .dst_stage_mask(after.0)
                .dst_access_mask(after.1)
                .src_queue_family_index(families[0])
                .dst_queue_family_index(families[1])
                .buffer(target.handle)
                .size(vk::WHOLE_SIZE)
                .build()];
            let info = vk::DependencyInfo::builder().buffer_memory_barriers(&barriers);
            // SAFETY: the array lives until the call returns; the buffer is alive.
            unsafe { device.cmd_pipeline_barrier2(commands, &info) };
        }
        Work::Dispatch { pipeline, bound, push, groups } => {
            let set = pipeline.set(bound)?;
            let compute = vk::PipelineBindPoint::COMPUTE;
            // SAFETY: the recorder matched resources and push constants to the pipeline's layout;
            // everything is alive until the submit's time point.
            unsafe {
                device.cmd_bind_pipeline(commands, compute, pipeline.handle);
                device.cmd_bind_descriptor_sets(commands, compute, pipeline.layout, 0, &[set], &[]);
                if !push.is_empty() {
                    let stage = vk::ShaderStageFlags::COMPUTE;
                    device.cmd_push_constants(commands, pipeline.layout, stage, 0, push);
                }
                device.cmd_dispatch(commands, groups[0], groups[1], groups[2]);
            }
        }
        Work::CopyToImage { source, target, regions } => {
            let regions: Vec<_> = regions
                .iter()
                .map(|region| vk::BufferImageCopy {
                    buffer_offset: region.buffer_offset,
                    buffer_row_length: 0,
                    buffer_image_height: 0,
                    image_subresource: vk::ImageSubresourceLayers {
                        aspect_mask: vk::ImageAspectFlags::COLOR,
                        mip_level: 0,
                        base_array_layer: 0,
                        layer_count: 1,
                    },
                    image_offset: vk::Offset3D {
                        x: region.start[0] as i32,
                        y: region.start[1] as i32,
                        z: region.start[2] as i32,
                    },
                    image_extent: vk::Extent3D {
                        width: region.size[0],
                        height: region.size[1],
                        depth: region.size[2],
                    },
                })
                .collect();
            // SAFETY: the recorder checked that regions lie inside buffer and image.
            unsafe {
                device.cmd_copy_buffer_to_image(
                    commands,
                    source.handle,
                    target.handle,
                    vk::ImageLayout::GENERAL,
                    &regions,
                );
            }
        }
        Work::CopyToBuffer { source, target, regions } => {
            let regions: Vec<_> = regions
                .iter()
                .map(|region| vk::BufferCopy {
                    src_offset: region.source_offset,
                    dst_offset: region.target_offset,
                    size: region.bytes,
                })
                .collect();
            // SAFETY: the recorder checked that regions lie inside both buffers, which differ.
            unsafe { device.cmd_copy_buffer(commands, source.handle, target.handle, &regions) };
        }
        Work::Fill { target, offset, bytes, value } => {
            // SAFETY: the recorder checked that the bytes lie inside the buffer and are whole numbers.
            unsafe { device.cmd_fill_buffer(commands, target.handle, *offset, *bytes, *value) };
        }
    }
    if let Some(debug_utils) = &gpu.instance.debug_utils {
        // SAFETY: pairs with the label begun above.
        unsafe { debug_utils.cmd_end_debug_utils_label(commands) };
    }
    Ok(())
}
