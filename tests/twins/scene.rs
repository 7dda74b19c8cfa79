//! Random media: channels, images and transfer functions, as the shaders and as their twins take them.

use std::sync::Arc;

use ashfall::gpu::{Buffer, ComputePipeline, Image, Sampler, SamplerFilter};
use ashfall::passes::march_shape::{
    ChannelShape, FilterShape, MacrocellUse, SceneResources, Shape,
};
use ashfall::passes::{cast, march};
use ashfall::twins::filter::Texels;
use ashfall::twins::limits::BLOCK_SAMPLES;
use ashfall::twins::macrocells::{CODE_SHOWS, REACH_MAX};
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_march::Channel;
use ashfall::twins::transfer::TransferSegment;
use ashfall::volume::{Macrocells, Size3};

use crate::common::device::Device;
use crate::random::Random;
use crate::texels::{Conversion, Raw, Texture};
use crate::views::pick;

/// What a voxel may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    U8,
    U16,
    F32,
    /// f32 with NaN here and there.
    Holes,
    /// f32 up to the greatest finite one.
    Huge,
    /// f32 of quarters, and segments that begin at quarters: values meet borders exactly.
    Quarters,
    Rgba8,
    Constant,
}

/// Channels with their images and transfer functions.
pub struct Medium {
    /// Voxels, without the apron.
    pub size: [u32; 3],
    pub kinds: Vec<Kind>,
    textures: Vec<Option<Texture>>,
    pub segments: Vec<Vec<TransferSegment>>,
    /// Some show nothing, whatever is in their voxels.
    pub codes: Macrocells<u8>,
    /// Of how many samples each channel takes one.
    pub sample_every: Vec<u32>,
}

/// Extinctions of a transfer function: powers of ten.
pub type Powers = [f64; 2];

pub const TAME: Powers = [-2.0, 0.5];
pub const WILD: Powers = [-24.0, 24.0];

impl Medium {
    /// Channels of a kind and so many transfer segments each.
    pub fn random(random: &mut Random, size: [u32; 3], of: &[(Kind, u32)], at: Powers) -> Medium {
        let apron = size.map(|edge| edge + 2);
        let count = apron.iter().product::<u32>() as usize;
        let texture = |random: &mut Random, kind| {
            let mut unit = || random.unit();
            let raw = match kind {
                Kind::Constant => return None,
                Kind::U8 => Raw::U8((0..count).map(|_| (unit() * 256.0) as u8).collect()),
                Kind::U16 => Raw::U16((0..count).map(|_| (unit() * 65536.0) as u16).collect()),
                Kind::F32 => Raw::F32((0..count).map(|_| unit() as f32).collect()),
                Kind::Holes => {
                    let voxel = |unit: f64| if unit < 0.02 { f32::NAN } else { unit as f32 };
                    Raw::F32((0..count).map(|_| voxel(unit())).collect())
                }
                Kind::Huge => {
                    let voxel = |unit: f64| if unit < 0.3 { 0.0 } else { f32::MAX };
                    Raw::F32((0..count).map(|_| voxel(unit())).collect())
                }
                Kind::Quarters => {
                    let [width, height] = [apron[0] as usize, apron[1] as usize];
                    let place = |at: usize| at % width / 4 + at / width % height / 3;
                    Raw::F32((0..count).map(|at| (place(at) % 5) as f32 * 0.25).collect())
                }
                Kind::Rgba8 => {
                    Raw::Rgba8((0..count).map(|_| [0; 4].map(|_| (unit() * 256.0) as u8)).collect())
                }
            };
            Some(Texture { size: apron, raw })
        };
        let textures = of.iter().map(|(kind, _)| texture(random, *kind)).collect();
        let segments = of.iter().map(|&(kind, count)| transfer(random, kind, count, at)).collect();
        let kinds = of.iter().map(|(kind, _)| *kind).collect();
        let codes = codes(random, size);
        Medium { size, kinds, textures, segments, codes, sample_every: Vec::new() }
    }

    pub fn shape(&self, filter: FilterShape, early_stop: bool) -> Shape {
        let channel = |(kind, segments): (&Kind, &Vec<TransferSegment>)| match kind {
            Kind::Constant => ChannelShape::Constant,
            Kind::Rgba8 => ChannelShape::Rgba { segments: segments.len() as u32 },
            _ => ChannelShape::Scalar { segments: segments.len() as u32 },
        };
        Shape {
            channels: self.kinds.iter().zip(&self.segments).map(channel).collect(),
            filter,
            early_stop,
            nan_voxels: self.kinds.contains(&Kind::Holes),
            preintegrated: false,
            macrocells: MacrocellUse::Unused,
            sample_every: self.sample_every.clone(),
        }
    }

