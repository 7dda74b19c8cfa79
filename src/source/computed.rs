//! Computed volumes by name.
//!
//! | kind | voxels | value |
//! |---|---|---|
//! | `constant` | f32 | 1 everywhere |
//! | `ramp` | f32 | along x: 0 in the first voxel, 1 in the last; 0 when there is one alone |
//! | `shells` | u8 | 255 on seven spheres around the middle, falling to 0 within 1/64 of the radius |
//! | `checkerboard` | u8 | 0 where the voxel's x + y + z is even, else 1 |
//! | `marschner-lobb` | f32 | the test signal of Marschner and Lobb 1994, f = 6, alpha = 0.25 |
//! | `hydrogen` | u8 | probability density of hydrogen's 3d orbital with m = 0 |
//! | `mandelbulb` | u8 | how long a point's orbit stays small, power 8 |
//!
//! # Units
//! `shells` and `marschner-lobb` fill the cube [-1, 1]^3, `hydrogen` [-24, 24]^3 Bohr radii,
//! `mandelbulb` [-1.2, 1.2]^3, at any size: values are those at the voxels' centres.
//!
//! # Invariants
//! A voxel's value depends on nothing but kind, size and voxel: boxes may be filled in any order.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::source::{formula, mandelbulb};
use crate::volume::WorldFromVoxel;
use crate::volume::{ChannelVoxels, Size3, ValueRange, VolumeVoxels, VoxelFormat, Voxels};

/// The known kinds, as named in scenes.
pub const KINDS: [&str; 7] =
    ["constant", "ramp", "shells", "checkerboard", "marschner-lobb", "hydrogen", "mandelbulb"];

/// A volume of one channel given by a formula.
#[derive(Clone, Debug, PartialEq)]
pub struct Computed {
    kind: Kind,
    size: Size3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Constant,
    Ramp,
    Shells,
    Checkerboard,
    MarschnerLobb,
    Hydrogen,
    Mandelbulb,
}

/// The computed volume of that kind and size.
///
/// # Errors
/// When the kind is unknown or the size has no voxel.
pub fn computed(kind: &str, size: Size3) -> Result<Computed> {
    let known = match kind {
        "constant" => Kind::Constant,
        "ramp" => Kind::Ramp,
        "shells" => Kind::Shells,
        "checkerboard" => Kind::Checkerboard,
        "marschner-lobb" => Kind::MarschnerLobb,
        "hydrogen" => Kind::Hydrogen,
        "mandelbulb" => Kind::Mandelbulb,
        _ => {
            return Err(Error::input(format!(
                "computed volume \"{kind}\" is not known: use one of {}",
                KINDS.join(", ")
            )));
        }
    };
    if size.is_empty() {
        return Err(Error::input(format!(
            "computed volume \"{kind}\" needs at least one voxel along each axis, got {size}"
        )));
    }
    Ok(Computed { kind: known, size })
}

