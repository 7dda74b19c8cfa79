//! Volumes, inputs and truths that the store's tests share.
#![allow(dead_code)]

use std::path::Path;

use crate::random::Random;
use ashfall::error::Result;
use ashfall::import::{Header, Input, Run, Settings, Summary, import_from};
use ashfall::store::Compression;
use ashfall::volume::{Level, Size3, VoxelFormat, Voxels, WorldFromVoxel};

/// A volume in memory and how it is given away.
#[derive(Clone, Debug)]
pub struct Volume {
    pub size: Size3,
    pub spacing: [f64; 3],
    pub channels: Vec<Voxels>,
    /// Voxels that are never delivered: slices of every channel.
    pub absent_slices: Vec<u32>,
    /// Cuts the volume into runs.
    pub seed: u64,
    pub shuffled: bool,
}

impl Volume {
    pub fn of(size: Size3, spacing: [f64; 3], voxels: Voxels) -> Volume {
        Volume {
            size,
            spacing,
            channels: vec![voxels],
            absent_slices: Vec::new(),
            seed: 1,
            shuffled: false,
        }
    }

    pub fn format(&self) -> VoxelFormat {
        self.channels[0].format()
    }

    pub fn absent_voxels(&self) -> u64 {
        let slice = u64::from(self.size.x) * u64::from(self.size.y);
        self.absent_slices.len() as u64 * slice * self.channels.len() as u64
    }

    fn input(&self) -> MemoryInput {
        let header = Header {
            path: "memory".into(),
            size: self.size,
            channels: self.channels.len() as u32,
            times: 1,
            format: self.format(),
            world_from_voxel: WorldFromVoxel::from_spacing(self.spacing).unwrap(),
            scaling: Vec::new(),
            unit: Some("mm".to_owned()),
            format_name: "memory",
            notes: vec!["a note".to_owned()],
            absent_voxels: self.absent_voxels(),
        };
        MemoryInput { header, runs: self.runs().into_iter() }
    }

    /// Slabs, groups of rows and parts of rows; each channel whole or channels in turn.
    fn runs(&self) -> Vec<Run> {
        let mut random = Random(self.seed);
        let mut boxes = Vec::new();
        let mut z = 0;
        while z < self.size.z {
            if self.absent_slices.contains(&z) {
                z += 1;
                continue;
            }
            let absent_next = self.absent_slices.iter().copied().filter(|&absent| absent > z).min();
            let end = absent_next.unwrap_or(self.size.z);
            if random.once_in(2) {
                let slices = (1 + random.below(7) as u32).min(end - z);
                boxes.push(([0, 0, z], Size3::new(self.size.x, self.size.y, slices)));
                z += slices;
                continue;
            }
            let mut y = 0;
            while y < self.size.y {
                let rows = (1 + random.below(9) as u32).min(self.size.y - y);
                let split =
                    if random.once_in(3) { random.below(u64::from(self.size.x)) as u32 } else { 0 };
                if split > 0 {
                    boxes.push(([0, y, z], Size3::new(split, rows, 1)));
                }
                boxes.push(([split, y, z], Size3::new(self.size.x - split, rows, 1)));
                y += rows;
            }
            z += 1;
        }
        let channels = 0..self.channels.len() as u32;
        let mut order: Vec<(u32, ([u32; 3], Size3))> = if random.once_in(2) {
            channels.flat_map(|c| boxes.iter().map(move |&b| (c, b))).collect()
        } else {
            boxes.iter().flat_map(|&b| channels.clone().map(move |c| (c, b))).collect()
        };
        if self.shuffled {
            for i in (1..order.len()).rev() {
                order.swap(i, random.below(i as u64 + 1) as usize);
            }
        }
        let cut = |(channel, (start, size)): (u32, ([u32; 3], Size3))| {
            let voxels = cut(&self.channels[channel as usize], self.size, start, size);
            Run { channel, start, size, voxels }
        };
        order.into_iter().map(cut).collect()
    }

    pub fn import(&self, target: &Path, settings: &Settings) -> Result<Summary> {
        import_from(&|| Ok(Box::new(self.input())), target, settings, &mut |_, _| {})
    }

    /// Level-0 voxels of a channel as the store keeps them.
    pub fn kept(&self, channel: usize) -> Voxels {
        let absent = |index: usize| {
            let slice = self.size.x as usize * self.size.y as usize;
            self.absent_slices.contains(&((index / slice) as u32))
        };
        match &self.channels[channel] {
            Voxels::Rgba8(v) => Voxels::Rgba8(
                v.iter().enumerate().map(|(i, &c)| if absent(i) { [0; 4] } else { c }).collect(),
            ),
            Voxels::F32(_) => self.kept_f32(channel, absent),
            _ if !self.absent_slices.is_empty() => self.kept_f32(channel, absent),
            voxels => voxels.clone(),
        }
    }

