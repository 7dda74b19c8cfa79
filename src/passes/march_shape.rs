//! What shapes the shaders that march rays: only what the scene has gets into them.

use crate::gpu::{Buffer, ComputePipeline, Dispatch, Image, Sampler, Variant};
use crate::twins::bits::samples_of;
use crate::twins::limits::BLOCK_SAMPLES;
use crate::twins::macrocells::LEVEL_WHOLE;

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

/// What rays do with macrocells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MacrocellUse {
    /// Nothing.
    Unused,
    /// Samples in those that show nothing are left out.
    Skipping,
    /// That, and steps are as long as they allow.
    Adaptive,
}

/// Segments of one channel that are selected from; more are searched.
const SELECTED_SEGMENTS_MAX: u32 = 24;
/// 16 KiB of 48 bytes each: what a uniform buffer holds on every device.
const UNIFORM_SEGMENTS_MAX: u32 = 341;

/// What shapes the variant: only what the scene has gets into the shader.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// In the scene's order.
    pub channels: Vec<ChannelShape>,
    /// For each channel, of how many samples it takes one: a power of two up to half a block; of those that are not
    /// listed 1. For the midpoint rule alone.
    pub sample_every: Vec<u32>,
    /// For all channels with an image.
    pub filter: FilterShape,
    /// Whether rays may end before the volume does.
    pub early_stop: bool,
    /// Whether some voxel is NaN.
    pub nan_voxels: bool,
    /// Whether a sample is integrated as two spans, [`crate::twins::preintegrate`]; else at its place.
    pub preintegrated: bool,
    /// Where rays sample at all.
    pub macrocells: MacrocellUse,
}

impl Shape {
    /// How many channels have an image.
    pub fn images(&self) -> usize {
        self.channels.iter().filter(|channel| **channel != ChannelShape::Constant).count()
    }

    /// Whether some channel leaves samples out.
    pub fn has_rates(&self) -> bool {
        self.sample_every.iter().any(|every| *every > 1)
    }

    /// Whether segments are searched in a storage buffer, since some channel has too many to select
    /// from, or all together are too many for a uniform buffer of any device.
    pub fn searches(&self) -> bool {
        let segments = || self.channels.iter().map(|channel| channel.segments());
        segments().any(|count| count > SELECTED_SEGMENTS_MAX)
            || segments().sum::<u32>() > UNIFORM_SEGMENTS_MAX
    }

    /// Turns of all loops of the shader over one block of samples, at most.
    pub fn turns_of_block(&self) -> u32 {
        let most = self.channels.iter().map(|channel| channel.segments());
        let searched: u32 = if self.searches() { most.sum() } else { 0 };
        let (points, samples) = match (self.preintegrated, self.macrocells) {
            (true, _) => (2 * BLOCK_SAMPLES + 2, (3 * BLOCK_SAMPLES + 2) * (1 + searched)),
            (false, MacrocellUse::Adaptive) => {
                (2 * BLOCK_SAMPLES + 2, (BLOCK_SAMPLES << LEVEL_WHOLE) + 1)
            }
            (false, _) => (BLOCK_SAMPLES + 1, BLOCK_SAMPLES),
        };
        let points = if self.macrocells == MacrocellUse::Unused { 0 } else { points };
        1 + points + samples
    }

    /// A variant of `shader`, which includes `common/ray_march.glsl`, in this shape.
    pub fn variant(&self, shader: &'static str) -> Variant {
        let mut images = 0..;
        let images = self.channels.iter().map(|channel| match channel {
            ChannelShape::Constant => 0,
            _ => images.next().unwrap_or(0),
        });
        let variant = self.define(Variant::plain(shader), "", &images.collect::<Vec<_>>());
        if self.images() > 0 { variant.define("IMAGES", self.images()) } else { variant }
    }

