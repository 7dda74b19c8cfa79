//! Small volumes of several channels with all their levels, and bricks cut from them.

use ashfall::twins::octree_shape::{Shape, Wanted};
use ashfall::volume::{BrickGrid, Levels, Size3, ValueRange, VoxelFormat, Voxels};

use crate::random::Random;

/// What a volume is made of.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    pub size: [u32; 3],
    pub spacing: [f64; 3],
    pub payload: [u32; 3],
    pub leaf: [u32; 3],
    pub format: VoxelFormat,
    /// Least and greatest level of every channel.
    pub channels: &'static [[usize; 2]],
}

const ALL: [usize; 2] = [0, 31];

/// Plain, thin, long, of odd bricks, of spacings that differ; leaves from a whole brick to an eighth.
pub const PLANS: &[Plan] = &[
    Plan {
        size: [26, 19, 17],
        spacing: [1.0; 3],
        payload: [8; 3],
        leaf: [2; 3],
        format: VoxelFormat::U8,
        channels: &[ALL, ALL],
    },
    Plan {
        size: [64, 64, 4],
        spacing: [1.0; 3],
        payload: [16; 3],
        leaf: [8, 8, 4],
        format: VoxelFormat::U16,
        channels: &[ALL, [1, 1], [0, 0]],
    },
    Plan {
        size: [1, 1, 5000],
        spacing: [1.0, 1.0, 0.1],
        payload: [32; 3],
        leaf: [4; 3],
        format: VoxelFormat::F32,
        channels: &[ALL],
    },
    Plan {
        size: [48, 40, 14],
        spacing: [1.0, 1.0, 4.0],
        payload: [8; 3],
        leaf: [4; 3],
        format: VoxelFormat::I16,
        channels: &[[1, 2], ALL],
    },
    Plan {
        size: [37, 22, 26],
        spacing: [0.7, 1.0, 1.3],
        payload: [12, 7, 5],
        leaf: [3, 4, 4],
        format: VoxelFormat::U16,
        channels: &[ALL; 4],
    },
    Plan {
        size: [30, 31, 32],
        spacing: [1.0; 3],
        payload: [4; 3],
        leaf: [4; 3],
        format: VoxelFormat::F32,
        channels: &[ALL, [2, 31]],
    },
];

impl Plan {
    pub fn levels(&self) -> Levels {
        Levels::of(Size3::from_array(self.size), self.spacing, Size3::from_array(self.payload))
    }

    pub fn shape(&self, fan_out: u32) -> Shape {
        let wanted = Wanted { leaf: self.leaf, fan_out, nodes_max: u64::MAX };
        Shape::new(&self.levels(), Size3::from_array(self.payload), &wanted).expect("few nodes")
    }
}

/// The voxels of one level of one channel; integers stand in f32 exactly.
pub struct Level {
    pub size: [u32; 3],
    pub values: Vec<f32>,
}

impl Level {
    /// Voxels outside repeat the nearest one inside.
    pub fn at(&self, voxel: [i64; 3]) -> f32 {
        let inside = |axis: usize| voxel[axis].clamp(0, i64::from(self.size[axis]) - 1) as usize;
        let [nx, ny] = [self.size[0] as usize, self.size[1] as usize];
        self.values[(inside(2) * ny + inside(1)) * nx + inside(0)]
    }

    /// Of a half-open box; whether all its voxels are equal, too.
    pub fn range(&self, start: [i64; 3], end: [i64; 3]) -> (ValueRange, bool) {
        let (mut range, mut equal) = (ValueRange::EMPTY, true);
        let first = self.at(start);
        for z in start[2]..end[2] {
            for y in start[1]..end[1] {
                for x in start[0]..end[0] {
                    let value = self.at([x, y, z]);
                    range = range.with(value);
                    equal &= value == first;
                }
            }
        }
        (range, equal)
    }
}

/// Sources of channels: one more than are shown, so that one can take another's place.
pub struct World {
    pub plan: Plan,
    /// By source and level.
    pub sources: Vec<Vec<Level>>,
}

impl World {
    pub fn new(plan: Plan, seed: u64) -> World {
        let mut random = Random(seed);
        let sources = (0..=plan.channels.len()).map(|_| source(&plan, &mut random)).collect();
        World { plan, sources }
    }

