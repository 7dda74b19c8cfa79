//! Scenes at the edges of what numbers allow, as plain data, and what must hold of their pictures.
//!
//! Of every case, with every integrator, drawn directly and through bricks: no component is NaN or
//! infinite, alpha lies within 0 and 1, the error against the reference keeps the case's bound, so does
//! the change when the step is halved, more extinction never lets more through, and neither atlas nor
//! bricks nor (where the case says so) levels matter.
//!
//! # Units
//! Errors are absolute, but in parts of the brightest component of a picture that is nearly black: a haze
//! of 1e-12 has digits too.

mod cameras;
mod fields;
mod measure;
mod places;
pub mod suite;
mod transfers;
mod values;

use std::path::Path;
use std::sync::Arc;

use crate::error::Result;
use crate::import::DenseVolume;
use crate::reference;
use crate::render::{SceneData, VolumeData};
use crate::scene::{Overrides, Scene};
use crate::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel};

pub use measure::{Outcome, measure};
pub use places::survey;

/// How a case's camera maps pixels to rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Perspective, the vertical angle.
    Degrees(f64),
    /// Parallel rays, the picture's height in world units.
    Height(f64),
}

/// One scene and what must hold of it.
#[derive(Clone, Debug)]
pub struct Case {
    /// Unique.
    pub name: &'static str,
    /// The whole volume, of one channel.
    pub voxels: Arc<VolumeVoxels>,
    /// Values that map to 0 and 1.
    pub window: [f64; 2],
    /// Place, linear rgb and extinction per world unit of each point.
    pub transfer: Vec<(f64, [f64; 3], f64)>,
    /// Where the camera is.
    pub eye: [f64; 3],
    /// Where it looks.
    pub target: [f64; 3],
    /// What is upwards.
    pub up: [f64; 3],
    /// How it sees.
    pub lens: Lens,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Sample distance in smallest voxel edges.
    pub step: f64,
    /// Greatest error of a component, of an integrator that promises nothing by itself.
    pub bound: f64,
    /// Another bound, for spans between samples.
    pub spans: Option<f64>,
    /// Why the bound is what it is.
    pub reason: &'static str,
    /// Alpha of every pixel by a closed form.
    pub alpha: Option<f64>,
    /// Whether nothing is to be seen; else something must be.
    pub dark: bool,
    /// Whether every level shows the same, and no level change may be seen.
    pub any_level: bool,
}

/// Cases of one kind.
pub struct Theme {
    /// What they have in common.
    pub name: &'static str,
    /// Of the theme.
    pub cases: Vec<Case>,
}

/// All cases there are.
pub fn themes() -> Vec<Theme> {
    vec![
        Theme { name: "fields", cases: fields::cases() },
        Theme { name: "transfers", cases: transfers::cases() },
        Theme { name: "values", cases: values::cases() },
        Theme { name: "places", cases: places::cases() },
        Theme { name: "cameras", cases: cameras::cases() },
    ]
}

/// The integrators of DESIGN that scenes may name today.
pub fn integrators() -> Vec<&'static str> {
    let known = |name: &&str| {
        let overrides = Overrides { integrator: Some((*name).to_owned()), ..Overrides::default() };
        Scene::from_toml(SMALLEST, Path::new("smallest.toml"), &overrides).is_ok()
    };
    ["riemann", "preintegrated", "adaptive"].into_iter().filter(known).collect()
}

