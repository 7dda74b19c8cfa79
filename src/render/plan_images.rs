//! The plan's images: which channels need one, in which layout, and whether they fit the atlas.

use crate::error::{Error, Result};
use crate::gpu::{Gpu, Image, ImageSpec};
use crate::render::image_layout::{Layout, TexelLayout};
use crate::render::plan::PlannedImage;
use crate::render::planned_layout::{LayoutMeter, PlannedLayout, choose, quads_possible};
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

/// Images of a layout and, by channel of the scene, what a texel means; nothing for a constant channel.
type Images = (Vec<PlannedImage>, Vec<Option<TexelLayout>>);

fn bytes((images, _): &Images) -> u64 {
    images.iter().map(|image| image.memory_bytes).sum()
}

/// The images, what their texels mean, and how that layout was chosen; nothing where there is no image.
pub(super) fn plan_images(
    gpu: &Gpu,
    data: &SceneData,
    facts: &[ChannelFacts],
    settings: &Settings,
    meter: LayoutMeter,
) -> Result<(Images, Option<PlannedLayout>)> {
    let limit = data.scene.memory.atlas_mib << 20;
    let of_layout = |layout| images_in_layout(gpu, data, facts, layout);
    let formats = || facts.iter().map(|facts| facts.format);
    let possible = quads_possible(settings.layout, data.scene.quality.filter, formats())?;
    let sampled = facts.iter().filter(|facts| !facts.is_constant()).map(|facts| facts.format);
    let Some(widest) = sampled.max_by_key(|format| format.bytes()) else {
        return Ok((of_layout(Layout::Plain)?, None));
    };
    let plain = of_layout(Layout::Plain);
    let quads = possible.then(|| of_layout(Layout::Quads));
    let unfit = match &quads {
        None => Some("quads need filter \"exact\" and no RGBA channel".to_owned()),
        Some(Ok(quads)) if bytes(quads) > limit => {
            Some("voxels in quads are more than atlas_mib".to_owned())
        }
        Some(Ok(_)) => None,
        Some(Err(_)) => Some("this device has no images for quads".to_owned()),
    };
    let chosen = choose(settings.layout, unfit, gpu.facts().kind, || meter(widest))?;
    let cost = |images: &Result<Images>| images.as_ref().ok().map(|images| (bytes(images), None));
    let costs = [cost(&plain), quads.as_ref().and_then(cost)];
    let images = match (chosen.layout, quads) {
        (Layout::Quads, Some(quads)) => quads?,
        _ => plain?,
    };
    check_fits(data, bytes(&images), limit)?;
    Ok((images, Some(chosen.planned(costs))))
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
) -> Result<Images> {
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
