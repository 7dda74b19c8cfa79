//! Scenes that benches draw: volumes made in memory, no files, at any size.
//!
//! Voxels are made once and cut into bricks in memory, so that what is measured is not the formula.

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::Result;
use crate::import::DenseVolume;
use crate::render::{SceneData, VolumeData};
use crate::scene::{Overrides, Scene};
use crate::source::computed;
use crate::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel};

/// Everything visible and nothing opaque: no ray ends early and no brick is hidden.
const DENSE: &str = "[
  { at = 0.0, color = [0.2, 0.3, 0.6], extinction = 0.4 },
  { at = 0.4, color = [0.3, 0.6, 0.4], extinction = 1.2 },
  { at = 1.0, color = [0.9, 0.8, 0.7], extinction = 2.0 },
]";
/// Zero shows nothing.
const SPARSE: &str = "[
  { at = 0.0, color = [0.2, 0.3, 0.6], extinction = 0.0 },
  { at = 0.1, color = [0.3, 0.6, 0.4], extinction = 0.0 },
  { at = 1.0, color = [0.9, 0.8, 0.7], extinction = 20.0 },
]";
/// A cloud whose densest parts stop rays.
const CLOUD: &str = "[
  { at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 },
  { at = 0.3, color = [0.2, 0.7, 0.4], extinction = 0.5 },
  { at = 0.6, color = [0.9, 0.6, 0.2], extinction = 6.0 },
  { at = 1.0, color = [1.0, 0.9, 0.8], extinction = 12.0 },
]";

/// A test signal in 8 bits, of which everything is seen and nothing hides anything.
///
/// # Errors
/// When this machine has no memory for it.
pub fn dense(edge: u32, payload: u32, overrides: &Overrides) -> Result<SceneData> {
    in_memory("dense", edge, payload, vec![marschner_lobb(edge)?], &[DENSE], overrides)
}

/// A thin wire wound around an axis; most bricks hold nothing of it.
///
/// # Errors
/// When this machine has no memory for it.
pub fn sparse(edge: u32, payload: u32, overrides: &Overrides) -> Result<SceneData> {
    in_memory("sparse", edge, payload, vec![wire(edge)], &[SPARSE], overrides)
}

/// A computed volume of u8 voxels, as a cloud.
///
/// # Errors
/// When the kind is not known.
pub fn cloud(kind: &str, edge: u32, payload: u32, overrides: &Overrides) -> Result<SceneData> {
    let voxels = computed(kind, Size3::cube(edge))?.fill([0; 3], Size3::cube(edge));
    in_memory(kind, edge, payload, vec![voxels], &[CLOUD], overrides)
}

/// Four channels in one place: the mandelbulb, shells, hydrogen, and the test signal.
///
/// # Errors
/// When this machine has no memory for it.
pub fn four_channels(edge: u32, payload: u32, overrides: &Overrides) -> Result<SceneData> {
    let size = Size3::cube(edge);
    let mut channels = vec![marschner_lobb(edge)?];
    for kind in ["mandelbulb", "shells", "hydrogen"] {
        channels.push(computed(kind, size)?.fill([0; 3], size));
    }
    let looks = [DENSE, CLOUD, CLOUD, CLOUD];
    in_memory("4 channels", edge, payload, channels, &looks, overrides)
}

/// Channels of `edge` voxels cubed in the unit cube, seen from a corner, at level 0.
fn in_memory(
    name: &str,
    edge: u32,
    payload: u32,
    channels: Vec<Voxels>,
    looks: &[&str],
    overrides: &Overrides,
) -> Result<SceneData> {
    let mut text = format!(
        "{HEAD}[[volume]]\nname = \"{name}\"\nsource = \"in memory\"\nspacing = [{spacing}, {spacing}, {spacing}]\n",
        spacing = 1.0 / f64::from(edge)
    );
    for look in looks {
        text += &format!("[[volume.channel]]\nwindow = [0.0, 255.0]\ntransfer = {look}\n");
    }
    let scene = Scene::from_toml(&text, "bench".as_ref(), overrides)?;
    let world_from_voxel = WorldFromVoxel::from_spacing([1.0 / f64::from(edge); 3])?;
    let of_channel = |voxels| ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 };
    let channels = channels.into_iter().map(of_channel).collect();
    let volume = VolumeVoxels { size: Size3::cube(edge), world_from_voxel, channels };
    let dense = DenseVolume::new(name, Arc::new(volume), Size3::cube(payload));
    let whole = dense.voxels().clone();
    SceneData::new(scene, vec![VolumeData::of_whole(Arc::new(dense), whole)])
}

const HEAD: &str = r#"
format = 1
[quality]
level_max = 0
[memory]
atlas_mib = 8192
ram_mib = 4096
[[view]]
name = "corner"
eye = [1.8, -0.6, 1.4]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 36.0
"#;

fn marschner_lobb(edge: u32) -> Result<Voxels> {
    let size = Size3::cube(edge);
    Ok(match computed("marschner-lobb", size)?.fill([0; 3], size) {
        Voxels::F32(values) => {
            let quantized = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
            Voxels::U8(values.into_par_iter().map(quantized).collect())
        }
        voxels => voxels,
    })
}

/// Two turns around the z axis; as thick as a fortieth of the cube.
fn wire(edge: u32) -> Voxels {
    let unit = |i: u32| (f64::from(i) + 0.5) / f64::from(edge);
    let count = edge as usize * edge as usize;
    let slice = |z: u32| {
        let up = unit(z);
        let angle = up * 4.0 * std::f64::consts::PI;
        let (x, y) = (0.5 + 0.36 * angle.cos(), 0.5 + 0.36 * angle.sin());
        (0..count as u32).into_par_iter().map(move |at| {
            let (dx, dy) = (unit(at % edge) - x, unit(at / edge) - y);
            let part = 1.0 - (dx * dx + dy * dy).sqrt() * 40.0;
            (part.clamp(0.0, 1.0) * 255.0).round() as u8
        })
    };
    Voxels::U8((0..edge).into_par_iter().flat_map(slice).collect())
}