impl Computed {
    /// The kind, as named in scenes.
    pub fn name(&self) -> &'static str {
        KINDS[self.kind as usize]
    }

    /// Voxels along each axis.
    pub fn size(&self) -> Size3 {
        self.size
    }

    /// How a voxel is stored.
    pub fn format(&self) -> VoxelFormat {
        match self.kind {
            Kind::Constant | Kind::Ramp | Kind::MarschnerLobb => VoxelFormat::F32,
            _ => VoxelFormat::U8,
        }
    }

    /// The value of one voxel.
    pub fn value(&self, x: u32, y: u32, z: u32) -> f32 {
        let voxel = [x, y, z];
        match self.kind {
            Kind::Constant => 1.0,
            Kind::Ramp => formula::ramp(x, self.size.x),
            Kind::Shells => f32::from(formula::shells(self.radius(voxel))),
            Kind::Checkerboard => ((x ^ y ^ z) & 1) as f32,
            Kind::MarschnerLobb => formula::marschner_lobb(self.position(voxel)) as f32,
            Kind::Hydrogen => f32::from(formula::hydrogen(self.position(voxel))),
            Kind::Mandelbulb => f32::from(mandelbulb::value(self.position(voxel))),
        }
    }

    /// The voxels from `start` on, x fastest.
    ///
    /// # Panics
    /// When the box reaches beyond the volume: our own bug.
    pub fn fill(&self, start: [u32; 3], size: Size3) -> Voxels {
        self.assert_inside(start, size);
        let voxels = || {
            let [xs, ys, zs] = ranges(start, size);
            zs.flat_map(move |z| {
                let xs = xs.clone();
                ys.clone().flat_map(move |y| xs.clone().map(move |x| self.value(x, y, z)))
            })
        };
        match self.format() {
            VoxelFormat::F32 => Voxels::F32(voxels().collect()),
            _ => Voxels::U8(voxels().map(|value| value as u8).collect()),
        }
    }

    /// A range that holds every value of a box, found without computing its voxels. It is exact for
    /// `constant`, `ramp` and `checkerboard`, and may be too wide for the others.
    ///
    /// # Panics
    /// When the box is empty or reaches beyond the volume: our own bug.
    pub fn bounds(&self, start: [u32; 3], size: Size3) -> ValueRange {
        assert!(!size.is_empty(), "bounds of no voxel");
        self.assert_inside(start, size);
        let last = std::array::from_fn(|axis| start[axis] + (size.to_array()[axis] - 1));
        let corners = [self.position(start), self.position(last)];
        match self.kind {
            Kind::Constant => ValueRange::of(1.0),
            Kind::Ramp => ValueRange {
                least: formula::ramp(start[0], self.size.x),
                greatest: formula::ramp(last[0], self.size.x),
            },
            Kind::Shells => formula::shells_bounds(formula::radius_range(corners)),
            Kind::Checkerboard if size == Size3::cube(1) => {
                ValueRange::of(self.value(start[0], start[1], start[2]))
            }
            Kind::Checkerboard => ValueRange { least: 0.0, greatest: 1.0 },
            Kind::MarschnerLobb => formula::marschner_lobb_bounds(corners),
            Kind::Hydrogen => formula::hydrogen_bounds(corners),
            Kind::Mandelbulb => mandelbulb::bounds(corners),
        }
    }

    /// All voxels, computed by all threads of the machine.
    ///
    /// # Errors
    /// When they do not fit in memory.
    pub fn whole(&self, world_from_voxel: WorldFromVoxel) -> Result<VolumeVoxels> {
        let voxels = match self.format() {
            VoxelFormat::F32 => Voxels::F32(self.all(|value| value)?),
            _ => Voxels::U8(self.all(|value| value as u8)?),
        };
        let channels = vec![ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 }];
        Ok(VolumeVoxels { size: self.size, world_from_voxel, channels })
    }

    fn all<T: Copy + Default + Send>(&self, stored: fn(f32) -> T) -> Result<Vec<T>> {
        let refuse = || {
            let bytes = self.size.voxel_count() * self.format().bytes() as u128;
            Error::machine(format!(
                "computed volume \"{}\" of {} voxels needs {bytes} bytes of memory, which this \
                 machine does not give: use a smaller size",
                self.name(),
                self.size
            ))
        };
        let len = self.size.len().ok_or_else(refuse)?;
        let mut voxels = Vec::new();
        voxels.try_reserve_exact(len).map_err(|_| refuse())?;
        voxels.resize(len, T::default());
        let row_len = self.size.x as usize;
        voxels.par_chunks_mut(row_len).enumerate().for_each(|(row, voxels)| {
            let (y, z) = (row % self.size.y as usize, row / self.size.y as usize);
            for (x, voxel) in voxels.iter_mut().enumerate() {
                *voxel = stored(self.value(x as u32, y as u32, z as u32));
            }
        });
        Ok(voxels)
    }

    fn assert_inside(&self, start: [u32; 3], size: Size3) {
        let (size, whole) = (size.to_array(), self.size.to_array());
        let inside = (0..3).all(|a| start[a] <= whole[a] && size[a] <= whole[a] - start[a]);
        assert!(inside, "box at {start:?} of {size:?} voxels in a volume of {}", self.size);
    }

    /// Centre of a voxel in the kind's own cube.
    fn position(&self, voxel: [u32; 3]) -> [f64; 3] {
        let half = match self.kind {
            Kind::Hydrogen => formula::HYDROGEN_HALF_BOHR,
            Kind::Mandelbulb => mandelbulb::HALF,
            _ => 1.0,
        };
        let size = self.size.to_array();
        // Mirrored voxels have mirrored positions to the last bit.
        let place = |axis: usize| {
            let centred = 2.0 * f64::from(voxel[axis]) + 1.0 - f64::from(size[axis]);
            half * centred / f64::from(size[axis])
        };
        [place(0), place(1), place(2)]
    }

    fn radius(&self, voxel: [u32; 3]) -> f64 {
        formula::radius(self.position(voxel))
    }
}

fn ranges(start: [u32; 3], size: Size3) -> [std::ops::Range<u32>; 3] {
    let size = size.to_array();
    std::array::from_fn(|axis| start[axis]..start[axis] + size[axis])
}
