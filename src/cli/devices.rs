//! `ashfall devices`: what Vulkan offers on this machine.

use clap::Args;
use serde::Serialize;

use crate::cli::output::{print, print_json};
use crate::cli::scene_flags::shader_compiler;
use crate::error::{Error, Result};
use crate::gpu::{DeviceFacts, DeviceRequest, Gpu, Instance, QueueTopology, Validation};
use crate::study::sampler_precision::{SamplerError, sampler_errors};

/// List this machine's Vulkan devices, what each can do, and what it lacks, if anything.
///
/// How precise the sampler of each usable device is, is measured: "hardware" filtering costs that
/// much; "exact" filtering is done in the shader and costs nothing of it.
#[derive(Args)]
pub struct Arguments {
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    devices: Vec<Device>,
}

#[derive(Serialize)]
struct Device {
    index: usize,
    name: String,
    driver: String,
    kind: &'static str,
    vulkan: String,
    usable: bool,
    missing: Vec<String>,
    queues: Vec<Queue>,
    /// What `--queues` may ask for.
    topologies: Vec<&'static str>,
    image_3d_edge_max: u32,
    storage_bytes_max: u64,
    heap_bytes: u64,
    timestamp_period_ns: f32,
    /// Measured now; empty where the device is not usable.
    sampler: Vec<SamplerError>,
}

#[derive(Serialize)]
struct Queue {
    family: u32,
    count: u32,
    compute: bool,
    graphics: bool,
    transfer: bool,
    timestamp_bits: u32,
    copy_granularity: [u32; 3],
}

/// Prints every device; ends with 4 when none is usable.
pub fn run(arguments: &Arguments) -> Result<()> {
    let instance = Instance::new(Validation::Off)?;
    let facts = Gpu::list(&instance)?;
    let mut devices = Vec::new();
    for facts in facts {
        let sampler = if facts.missing.is_empty() {
            let request =
                DeviceRequest { choice: Some(facts.index.to_string()), ..DeviceRequest::default() };
            sampler_errors(&Gpu::open(&instance, &request)?, &shader_compiler())?
        } else {
            Vec::new()
        };
        devices.push(device(facts, sampler));
    }
    let report = Report { devices };
    if arguments.json {
        print_json(&report)?;
    } else {
        report.devices.iter().try_for_each(describe)?;
    }
    if report.devices.iter().any(|device| device.usable) {
        return Ok(());
    }
    Err(Error::machine(
        "no usable Vulkan device: install a driver, or mesa-vulkan-drivers for one that needs no GPU",
    ))
}

fn device(facts: DeviceFacts, sampler: Vec<SamplerError>) -> Device {
    Device {
        index: facts.index,
        name: facts.name,
        driver: facts.driver,
        kind: facts.kind,
        vulkan: facts.version.map(|part| part.to_string()).join("."),
        usable: facts.missing.is_empty(),
        missing: facts.missing,
        queues: facts
            .queues
            .iter()
            .map(|queue| Queue {
                family: queue.family,
                count: queue.count,
                compute: queue.compute,
                graphics: queue.graphics,
                transfer: queue.transfer,
                timestamp_bits: queue.timestamp_bits,
                copy_granularity: queue.copy_granularity,
            })
            .collect(),
        topologies: QueueTopology::offered(&facts.queues).iter().map(|of| of.name()).collect(),
        image_3d_edge_max: facts.image_3d_edge_max,
        storage_bytes_max: facts.storage_bytes_max,
        heap_bytes: facts.heap_bytes,
        timestamp_period_ns: facts.timestamp_period_ns,
        sampler,
    }
}

fn describe(device: &Device) -> Result<()> {
    print(format_args!(
        "{}: {} ({}, {}), Vulkan {}, {} MiB, 3D images to {}, storage buffers to {} MiB\n",
        device.index,
        device.name,
        device.kind,
        device.driver,
        device.vulkan,
        device.heap_bytes >> 20,
        device.image_3d_edge_max,
        device.storage_bytes_max >> 20
    ))?;
    for queue in &device.queues {
        let jobs =
            [(queue.compute, "compute"), (queue.graphics, "graphics"), (queue.transfer, "copies")];
        let jobs: Vec<_> = jobs.iter().filter(|(has, _)| *has).map(|(_, job)| *job).collect();
        print(format_args!(
            "   family {}: {} queue(s) for {}, {} timestamp bits, copies in {:?} texels\n",
            queue.family,
            queue.count,
            jobs.join(", "),
            queue.timestamp_bits,
            queue.copy_granularity
        ))?;
    }
    print(format_args!("   --queues {}\n", device.topologies.join(", ")))?;
    for sampler in &device.sampler {
        print(format_args!(
            "   sampler on {}: wrong by up to {:.1e} of the value range{}\n",
            sampler.texels,
            sampler.error_max,
            if sampler.exact { ", precise" } else { "" }
        ))?;
    }
    for missing in &device.missing {
        print(format_args!("   not usable: lacks {missing}\n"))?;
    }
    Ok(())
}
