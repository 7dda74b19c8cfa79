//! Moves every ray of a tile on by a bounded number of samples, until it ends.

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Buffer, ComputePipeline, Image, Recorder, Sampler, Variant};

/// What one channel needs of the shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelShape {
    /// An image of one value per voxel, and this many transfer segments.
    Scalar {
        /// At least 1.
        segments: u32,
    },
    /// An image of colours, and this many transfer segments over their alpha.
    Rgba {
        /// At least 1.
        segments: u32,
    },
    /// No image: every voxel has one value, classified by the host into one segment.
    Constant,
}

/// How voxels lie in the image and how values between them are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FilterShape {
    /// The sampler's own trilinear filter.
    Sampler,
    /// Eight texel fetches and f32 arithmetic.
    Fetch,
    /// Two fetches of texels that hold their x, y and xy neighbours too, and f32 arithmetic.
    Quads,
}

impl FilterShape {
    /// The macro that chooses it in the shader.
    pub const fn define(self) -> &'static str {
        match self {
            FilterShape::Sampler => "FILTER_SAMPLER",
            FilterShape::Fetch => "FILTER_FETCH",
            FilterShape::Quads => "FILTER_QUADS",
        }
    }
}

/// What shapes the variant: only what the scene has gets into the shader.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// In the scene's order.
    pub channels: Vec<ChannelShape>,
    /// For all channels with an image.
    pub filter: FilterShape,
    /// Whether rays may end before the volume does.
    pub early_stop: bool,
    /// Whether some voxel is NaN.
    pub nan_voxels: bool,
}

impl Shape {
    /// How many channels have an image.
    pub fn images(&self) -> usize {
        self.channels.iter().filter(|channel| **channel != ChannelShape::Constant).count()
    }

    /// The variant of this shape.
    pub fn variant(&self) -> Variant {
        let mut calls = String::new();
        let (mut image, mut first) = (0, 0);
        for channel in &self.channels {
            match channel {
                ChannelShape::Scalar { segments } => {
                    calls += &format!("CHANNEL_SCALAR({image}, {first}, {segments}) ");
                }
                ChannelShape::Rgba { segments } => {
                    calls += &format!("CHANNEL_RGBA({image}, {first}, {segments}) ");
                }
                ChannelShape::Constant => calls += &format!("CHANNEL_CONSTANT({first}) "),
            }
            image += u32::from(*channel != ChannelShape::Constant);
            first += channel.segments();
        }
        let mut variant = Variant::plain("march").define("CHANNELS_DO", calls.trim_end());
        if self.images() > 0 {
            variant = variant.define("IMAGES", self.images()).define(self.filter.define(), 1);
        }
        if self.early_stop {
            variant = variant.define("EARLY_STOP", 1);
        }
        if self.nan_voxels {
            variant = variant.define("NAN_VOXELS", 1);
        }
        if self.channels.len() > 1 {
            variant = variant.define("SEVERAL_CHANNELS", 1);
        }
        variant
    }
}

impl ChannelShape {
    /// Transfer segments of the channel.
    pub const fn segments(self) -> u32 {
        match self {
            ChannelShape::Scalar { segments } | ChannelShape::Rgba { segments } => segments,
            ChannelShape::Constant => 1,
        }
    }
}

/// The shader's push constants; without EARLY_STOP the last one is not there.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
    /// Blocks of samples in this dispatch.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted.
    pub early_stop: f32,
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[ray]` fixed-point start and step.
    pub ray_geometry: &'r Buffer,
    /// `[segment]` transfer functions of all channels.
    pub transfer: &'r Buffer,
    /// `[ray]` position, optical depth, colour.
    pub ray_state: &'r Buffer,
    /// One per channel that has an image.
    pub channels: &'r [Image],
    /// For every image.
    pub sampler: Option<&'r Sampler>,
}

/// Rays that have ended stay as they are; the others go on from where they were.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    push: &Push,
) {
    let [width, height] = push.tile_size_pixel;
    let mut dispatch = recorder
        .compute(pipeline)
        .read("ray_geometry", resources.ray_geometry)
        .read("transfer", resources.transfer)
        .update("ray_state", resources.ray_state);
    if let Some(sampler) = resources.sampler {
        let images: Vec<_> = resources.channels.iter().map(|image| (image, sampler)).collect();
        dispatch = dispatch.sample("channels", &images);
    }
    let bytes = bytemuck::bytes_of(push);
    let used = pipeline.reflection().push_bytes as usize;
    dispatch.push_bytes(&bytes[..used.min(bytes.len())]).threads([width, height, 1]);
}