    /// A brick's voxels, apron included, as a loader would hand them over.
    pub fn brick(&self, source: usize, level: usize, brick: [u32; 3]) -> (Voxels, Size3) {
        let of = &self.sources[source][level];
        let grid = BrickGrid {
            size: Size3::from_array(of.size),
            payload: Size3::from_array(self.plan.payload),
        };
        let payload = grid.payload_box(brick);
        let size = grid.stored_size(brick);
        let mut values = Vec::new();
        let along =
            |axis: usize| i64::from(payload.start[axis]) - 1..i64::from(payload.end[axis]) + 1;
        for z in along(2) {
            for y in along(1) {
                values.extend(along(0).map(|x| of.at([x, y, z])));
            }
        }
        let voxels = match self.plan.format {
            VoxelFormat::U8 => Voxels::U8(values.iter().map(|v| *v as u8).collect()),
            VoxelFormat::U16 => Voxels::U16(values.iter().map(|v| *v as u16).collect()),
            VoxelFormat::I16 => Voxels::I16(values.iter().map(|v| *v as i16).collect()),
            _ => Voxels::F32(values),
        };
        (voxels, size)
    }
}

/// Least and greatest stored value, and whether they are whole.
pub fn extent(format: VoxelFormat) -> (f32, f32, bool) {
    match format {
        VoxelFormat::U8 => (0.0, 255.0, true),
        VoxelFormat::U16 => (0.0, 65535.0, true),
        VoxelFormat::I16 => (-32768.0, 32767.0, true),
        _ => (-3.0, 7.0, false),
    }
}

/// Blobs in a constant, with a patch of noise and, in floats, a hole.
fn source(plan: &Plan, random: &mut Random) -> Vec<Level> {
    let (least, greatest, whole) = extent(plan.format);
    let scale = plan.size.map(f64::from);
    let blob = |random: &mut Random| {
        let centre: [f64; 3] = std::array::from_fn(|axis| random.unit() * scale[axis]);
        (centre, random.between(0.05, 0.15), random.unit())
    };
    let blobs: Vec<_> = (0..5).map(|_| blob(random)).collect();
    let (hole, hole_radius, _) = blob(random);
    let noise_from = random.unit() * 0.8;
    let away = |at: [u32; 3], centre: [f64; 3]| -> f64 {
        let part = |axis: usize| (f64::from(at[axis]) - centre[axis]) / scale[axis];
        (0..3).map(|axis| part(axis).powi(2)).sum::<f64>().sqrt()
    };
    let mut values = Vec::new();
    for z in 0..plan.size[2] {
        for y in 0..plan.size[1] {
            for x in 0..plan.size[0] {
                let at = [x, y, z];
                let mut unit = 0.0;
                for (centre, radius, height) in &blobs {
                    unit += height * (1.0 - away(at, *centre) / radius).max(0.0);
                }
                let along = f64::from(x + y + z) / (scale[0] + scale[1] + scale[2]);
                if (noise_from..noise_from + 0.05).contains(&along) {
                    unit += 0.3 * random.unit();
                }
                let value = f64::from(least) + unit.min(1.0) * f64::from(greatest - least);
                let hollow = !whole && away(at, hole) < 0.5 * hole_radius;
                values.push(match hollow {
                    true => f32::NAN,
                    false if whole => value.round() as f32,
                    false => value as f32,
                });
            }
        }
    }
    let finest = Level { size: plan.size, values };
    let coarser: Vec<Level> =
        plan.levels().iter().skip(1).map(|level| mean(&finest, level, whole)).collect();
    std::iter::once(finest).chain(coarser).collect()
}

/// Means over the voxels that a coarser one covers, NaN left out.
fn mean(finest: &Level, level: ashfall::volume::Level, whole: bool) -> Level {
    let size = level.size.to_array();
    let mut values = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let at = [x, y, z];
                let span = |axis: usize| {
                    let start = at[axis] * level.scale[axis];
                    start..(start + level.scale[axis]).min(finest.size[axis])
                };
                let (mut sum, mut count) = (0.0, 0u32);
                for k in span(2) {
                    for j in span(1) {
                        for i in span(0) {
                            let value = finest.at([i, j, k].map(i64::from));
                            if !value.is_nan() {
                                sum += f64::from(value);
                                count += 1;
                            }
                        }
                    }
                }
                let mean = sum / f64::from(count);
                values.push(if whole { mean.round() as f32 } else { mean as f32 });
            }
        }
    }
    Level { size, values }
}
