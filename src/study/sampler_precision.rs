//! How precise a device's filters are, measured against f64 arithmetic.
//!
//! Samplers of real devices weigh with 8 bits; lavapipe's do so for 8-bit texels alone. What is
//! precise is a property of the device, so it is measured, not assumed.

use std::sync::Arc;

use serde::Serialize;

use crate::error::Result;
use crate::gpu::{
    Buffer, BufferSpec, ComputePipeline, Gpu, Image, ImageSpec, MemoryHome, Recorder, RoleKind,
    Sampler, SamplerFilter, ShaderCompiler, Staging,
};
use crate::passes::march_shape::FilterShape;
use crate::passes::probe::{self, ProbeShape};
use crate::render::{Layout, TexelLayout, upload};
use crate::twins::probe::Push;
use crate::volume::{Size3, ValueRange, VoxelFormat, Voxels};

/// An error up to this part of the value range counts as exact.
pub const EXACT_ERROR_MAX: f64 = 1e-6;
/// Voxels along each axis of the measured image.
const EDGE: u32 = 32;

/// What the device's own trilinear filter does to one texel format.
#[derive(Clone, Debug, Serialize)]
pub struct SamplerError {
    /// Texel format.
    pub texels: &'static str,
    /// Greatest error, as a part of the value range.
    pub error_max: f64,
    /// Whether it is within [`EXACT_ERROR_MAX`].
    pub exact: bool,
}

/// Measures the sampler for every format that voxels are kept in.
///
/// # Errors
/// Exit code 4 when the device runs out of memory or is lost.
pub fn sampler_errors(gpu: &Arc<Gpu>, compiler: &ShaderCompiler) -> Result<Vec<SamplerError>> {
    let sampler = Sampler::new(gpu, SamplerFilter::Linear)?;
    let of_format = |format| {
        let voxels = noise(format, EDGE);
        let texel =
            TexelLayout::of(format, ValueRange { least: 0.0, greatest: 1.0 }, Layout::Plain);
        let image = filled_image(gpu, &voxels, EDGE, &texel)?;
        let probed = (&image, &sampler);
        let shape = FilterShape::Sampler;
        let error_max = filter_error(gpu, compiler, probed, shape, &voxels, &texel)?;
        let exact = error_max <= EXACT_ERROR_MAX;
        Ok(SamplerError { texels: texel.format.name(), error_max, exact })
    };
    [VoxelFormat::U8, VoxelFormat::U16, VoxelFormat::F32].into_iter().map(of_format).collect()
}

/// Greatest error of a device's filter against f64 arithmetic, as a part of the value range.
///
/// Positions are multiples of 1/512 voxel, which every step of a sampler's arithmetic holds exactly,
/// so that what differs is the filter itself.
pub(super) fn filter_error(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    probed: (&Image, &Sampler),
    filter: FilterShape,
    voxels: &Voxels,
    texel: &TexelLayout,
) -> Result<f64> {
    const LINES: u32 = 64;
    let edge = probed.0.spec().size[0] - 2;
    let pipeline = ComputePipeline::new(
        gpu,
        compiler.compile(&probe::variant(ProbeShape::Filtered(filter)))?,
    )?;
    let sums = Buffer::new(gpu, &sums_spec(LINES))?;
    let part = |numerator: f32| numerator / 512.0;
    let push = Push {
        origin_voxel: [part(3.0), part(7.0), part(1.0)],
        lines_across: LINES,
        column_voxel: [part(101.0), part(13.0), part(27.0)],
        lines_down: LINES,
        row_voxel: [part(23.0), part(113.0), part(91.0)],
        samples: 1,
        step_voxel: [0.0; 3],
    };
    let mut recorder = Recorder::new(gpu, RoleKind::Render, None);
    probe::record(&mut recorder, &pipeline, Some(probed), &sums, &push);
    gpu.wait(recorder.submit(&[])?.point)?;
    let mut values = vec![0.0f32; (LINES * LINES) as usize];
    sums.read(0, bytemuck::cast_slice_mut(&mut values))?;
    let range = voxels.range();
    let mut worst = 0.0f64;
    for (index, value) in values.iter().enumerate() {
        let (x, y) = (index as u32 % LINES, index as u32 / LINES);
        let position: [f64; 3] = std::array::from_fn(|axis| {
            f64::from(push.origin_voxel[axis])
                + f64::from(x) * f64::from(push.column_voxel[axis])
                + f64::from(y) * f64::from(push.row_voxel[axis])
        });
        let stored = f64::from(*value) * texel.scale + texel.offset;
        let exact = trilinear(voxels, edge, position);
        worst = worst.max((stored - exact).abs());
    }
    Ok(worst / f64::from(range.greatest - range.least))
}

/// In f64, edge voxels repeated.
fn trilinear(voxels: &Voxels, edge: u32, position_voxel: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    for corner in 0..8 {
        let mut weight = 1.0;
        let mut at = [0u32; 3];
        for axis in 0..3 {
            let cell = position_voxel[axis].floor();
            let within = position_voxel[axis] - cell;
            let far = corner >> axis & 1 == 1;
            weight *= if far { within } else { 1.0 - within };
            at[axis] = (cell + f64::from(u8::from(far))).clamp(0.0, f64::from(edge - 1)) as u32;
        }
        sum += weight * f64::from(voxels.value(Size3::cube(edge).index(at[0], at[1], at[2])));
    }
    sum
}

/// Hashed noise over the format's whole range; f32 in 0 to 1.
pub(super) fn noise(format: VoxelFormat, edge: u32) -> Voxels {
    let count = Size3::cube(edge).len().unwrap_or(0) as u32;
    let hash = |index: u32| {
        let mixed = (index ^ (index >> 16)).wrapping_mul(0x7feb_352d);
        (mixed ^ (mixed >> 15)).wrapping_mul(0x846c_a68b) >> 8
    };
    match format {
        VoxelFormat::U16 => Voxels::U16((0..count).map(|i| hash(i) as u16).collect()),
        VoxelFormat::F32 => {
            Voxels::F32((0..count).map(|i| hash(i) as f32 / 16_777_216.0).collect())
        }
        _ => Voxels::U8((0..count).map(|i| hash(i) as u8).collect()),
    }
}

pub(super) fn filled_image(
    gpu: &Arc<Gpu>,
    voxels: &Voxels,
    edge: u32,
    texel: &TexelLayout,
) -> Result<Image> {
    let size = [edge + 2; 3];
    let spec = ImageSpec { name: "probed", size, format: texel.format, stored: false };
    let image = Image::new(gpu, &spec)?;
    let slice = u64::from(size[0]) * u64::from(size[1]) * texel.format.bytes();
    let mut staging = Staging::new(gpu, slice.max(4 << 20))?;
    upload(&mut staging, &image, voxels, Size3::cube(edge), texel)?;
    staging.finish()?;
    Ok(image)
}

pub(super) fn sums_spec(lines: u32) -> BufferSpec {
    let bytes = u64::from(lines) * u64::from(lines) * size_of::<f32>() as u64;
    BufferSpec { name: "sums", bytes, home: MemoryHome::Readback }
}
