//! The scene: what to draw, from where, how well. Checked once, into types that cannot be wrong.
//!
//! [`Scene::load`] reads a TOML file; [`Overrides`] are command-line flags that win over it. Every
//! refusal names the place (file, line and column, or the flag), the thing and the remedy.

mod camera_path;
mod check;
mod check_channel;
mod color_map;
mod file;
mod overrides;
mod place;
mod stereo;
mod transfer;
mod view;
mod wall;
mod written;

use std::path::PathBuf;

use crate::error::Error;
use crate::volume::{RawLayout, Size3, WorldFromVoxel};

pub use camera_path::CameraPath;
pub use color_map::ColorMap;
pub use overrides::Overrides;
pub use place::Place;
pub use stereo::Stereo;
pub use transfer::{TransferFunction, TransferPoint};
pub use view::{Part, Projection, RayFrame, View};
pub use wall::{Screen, Wall};

/// Whether a name may become part of a file's: letters, digits, blanks, - and _, and not blanks alone.
pub(crate) fn names_files(name: &str) -> bool {
    let plain = |c: char| c.is_alphanumeric() || "-_ ".contains(c);
    !name.trim().is_empty() && name.chars().all(plain)
}

/// All that a picture depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Size and background.
    pub picture: Picture,
    /// How well the integral is approximated.
    pub quality: Quality,
    /// Limits on memory.
    pub memory: Memory,
    /// At least one.
    pub volumes: Vec<Volume>,
    /// At least one.
    pub views: Vec<View>,
    /// A camera's way through them.
    pub path: Option<CameraPath>,
}

/// `[picture]`
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Linear colour behind everything.
    pub background: [f32; 3],
}

/// `[quality]`
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// The quadrature along a ray.
    pub integrator: Integrator,
    /// Sample distance, in smallest voxel edges of the level in use.
    pub step: f64,
    /// How values between voxels are found.
    pub filter: Filter,
    /// What a ray does at a missing brick.
    pub refine: Refine,
    /// Coarsest level allowed; nothing: chosen by the pixel's footprint.
    pub level_max: Option<u8>,
    /// What drawing a channel coarser may lose: root mean square, over any brick, of extinction and of
    /// extinction times colour, as a part of their greatest. Nothing: a channel is drawn at the level
    /// that rays are in.
    pub level_loss: Option<f64>,
    /// A ray ends when less than this is transmitted; 0: never.
    pub early_stop: f64,
    /// Greatest error of a component of a pixel, for the integrator that works to one.
    pub tolerance: f64,
}

impl Quality {
    /// Beneath it f32 does not tell pictures apart.
    pub(crate) const TOLERANCE_LEAST: f64 = 1e-6;
    /// A quarter of a step of an 8-bit picture.
    pub(crate) const TOLERANCE_DEFAULT: f64 = 0.001;

    /// Greatest length of a sample of a ray, in smallest voxel edges of the level in use: one step, or two
    /// where a sample is integrated as two spans; these a little less, so that at step 0.5 both ends of a
    /// sample whose middle is in a brick are less than half a voxel outside and can be had from its slot.
    pub fn sample_edges(&self) -> f64 {
        match self.integrator {
            Integrator::Riemann | Integrator::Adaptive => self.step,
            Integrator::Preintegrated => 2.0 * self.step * (63.0 / 64.0),
        }
    }

    /// A ray ends when less than this is transmitted; 0: never. Where there is a tolerance, a quarter of it.
    pub fn ray_end(&self) -> f64 {
        match self.integrator.has_tolerance() && self.early_stop > 0.0 {
            true => 0.25 * self.tolerance,
            false => self.early_stop,
        }
    }
}

/// The quadrature along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Midpoint rule.
    Riemann,
    /// Spans on which the value is taken as linear, its curvature corrected: every piece of the transfer
    /// function that is crossed counts, however narrow.
    Preintegrated,
    /// Midpoint rule over steps that ranges of stored values and what stands before them allow.
    Adaptive,
}

impl Integrator {
    /// All of them.
    pub const ALL: [Integrator; 3] =
        [Integrator::Riemann, Integrator::Preintegrated, Integrator::Adaptive];

    /// As scenes and `--integrator` name it.
    pub const fn name(self) -> &'static str {
        match self {
            Integrator::Riemann => "riemann",
            Integrator::Preintegrated => "preintegrated",
            Integrator::Adaptive => "adaptive",
        }
    }

    /// Whether it works to a tolerance, which a study then sweeps in place of the step.
    pub const fn has_tolerance(self) -> bool {
        match self {
            Integrator::Riemann | Integrator::Preintegrated => false,
            Integrator::Adaptive => true,
        }
    }
}

/// How values between voxels are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Trilinear within 1e-6 of the value range.
    Exact,
    /// Whatever the sampler gives.
    Hardware,
}

/// What a ray does at a missing brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refine {
    /// Waits for it.
    Exact,
    /// Takes the best resident level.
    Substitute,
}

/// `[memory]`
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// Hard limit on GPU bytes for voxels.
    pub atlas_mib: u64,
    /// Limit on host bytes for cached bricks.
    pub ram_mib: u64,
    /// Bytes of both staging halves together.
    pub staging_mib: u64,
}

/// `[[volume]]`
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Unique in the scene.
    pub name: String,
    /// Where the voxels come from.
    pub source: Source,
    /// Voxel (corner origin) to world; nothing: the file's own.
    pub world_from_voxel: Option<WorldFromVoxel>,
    /// At least one.
    pub channels: Vec<Channel>,
    /// Where the scene names the source, for messages about it.
    pub place: Place,
}

impl Filter {
    /// The word in scenes and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Filter::Exact => "exact",
            Filter::Hardware => "hardware",
        }
    }
}

impl Volume {
    /// Puts the volume's place and name before a sentence.
    pub fn at(&self, why: Error) -> Error {
        why.at(format_args!("{}: volume \"{}\"", self.place, self.name))
    }
}

/// Where voxels come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A file that import knows.
    File {
        /// Absolute, or relative to the working folder.
        path: PathBuf,
        /// For raw files: what they do not say themselves.
        raw: Option<RawLayout>,
    },
    /// A formula.
    Computed {
        /// Its name, see `source::computed`.
        kind: String,
        /// Voxels along each axis.
        size: Size3,
    },
}

/// Most samples of a ray that one of a channel may stand for.
pub const SAMPLE_EVERY_MAX: u32 = 16;

/// `[[volume.channel]]`
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Number of the channel in the file.
    pub index: u32,
    /// Scaled values that map to 0 and 1.
    pub window: [f64; 2],
    /// Colour and extinction of a windowed value.
    pub transfer: TransferFunction,
    /// Finest level at which it is drawn; needs refine "substitute" where it is above 0.
    pub level_min: u8,
    /// Coarsest level at which it is drawn; nothing: as the pixel's footprint says.
    pub level_max: Option<u8>,
    /// Of how many samples of a ray it takes one, which stands for all of them: a power of two up to
    /// [`SAMPLE_EVERY_MAX`].
    pub sample_every: u32,
}