    /// Adds this shape's macros; `declare` stands before what the channels load, and `images` says which
    /// image each channel samples.
    pub(super) fn define(&self, mut variant: Variant, declare: &str, images: &[usize]) -> Variant {
        let (mut load, mut sample) = (declare.to_owned(), String::new());
        let (mut span, mut sampled) = (String::new(), String::new());
        let mut first = 0;
        for (index, (channel, image)) in self.channels.iter().zip(images).enumerate() {
            let kind = match channel {
                ChannelShape::Scalar { .. } => "SCALAR",
                ChannelShape::Rgba { .. } => "RGBA",
                ChannelShape::Constant => {
                    load += &format!("LOAD_CONSTANT(channel_{index}, {first}) ");
                    sample += &match self.preintegrated {
                        true => String::new(),
                        false => format!("SAMPLE_CONSTANT(channel_{index}) "),
                    };
                    span += &format!("SPAN_CONSTANT(channel_{index}, 1) ");
                    first += 1;
                    continue;
                }
            };
            let segments = channel.segments();
            load += &format!("LOAD_SEGMENTS(channel_{index}, {first}, {segments}) ");
            let every = self.sample_every.get(index).copied().unwrap_or(1);
            let of_channel = format!("SAMPLE_{kind}(channel_{index}, {image}, {segments})");
            sample += &match every {
                1 => of_channel,
                _ => format!("SAMPLED_EVERY({every}u, {}u, {of_channel})", samples_of(every)),
            };
            sample += " ";
            let bit = 1u32.checked_shl(index as u32).unwrap_or(0);
            sampled += &format!("SAMPLED({bit}u, {every}u, {}u) ", samples_of(every));
            if self.preintegrated {
                load += &format!("DECLARE_POINTS(channel_{index}) ");
            }
            // Searched pieces are found by a loop.
            let pieces = if self.searches() { 0..0 } else { 0..segments };
            let pieces = pieces.map(|at| format!("ADD_PIECE(channel_{index}, {at}, {segments})"));
            let pieces = pieces.collect::<Vec<_>>().join(" ");
            span += &format!("SPAN_SAMPLED(channel_{index}, {pieces}) ");
            first += segments;
        }
        variant = variant
            .define("LOAD_CHANNELS", load.trim_end())
            .define("SAMPLE_CHANNELS", sample.trim_end());
        if self.preintegrated {
            variant = variant.define("SPAN_CHANNELS", span.trim_end());
        }
        if self.has_rates() {
            variant = variant.define("SAMPLED_CHANNELS", sampled.trim_end());
        }
        variant = if self.searches() {
            let most = self.channels.iter().map(|channel| channel.segments()).max().unwrap_or(1);
            let steps = most.next_power_of_two().trailing_zeros().max(1);
            variant.define("TRANSFER_SEARCH", 1).define("SEARCH_STEPS", format!("{steps}u"))
        } else {
            variant.define("SEGMENTS_TOTAL", first)
        };
        if self.images() > 0 {
            variant = variant.define(self.filter.define(), 1);
        }
        let flags = [
            ("EARLY_STOP", self.early_stop),
            ("NAN_VOXELS", self.nan_voxels),
            ("SEVERAL_CHANNELS", self.channels.len() > 1),
            ("PREINTEGRATED", self.preintegrated),
            ("MACROCELLS", self.macrocells != MacrocellUse::Unused),
            ("ADAPTIVE", self.macrocells == MacrocellUse::Adaptive),
        ];
        let defined = flags.iter().filter(|(_, defined)| *defined);
        defined.fold(variant, |variant, (name, _)| variant.define(*name, 1))
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

/// What every shader that marches rays reads of the scene.
pub struct SceneResources<'r> {
    /// `[segment]` transfer functions of all channels.
    pub transfer: &'r Buffer,
    /// One per channel that has an image.
    pub channels: &'r [Image],
    /// Codes of macrocells, where there are any.
    pub macrocells: Option<&'r Image>,
    /// For every image.
    pub sampler: Option<&'r Sampler>,
}

impl<'r> SceneResources<'r> {
    /// Binds what the pipeline's variant has.
    pub fn bind<'a>(
        &self,
        dispatch: Dispatch<'a, 'r>,
        pipeline: &ComputePipeline,
    ) -> Dispatch<'a, 'r> {
        let has =
            |macro_name| pipeline.variant().defines.iter().any(|(name, _)| name == macro_name);
        let dispatch = if has("TRANSFER_SEARCH") {
            dispatch.read("transfer", self.transfer)
        } else {
            dispatch.uniform("transfer", self.transfer)
        };
        match self.sampler {
            Some(sampler) => {
                let images: Vec<_> = self.channels.iter().map(|image| (image, sampler)).collect();
                let dispatch = dispatch.sample("channels", &images);
                match self.macrocells.filter(|_| has("MACROCELLS")) {
                    Some(macrocells) => dispatch.sample("macrocells", &[(macrocells, sampler)]),
                    None => dispatch,
                }
            }
            None => dispatch,
        }
    }
}