const SMALLEST: &str = "format = 1
[[volume]]
source = { computed = \"ramp\", size = [2, 2, 2] }
[[volume.channel]]
window = [0.0, 1.0]
transfer = [{ at = 0.0, color = [1.0, 1.0, 1.0], extinction = 1.0 }]
[[view]]
eye = [0.0, 0.0, 0.0]
target = [1.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]
fov_degrees = 40.0
";

impl Case {
    /// A case to change: all of the volume from a corner, in perspective, with a colourful ramp.
    fn of(name: &'static str, voxels: VolumeVoxels) -> Case {
        let case = Case {
            name,
            voxels: Arc::new(voxels),
            window: [0.0, 1.0],
            transfer: Vec::new(),
            eye: [0.0; 3],
            target: [0.0; 3],
            up: [0.1, 0.2, 1.0],
            lens: Lens::Degrees(30.0),
            size: [24, 20],
            step: 0.5,
            bound: 0.0,
            spans: None,
            reason: "",
            alpha: None,
            dark: false,
            any_level: false,
        };
        let edge = case.diagonal_world() / 1.75;
        let ramp = vec![(0.0, [0.1, 0.3, 0.9], 0.2 / edge), (1.0, [1.0, 0.8, 0.3], 3.0 / edge)];
        Case { transfer: ramp, ..case }.from([0.7, -0.5, 0.4])
    }

    fn diagonal_world(&self) -> f64 {
        let map = &self.voxels.world_from_voxel;
        let size = self.voxels.size.to_array().map(f64::from);
        map.vector(size.into()).length()
    }

    /// Looks at the volume's middle from 1.6 diagonals away.
    fn from(self, direction: [f64; 3]) -> Case {
        let size = glam::DVec3::from_array(self.voxels.size.to_array().map(f64::from));
        let middle = self.voxels.world_from_voxel.point(0.5 * size);
        let away = glam::DVec3::from_array(direction).normalize() * 1.6 * self.diagonal_world();
        Case { eye: (middle + away).to_array(), target: middle.to_array(), ..self }
    }

    fn dark(self) -> Case {
        Case { dark: true, ..self.within(0.0, "nothing is nothing") }
    }

    /// Whether an integrator can draw it: what works to a tolerance needs the volume in one image.
    pub fn is_drawn_by(&self, integrator: &str) -> bool {
        integrator != "adaptive" || self.voxels.size.to_array().iter().all(|edge| *edge <= 2046)
    }

    fn spans_fit_bricks(&self) -> bool {
        let map = &self.voxels.world_from_voxel;
        2.0 * self.step * map.smallest_edge() * map.voxels_per_world_max() < 1.01
    }

    fn within(self, bound: f64, reason: &'static str) -> Case {
        Case { bound, reason, ..self }
    }

    /// The scene in bricks of `payload`; extinctions are multiplied by `thicker`.
    ///
    /// # Errors
    /// When the scene is refused, which no case's is.
    pub fn data(&self, payload: u32, thicker: f64, overrides: &Overrides) -> Result<SceneData> {
        let scene = self.scene(thicker, overrides)?;
        let dense = DenseVolume::new(self.name, self.voxels.clone(), Size3::cube(payload));
        let whole = dense.voxels().clone();
        SceneData::new(scene, vec![VolumeData::of_whole(Arc::new(dense), whole)])
    }

    fn scene(&self, thicker: f64, overrides: &Overrides) -> Result<Scene> {
        let points: String = self
            .transfer
            .iter()
            .map(|(at, color, extinction)| {
                let extinction = extinction * thicker;
                format!("  {{ at = {at:?}, color = {color:?}, extinction = {extinction:?} }},\n")
            })
            .collect();
        let lens = match self.lens {
            Lens::Degrees(degrees) => format!("fov_degrees = {degrees:?}"),
            Lens::Height(height) => format!("height = {height:?}"),
        };
        let text = format!(
            "format = 1\n[[volume]]\nsource = \"made.bricks\"\n[[volume.channel]]\nwindow = {:?}\n\
             transfer = [\n{points}]\n[[view]]\neye = {:?}\ntarget = {:?}\nup = {:?}\n{lens}\n",
            self.window, self.eye, self.target, self.up
        );
        Scene::from_toml(&text, Path::new("made.toml"), overrides)
    }

    /// The true picture.
    ///
    /// # Errors
    /// As [`Case::data`].
    pub fn truth(&self) -> Result<Vec<[f64; 4]>> {
        let scene = self.scene(1.0, &Overrides::default())?;
        let settings = reference::Settings { tolerance: 1e-9, threads: 2 };
        let volumes = [(&scene.volumes[0], &*self.voxels)];
        let view = &scene.views[0];
        Ok(reference::render(view, self.size, [0.0; 3], &volumes, &settings, &|_| {}).rgba)
    }
}

/// A volume of f32 voxels of a function of the voxel.
fn made(size: [u32; 3], rows: [[f64; 4]; 3], value: impl Fn([u32; 3]) -> f32) -> VolumeVoxels {
    let [width, height, depth] = size;
    let lines = (0..depth).flat_map(|z| (0..height).map(move |y| (y, z)));
    let voxels = lines.flat_map(|(y, z)| (0..width).map(move |x| [x, y, z]));
    whole(size, rows, Voxels::F32(voxels.map(value).collect()))
}

fn whole(size: [u32; 3], rows: [[f64; 4]; 3], voxels: Voxels) -> VolumeVoxels {
    VolumeVoxels {
        size: Size3::from_array(size),
        world_from_voxel: WorldFromVoxel::from_rows(rows).expect("cases have good transforms"),
        channels: vec![ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 }],
    }
}

/// Rows of a transform along the axes, from the origin.
fn spaced([x, y, z]: [f64; 3]) -> [[f64; 4]; 3] {
    [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]]
}

/// A number within 0 and 1 for each voxel, always the same.
fn noise([x, y, z]: [u32; 3]) -> f32 {
    let mut hash =
        x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ z.wrapping_mul(0xc2b2_ae3d);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
    hash = (hash ^ (hash >> 12)).wrapping_mul(0x297a_2d39);
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// A smooth hill, 1 in the middle of a cube of `edge` voxels and 0 at its corners.
fn hill([x, y, z]: [u32; 3], edge: u32) -> f32 {
    let from_middle = |at: u32| (2.0 * f64::from(at) + 1.0) / f64::from(edge) - 1.0;
    let square: f64 = [x, y, z].into_iter().map(|at| from_middle(at).powi(2)).sum();
    (1.0 - square / 3.0) as f32
}