    fn kept_f32(&self, channel: usize, absent: impl Fn(usize) -> bool) -> Voxels {
        let voxels = &self.channels[channel];
        let value = |i: usize| match voxels.value(i) {
            _ if absent(i) => f32::NAN,
            value if value.is_infinite() => f32::MAX.copysign(value),
            value if value.is_nan() => f32::NAN,
            value => value,
        };
        Voxels::F32((0..voxels.len()).map(value).collect())
    }
}

struct MemoryInput {
    header: Header,
    runs: std::vec::IntoIter<Run>,
}

impl Input for MemoryInput {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        Ok(self.runs.next())
    }
}

/// A box out of voxels.
pub fn cut(voxels: &Voxels, whole: Size3, start: [u32; 3], size: Size3) -> Voxels {
    let width = voxels.format().bytes();
    let mut bytes = Vec::new();
    for z in start[2]..start[2] + size.z {
        for y in start[1]..start[1] + size.y {
            let at = whole.index(start[0], y, z) * width;
            bytes.extend_from_slice(&voxels.bytes()[at..at + size.x as usize * width]);
        }
    }
    Voxels::from_bytes(voxels.format(), &bytes)
}

pub fn settings(payload: Size3, ram_mib: u32, jobs: usize, compression: Compression) -> Settings {
    let [name, origin] = ["test", "memory"].map(str::to_owned);
    Settings { name, origin, payload, ram_mib, jobs, compression }
}

pub fn default_settings() -> Settings {
    settings(Size3::cube(32), 1024, 2, Compression::Lz4)
}

/// Smooth with some noise, some plateaus; f32 with some of everything that is not finite.
pub fn voxels(format: VoxelFormat, size: Size3, random: &mut Random, wild: bool) -> Voxels {
    let count = size.len().unwrap();
    let flat = random.once_in(4);
    let mut value = 0u64;
    let mut next = |random: &mut Random| {
        if !flat && random.once_in(3) {
            value = random.next();
        }
        value
    };
    match format {
        VoxelFormat::U8 => Voxels::U8((0..count).map(|_| next(random) as u8).collect()),
        VoxelFormat::U16 => Voxels::U16((0..count).map(|_| next(random) as u16).collect()),
        VoxelFormat::I16 => Voxels::I16((0..count).map(|_| next(random) as i16).collect()),
        VoxelFormat::Rgba8 => {
            Voxels::Rgba8((0..count).map(|_| (next(random) as u32).to_le_bytes()).collect())
        }
        VoxelFormat::F32 => {
            let mut one = |random: &mut Random| {
                let value = (next(random) >> 40) as f32 / 1024.0 - 4000.0;
                if !wild {
                    return value;
                }
                match random.below(12) {
                    0 | 1 => f32::NAN,
                    2 => f32::INFINITY,
                    3 => f32::NEG_INFINITY,
                    4 => f32::MAX,
                    5 => -0.0,
                    6 => f32::MIN_POSITIVE / 8.0,
                    _ => value,
                }
            };
            Voxels::F32((0..count).map(|_| one(random)).collect())
        }
    }
}

/// The truth about a level: for each voxel and component the plain f64 mean over the level-0 voxels it
/// covers, NaN left out, and the mean of their magnitudes; NaN where there is none.
pub fn naive_means(voxels: &Voxels, size: Size3, level: Level) -> Vec<(f64, f64)> {
    let parts = if voxels.format() == VoxelFormat::Rgba8 { 4 } else { 1 };
    let part = |index: usize, part: usize| match voxels {
        Voxels::Rgba8(v) => f64::from(v[index][part]),
        _ => f64::from(voxels.value(index)),
    };
    let mut means = Vec::new();
    let range = |at: u32, axis: usize| {
        let scale = level.scale[axis];
        at * scale..((at + 1) * scale).min(size.to_array()[axis])
    };
    for z in 0..level.size.z {
        for y in 0..level.size.y {
            for x in 0..level.size.x {
                for p in 0..parts {
                    let (mut sum, mut magnitude, mut count) = (0.0, 0.0, 0.0);
                    for k in range(z, 2) {
                        for j in range(y, 1) {
                            for i in range(x, 0) {
                                let value = part(size.index(i, j, k), p);
                                if !value.is_nan() {
                                    sum += value;
                                    magnitude += value.abs();
                                    count += 1.0;
                                }
                            }
                        }
                    }
                    // 0 / 0 is NaN.
                    means.push((sum / count, magnitude / count));
                }
            }
        }
    }
    means
}
