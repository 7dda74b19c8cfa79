//! The plan's images: which channels need one, in which layout, and whether they fit the atlas.

use crate::error::{Error, Result};
use crate::gpu::{Gpu, Image, ImageSpec};
use crate::render::image_layout::{Layout, LayoutChoice, TexelLayout};
use crate::render::plan::PlannedImage;
use crate::render::scene_data::SceneData;
use crate::render::settings::Settings;
use crate::scene::Filter;
use crate::volume::{ChannelVoxels, ValueRange, VoxelFormat};

/// Names of the images of channels, in the order of the scene.
const CHANNEL_NAMES: [&str; 16] = [
    "channel_0",
    "channel_1",
    "channel_2",
    "channel_3",
    "channel_4",
    "channel_5",
    "channel_6",
    "channel_7",
    "channel_8",
    "channel_9",
    "channel_10",
    "channel_11",
    "channel_12",
    "channel_13",
    "channel_14",
    "channel_15",
];
/// What the plan needs to know of a channel's voxels.
pub(super) struct ChannelFacts {
    pub format: VoxelFormat,
    pub range: ValueRange,
    pub nan_count: usize,
}

impl ChannelFacts {
    pub fn of(channel: &ChannelVoxels) -> ChannelFacts {
        let range = channel.voxels.range();
        let finite = |value: f32| value.clamp(-f32::MAX, f32::MAX);
        let range = if range.is_empty() {
            range
        } else {
            ValueRange { least: finite(range.least), greatest: finite(range.greatest) }
        };
        ChannelFacts {
            format: channel.voxels.format(),
            range,
            nan_count: channel.voxels.nan_count(),
        }
    }

    /// Drawn without an image: one value everywhere.
    pub fn is_constant(&self) -> bool {
        self.range.least == self.range.greatest
            && self.nan_count == 0
            && self.format != VoxelFormat::Rgba8
    }
}

/// The images and, by channel of the scene, what a texel means; nothing for a constant channel.
pub(super) fn plan_images(
    gpu: &Gpu,
    data: &SceneData,
    facts: &[ChannelFacts],
    settings: &Settings,
) -> Result<(Vec<PlannedImage>, Vec<Option<TexelLayout>>)> {
    let limit = data.scene.memory.atlas_mib << 20;
    let of_layout = |layout| images_in_layout(gpu, data, facts, layout);
    let bytes = |images: &[PlannedImage]| images.iter().map(|i| i.memory_bytes).sum::<u64>();
    let quads_possible = data.scene.quality.filter == Filter::Exact
        && facts.iter().all(|facts| facts.format != VoxelFormat::Rgba8);
    if settings.layout == LayoutChoice::Only(Layout::Quads) && !quads_possible {
        return Err(Error::arguments(
            "--layout quads: needs filter \"exact\" and no RGBA channel: use --layout plain",
        ));
    }
    // Measured: `ashfall bench sample`, docs/MEASUREMENTS.md. Where the CPU samples, two fetches of
    // quads cost a fifth of eight; texture hardware has a cache for the eight.
    let quads_wanted = match settings.layout {
        LayoutChoice::Auto => gpu.facts().kind == "cpu",
        LayoutChoice::Only(layout) => layout == Layout::Quads,
    };
    if quads_wanted && quads_possible {
        let (images, layouts) = of_layout(Layout::Quads)?;
        if bytes(&images) <= limit || settings.layout != LayoutChoice::Auto {
            check_fits(data, bytes(&images), limit)?;
            return Ok((images, layouts));
        }
    }
    let (images, layouts) = of_layout(Layout::Plain)?;
    check_fits(data, bytes(&images), limit)?;
    Ok((images, layouts))
}

fn check_fits(data: &SceneData, bytes: u64, limit: u64) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    let volume = &data.scene.volumes[0];
    Err(volume.place.error(format!(
        "volume \"{}\" needs {} MiB on the device, but atlas_mib is {}: raise --atlas-mib or leave out --addressing direct",
        volume.name,
        bytes.div_ceil(1 << 20),
        limit >> 20
    )))
}

fn images_in_layout(
    gpu: &Gpu,
    data: &SceneData,
    facts: &[ChannelFacts],
    layout: Layout,
) -> Result<(Vec<PlannedImage>, Vec<Option<TexelLayout>>)> {
    let volume = &data.scene.volumes[0];
    let volume_size = data.volumes[0].source.description().size();
    let size = volume_size.to_array().map(|edge| edge + 2);
    let edge_max = gpu.facts().image_3d_edge_max;
    let mut images = Vec::new();
    let mut layouts = Vec::new();
    for (channel, facts) in facts.iter().enumerate() {
        if facts.is_constant() {
            layouts.push(None);
            continue;
        }
        if size.iter().any(|edge| *edge > edge_max) {
            return Err(volume.place.error(format!(
                "volume \"{}\" of {} voxels is larger than this device's images ({edge_max} along an axis): leave out --addressing direct",
                volume.name, volume_size
            )));
        }
        let texel = TexelLayout::of(facts.format, facts.range, layout);
        let linear = data.scene.quality.filter == Filter::Hardware;
        if !gpu.samples(texel.format, linear) {
            return Err(Error::machine(format!(
                "device \"{}\" cannot sample{} images of {}: choose another with --device{}",
                gpu.facts().name,
                if linear { " and filter" } else { "" },
                texel.format.name(),
                if linear { ", or --filter exact" } else { "" }
            )));
        }
        let spec =
            ImageSpec { name: CHANNEL_NAMES[channel], size, format: texel.format, stored: false };
        images.push(PlannedImage {
            name: spec.name,
            size,
            format: spec.format.name(),
            layout: texel.layout.name(),
            memory_bytes: Image::memory_bytes(gpu, &spec),
            spec,
            channel: Some(channel),
        });
        layouts.push(Some(texel));
    }
    Ok((images, layouts))
}
