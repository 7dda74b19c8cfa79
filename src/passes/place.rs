//! Puts bricks that lie in the upload buffer into their slots.

use crate::gpu::{Buffer, ComputePipeline, Image, ImageFormat, Recorder, Variant};
use crate::twins::place::Push;

/// The variant for an atlas's format.
pub fn variant(format: ImageFormat) -> Variant {
    let variant = Variant::plain("place")
        .define("TEXEL_FORMAT", format.glsl())
        .define("TEXEL_BYTES", format.bytes());
    match format {
        ImageFormat::R32Sfloat | ImageFormat::Rgba32Sfloat => variant.define("TEXEL_FLOAT", 1),
        _ => variant,
    }
}

/// What the pass touches.
pub struct Resources<'r> {
    /// `[word]` texels, tightly packed.
    pub upload: &'r Buffer,
    /// `[brick]` where each lies and where it goes.
    pub placements: &'r Buffer,
    /// The slots.
    pub atlas: &'r Image,
}

/// Places `bricks` bricks.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    resources: &Resources<'r>,
    bricks: u32,
    push: &Push,
) {
    recorder
        .compute(pipeline)
        .read("upload", resources.upload)
        .read("placements", resources.placements)
        .store("atlas", &[resources.atlas])
        .push(push)
        .threads([push.texels_max, bricks, 1]);
}
