//! Random images, with the numbers that the device makes of their texels.

use ashfall::gpu::{Image, ImageFormat};
use ashfall::passes::march_shape::FilterShape;
use ashfall::passes::probe::{self, ProbeShape};
use ashfall::twins::probe::Push;

use crate::common::device::{Device, device};

/// Texels as they are copied.
#[derive(Clone)]
pub enum Raw {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
    Rgba8(Vec<[u8; 4]>),
}

/// An image of the host, apron included, x fastest.
#[derive(Clone)]
pub struct Texture {
    pub size: [u32; 3],
    pub raw: Raw,
}

/// What this device reads for each integer: within one unit in the last place of the quotient, which
/// is all that Vulkan promises, so it is measured and not assumed.
pub struct Conversion {
    of_u8: Vec<f32>,
    of_u16: Vec<f32>,
}

impl Conversion {
    pub fn measured(device: &Device) -> Conversion {
        let bytes: Vec<u8> = (0..=255).collect();
        let words: Vec<u16> = (0..=65535).collect();
        let read = |size: [u32; 3], format, texels: &[u8]| {
            let image = device.image(size, format, texels);
            // One line per texel; the shader's position 0 is texel 1, behind the apron.
            sums(
                device,
                ProbeShape::OneTexel,
                &image,
                &Push {
                    origin_voxel: [-1.0; 3],
                    lines_across: size[0],
                    column_voxel: [1.0, 0.0, 0.0],
                    lines_down: size[1],
                    row_voxel: [0.0, 1.0, 0.0],
                    samples: 1,
                    step_voxel: [0.0; 3],
                },
            )
        };
        Conversion {
            of_u8: read([16, 16, 1], ImageFormat::R8Unorm, &bytes),
            of_u16: read([256, 256, 1], ImageFormat::R16Unorm, bytemuck::cast_slice(&words)),
        }
    }

    pub fn scalars(&self, raw: &Raw) -> Vec<f32> {
        match raw {
            Raw::U8(v) => v.iter().map(|value| self.of_u8[usize::from(*value)]).collect(),
            Raw::U16(v) => v.iter().map(|value| self.of_u16[usize::from(*value)]).collect(),
            Raw::F32(v) => v.clone(),
            Raw::Rgba8(_) => Vec::new(),
        }
    }

    pub fn colors(&self, raw: &Raw) -> Vec<[f32; 4]> {
        match raw {
            Raw::Rgba8(v) => {
                v.iter().map(|texel| texel.map(|part| self.of_u8[usize::from(part)])).collect()
            }
            _ => Vec::new(),
        }
    }
}

impl Texture {
    /// On the device, in the layout that a filter takes.
    pub fn image(&self, device: &Device, filter: FilterShape) -> Image {
        let quads = filter == FilterShape::Quads;
        match &self.raw {
            Raw::U8(v) if quads => self.quads(device, ImageFormat::Rgba8Unorm, v),
            Raw::U16(v) if quads => self.quads(device, ImageFormat::Rgba16Unorm, v),
            Raw::F32(v) if quads => self.quads(device, ImageFormat::Rgba32Sfloat, v),
            Raw::U8(v) => device.image(self.size, ImageFormat::R8Unorm, v),
            Raw::U16(v) => device.image(self.size, ImageFormat::R16Unorm, bytemuck::cast_slice(v)),
            Raw::F32(v) => device.image(self.size, ImageFormat::R32Sfloat, bytemuck::cast_slice(v)),
            Raw::Rgba8(v) => device.image(self.size, ImageFormat::Rgba8Unorm, v.as_flattened()),
        }
    }

    fn quads<T: bytemuck::NoUninit>(&self, device: &Device, to: ImageFormat, v: &[T]) -> Image {
        let [width, height, _] = self.size.map(|edge| edge as usize);
        let right = |at: usize| if at % width + 1 < width { at + 1 } else { at };
        let below = |at: usize| if at / width % height + 1 < height { at + width } else { at };
        let quad = |at: usize| [v[at], v[right(at)], v[below(at)], v[right(below(at))]];
        let texels: Vec<T> = (0..v.len()).flat_map(quad).collect();
        device.image(self.size, to, bytemuck::cast_slice(&texels))
    }
}

/// probe.comp's sums.
pub fn sums(device: &Device, shape: ProbeShape, image: &Image, push: &Push) -> Vec<f32> {
    let filter = match shape {
        ProbeShape::Filtered(FilterShape::Sampler) => ashfall::gpu::SamplerFilter::Linear,
        _ => ashfall::gpu::SamplerFilter::Nearest,
    };
    let sampler = ashfall::gpu::Sampler::new(&device.gpu, filter).expect("a sampler");
    let pipeline = device.pipeline(&probe::variant(shape));
    let lines = (push.lines_across * push.lines_down) as usize;
    let room = device.room::<f32>("sums", lines);
    let probed = (shape != ProbeShape::Loop).then_some((image, &sampler));
    device.run(|recorder| probe::record(recorder, &pipeline, probed, &room, push));
    device.written(&room)
}

#[test]
fn integers_become_the_nearest_fractions() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    for (values, most) in [(&conversion.of_u8, 255u32), (&conversion.of_u16, 65535)] {
        assert_eq!((values[0], values[most as usize]), (0.0, 1.0));
        for (value, got) in (0..).zip(values) {
            let exact = value as f32 / most as f32;
            let ulps = got.to_bits().abs_diff(exact.to_bits());
            assert!(ulps <= 1, "{value} of {most}: {got} is {ulps} ulp off");
        }
    }
}