    /// As the twins take it, with the numbers that this device makes of its texels.
    pub fn with_channels<T>(
        &self,
        conversion: &Conversion,
        take: impl FnOnce(&[Channel]) -> T,
    ) -> T {
        let size = self.size.map(|edge| edge + 2);
        let raw = |t: &Option<Texture>| t.as_ref().map_or(Raw::U8(Vec::new()), |t| t.raw.clone());
        let raws: Vec<Raw> = self.textures.iter().map(raw).collect();
        let scalars: Vec<_> = raws.iter().map(|raw| conversion.scalars(raw)).collect();
        let colors: Vec<_> = raws.iter().map(|raw| conversion.colors(raw)).collect();
        let channel = |(index, kind): (usize, &Kind)| match kind {
            Kind::Constant => Channel::Constant { segment: &self.segments[index][0] },
            Kind::Rgba8 => Channel::Rgba {
                texels: Texels { size, texels: &colors[index] },
                segments: &self.segments[index],
            },
            _ => Channel::Scalar {
                texels: Texels { size, texels: &scalars[index] },
                segments: &self.segments[index],
            },
        };
        let channels: Vec<Channel> = self.kinds.iter().enumerate().map(channel).collect();
        take(&channels)
    }

    pub fn on(&self, device: &Device, filter: FilterShape) -> OnDevice {
        let segments: Vec<TransferSegment> = self.segments.concat();
        let images = self.textures.iter().flatten();
        let images: Vec<Image> = images.map(|texture| texture.image(device, filter)).collect();
        let sampler = (!images.is_empty())
            .then(|| Sampler::new(&device.gpu, SamplerFilter::Nearest).expect("a sampler"));
        let codes =
            Texture { size: self.codes.size.to_array(), raw: Raw::U8(self.codes.of.clone()) };
        OnDevice {
            transfer: device.filled("transfer", &segments),
            images,
            macrocells: codes.image(device, FilterShape::Fetch),
            sampler,
        }
    }
}

/// A medium's objects.
pub struct OnDevice {
    transfer: Buffer,
    images: Vec<Image>,
    macrocells: Image,
    sampler: Option<Sampler>,
}

impl OnDevice {
    pub fn resources(&self) -> SceneResources<'_> {
        SceneResources {
            transfer: &self.transfer,
            channels: &self.images,
            macrocells: Some(&self.macrocells),
            sampler: self.sampler.as_ref(),
        }
    }
}

/// Half of all macrocells show something, behind steps of any length; the others say how far it is.
fn codes(random: &mut Random, size: [u32; 3]) -> Macrocells<u8> {
    let [x, y, z] = size;
    let size = Macrocells::<u8>::count(Size3::new(x, y, z));
    let [x, y, z] = size.to_array();
    let places = || (0..z).flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])));
    let shown: Vec<bool> = places().map(|_| random.unit() < 0.5).collect();
    let code = |at: [u32; 3]| {
        if shown[size.index(at[0], at[1], at[2])] {
            return CODE_SHOWS + (random.unit() * 128.0) as u8;
        }
        let apart = |other: [u32; 3]| at.iter().zip(other).map(|(a, b)| a.abs_diff(b)).max();
        let seen = places().filter(|[x, y, z]| shown[size.index(*x, *y, *z)]);
        seen.filter_map(apart).min().map_or(REACH_MAX, |apart| (apart as u8).min(REACH_MAX))
    };
    Macrocells { size, of: places().map(code).collect() }
}

