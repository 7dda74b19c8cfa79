//! How voxels lie in the image of a channel, and what a texel means.

use crate::gpu::ImageFormat;
use crate::passes::march_shape::FilterShape;
use crate::scene::Filter;
use crate::volume::{ValueRange, VoxelFormat};

/// How voxels lie in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// One voxel a texel.
    Plain,
    /// Each texel with its x, y and xy neighbours: four times the memory, a quarter of the fetches.
    Quads,
}

impl Layout {
    /// The word used in plans and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Layout::Plain => "plain",
            Layout::Quads => "quads",
        }
    }
}

/// Which layout is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutChoice {
    /// Quads where the scene allows them, they fit the atlas, and the device samples them for less.
    Auto,
    /// This one.
    Only(Layout),
}

/// The image of one channel: its texel format, and how a texel leads to the stored value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexelLayout {
    /// How voxels lie.
    pub layout: Layout,
    /// Format of a texel.
    pub format: ImageFormat,
    /// stored value = texel * scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
}

impl TexelLayout {
    /// The image for voxels of this format and range.
    ///
    /// f32 voxels are stored relative to their least value where the range is narrow beside it, so
    /// that interpolation keeps its digits; and scaled down where sums of two would overflow.
    pub fn of(format: VoxelFormat, range: ValueRange, layout: Layout) -> TexelLayout {
        let (plain, quads, scale, offset) = match format {
            VoxelFormat::U8 => (ImageFormat::R8Unorm, ImageFormat::Rgba8Unorm, 255.0, 0.0),
            VoxelFormat::U16 => (ImageFormat::R16Unorm, ImageFormat::Rgba16Unorm, 65535.0, 0.0),
            VoxelFormat::I16 => {
                (ImageFormat::R16Unorm, ImageFormat::Rgba16Unorm, 65535.0, -32768.0)
            }
            VoxelFormat::Rgba8 => (ImageFormat::Rgba8Unorm, ImageFormat::Rgba8Unorm, 255.0, 0.0),
            VoxelFormat::F32 => {
                let (scale, offset) = float_scaling(range);
                (ImageFormat::R32Sfloat, ImageFormat::Rgba32Sfloat, scale, offset)
            }
        };
        let colour = format == VoxelFormat::Rgba8;
        match layout {
            Layout::Quads if !colour => TexelLayout { layout, format: quads, scale, offset },
            _ => TexelLayout { layout: Layout::Plain, format: plain, scale, offset },
        }
    }

    /// The shader's filter for such an image.
    pub fn filter_shape(&self, filter: Filter) -> FilterShape {
        match (filter, self.layout) {
            (Filter::Hardware, _) => FilterShape::Sampler,
            (Filter::Exact, Layout::Plain) => FilterShape::Fetch,
            (Filter::Exact, Layout::Quads) => FilterShape::Quads,
        }
    }
}

fn float_scaling(range: ValueRange) -> (f64, f64) {
    let (least, greatest) = (f64::from(range.least), f64::from(range.greatest));
    if range.is_empty() || !(greatest - least).is_finite() {
        return (1.0, 0.0);
    }
    let magnitude = least.abs().max(greatest.abs());
    if magnitude > f64::from(f32::MAX) / 16.0 {
        // A power of two: exact but for denormals.
        (16.0, 0.0)
    } else if magnitude > 2.0 * (greatest - least) {
        // All values lie within a factor of two, so differences from the least are exact in f32.
        (1.0, least)
    } else {
        (1.0, 0.0)
    }
}