/// Pieces with a jump at each border, some borders twice in one place; windows that clamp both ends.
fn transfer(random: &mut Random, kind: Kind, count: u32, at: Powers) -> Vec<TransferSegment> {
    let mut borders: Vec<f32> = (1..count).map(|_| random.unit() as f32).collect();
    if kind == Kind::Quarters {
        borders.iter_mut().for_each(|border| *border = (*border * 5.0).floor() * 0.25);
    }
    borders.sort_by(f32::total_cmp);
    for index in (4..borders.len()).step_by(5) {
        borders[index] = borders[index - 1];
    }
    let (window_scale, window_offset) = match kind {
        Kind::Huge => (1.2 / f32::MAX, -0.1),
        Kind::Quarters => (1.0, 0.0),
        _ => (1.2, -0.1),
    };
    std::iter::once(0.0)
        .chain(borders)
        .map(|begins_at| {
            let extinction = 10f64.powf(random.between(at[0], at[1])) as f32;
            let mut color = || random.between(-1.0, 1.0) as f32;
            let slope = [color(), color(), color(), 3.0 * color() * extinction];
            let start = [color() + 1.5, color() + 1.5, color() + 1.5, extinction];
            TransferSegment { start, slope, begins_at, window_scale, window_offset, unused_0: 0.0 }
        })
        .collect()
}

/// Rays from anywhere inside a volume to anywhere else, every seventh of them empty; every fifth steps
/// one whole voxel down along x and stays where it is along y.
pub fn inner_rays(random: &mut Random, size: [u32; 3], count: usize) -> Vec<RayGeometry> {
    let mut ray = |index: usize| {
        let samples = pick(random, &[1, 2, 31, 32, 33, 64, 150, 200]);
        let mut geometry = RayGeometry {
            sample_count: if index % 7 == 6 { 0 } else { samples },
            step_world: random.between(0.01, 0.5) as f32,
            ..RayGeometry::default()
        };
        for (axis, &edge) in size.iter().enumerate() {
            // Positions have their integers at voxel centres: -1/2 is the volume's face.
            let mut place = || random.between(-0.49, f64::from(edge) - 0.51);
            let (start, end) = (place(), place());
            let fixed = |value: f64| {
                let units = (value * 4_294_967_296.0).round() as i64;
                ((units >> 32) as i32, units as u32)
            };
            // Both ends of every sample are inside, half a step before and after its place.
            let half = 0.5 * (end - start) / f64::from(samples);
            (geometry.start_cell[axis], geometry.start_fraction[axis]) = fixed(start + half);
            (geometry.delta_cell[axis], geometry.delta_fraction[axis]) =
                fixed((end - start) / f64::from(samples));
        }
        if index % 5 == 4 {
            geometry.start_cell[0] = size[0] as i32 - 1;
            geometry.delta_cell = [-1, 0, geometry.delta_cell[2]];
            geometry.delta_fraction = [0, 0, geometry.delta_fraction[2]];
            geometry.sample_count = geometry.sample_count.min(size[0]);
            geometry.start_fraction[0] = 1 << 30;
        }
        geometry
    };
    (0..count).map(&mut ray).collect()
}

/// march.comp, dispatch after dispatch with these bounds of blocks.
pub fn marched(
    device: &Device,
    pipeline: &Arc<ComputePipeline>,
    scene: &OnDevice,
    geometry: &[RayGeometry],
    states: &[RayState],
    early_stop: Option<f32>,
    blocks: &[u32],
) -> Vec<RayState> {
    // Rays behind the tile, which nobody may move.
    let (behind, fresh) = (vec![geometry[0]; 2048], vec![RayState::default(); 2048]);
    let ray_geometry = device.filled("ray_geometry", &[geometry, &behind].concat());
    let ray_state = device.filled("ray_state", &[states, &fresh].concat());
    device.run(|recorder| {
        for blocks_max in blocks {
            let resources = march::Resources {
                ray_geometry: &ray_geometry,
                ray_state: &ray_state,
                scene: scene.resources(),
            };
            let push = march::Push {
                tile_size_pixel: [geometry.len() as u32, 1],
                blocks_max: *blocks_max,
                early_stop: early_stop.unwrap_or(0.0),
            };
            march::record(recorder, pipeline, &resources, &push);
        }
        recorder.host_read(&ray_state);
    });
    let mut after = device.values::<RayState>(&ray_state);
    assert_eq!(after.split_off(geometry.len()), fresh, "rays behind the tile are moved");
    after
}

/// Blocks of the longest of these rays.
pub fn blocks_of(geometry: &[RayGeometry]) -> u32 {
    geometry.iter().map(|ray| ray.sample_count.div_ceil(BLOCK_SAMPLES)).max().unwrap_or(0)
}

/// The variant of cast.comp for one view.
pub fn cast_pipeline(device: &Device, shape: &Shape) -> Arc<ComputePipeline> {
    device.pipeline(&cast::variant(shape, 1))
}
