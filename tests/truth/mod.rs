//! What the tests of the reference share: scenes made by code, and ../shared's synth256.

// Each test file uses its own part of this.
#![allow(dead_code)]

use std::io::Read;
use std::path::{Path, PathBuf};

use ashfall::scene::{self, Overrides, Place, Scene, TransferFunction, TransferPoint};
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel};
use flate2::read::GzDecoder;
use glam::DVec3;

/// ../shared, or what ASHFALL_SHARED names; nothing, said out loud, when it is not there.
pub fn shared() -> Option<PathBuf> {
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let path = std::env::var_os("ASHFALL_SHARED").map_or_else(default, PathBuf::from);
    if path.join("data").is_dir() {
        return Some(path);
    }
    eprintln!("SKIPPED: {} holds no data; set ASHFALL_SHARED", path.display());
    None
}

/// The bytes of a gzip file.
pub fn unpacked(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).expect("readable");
    GzDecoder::new(file).read_to_end(&mut bytes).expect("whole gzip file");
    bytes
}

/// A synth256 scene ("sparse" or "linear") and its voxels.
pub fn synth256(shared: &Path, name: &str) -> (Scene, VolumeVoxels) {
    let folder = shared.join("data/synth256");
    let scene = Scene::load(&folder.join(format!("{name}.toml")), &Overrides::default())
        .expect("a good scene");
    let voxels = VolumeVoxels {
        size: Size3::cube(256),
        world_from_voxel: scene.volumes[0].world_from_voxel.expect("the scene's transform"),
        channels: vec![channel(Voxels::U8(unpacked(&folder.join("volume.raw.gz"))))],
    };
    (scene, voxels)
}

/// Voxels whose stored values are their scaled ones.
pub fn channel(voxels: Voxels) -> ChannelVoxels {
    ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 }
}

/// A transfer function of (at, colour, extinction) points.
pub fn transfer(points: &[(f64, [f64; 3], f64)]) -> TransferFunction {
    let point = |&(at, color, extinction)| TransferPoint { at, color, extinction };
    TransferFunction::new(points.iter().map(point).collect()).expect("a good transfer function")
}

/// A scene volume with one channel per window and transfer function.
pub fn volume(channels: &[([f64; 2], TransferFunction)]) -> scene::Volume {
    let channel = |(index, (window, transfer)): (usize, &([f64; 2], TransferFunction))| {
        let (index, transfer) = (index as u32, transfer.clone());
        scene::Channel {
            index,
            window: *window,
            transfer,
            level_min: 0,
            level_max: None,
            sample_every: 1,
        }
    };
    scene::Volume {
        name: "test".to_owned(),
        source: scene::Source::Computed { kind: "test".to_owned(), size: Size3::cube(1) },
        world_from_voxel: None,
        channels: channels.iter().enumerate().map(channel).collect(),
        place: Place::Code,
    }
}

/// A volume of one f32 channel, its value given per voxel.
pub fn voxels(
    size: [u32; 3],
    rows: [[f64; 4]; 3],
    value: impl Fn(u32, u32, u32) -> f32,
) -> VolumeVoxels {
    let [nx, ny, nz] = size;
    let xy = |z: u32| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]));
    let values = (0..nz).flat_map(xy).map(|[x, y, z]| value(x, y, z)).collect();
    VolumeVoxels {
        size: Size3::from_array(size),
        world_from_voxel: WorldFromVoxel::from_rows(rows).expect("a good transform"),
        channels: vec![channel(Voxels::F32(values))],
    }
}

/// Rows of a transform by spacing and origin.
pub fn rows(spacing: [f64; 3], origin: [f64; 3]) -> [[f64; 4]; 3] {
    let mut rows = [[0.0; 4]; 3];
    for axis in 0..3 {
        rows[axis][axis] = spacing[axis];
        rows[axis][3] = origin[axis];
    }
    rows
}

/// Colour and extinction of a windowed value, by a plain search.
pub fn classified(transfer: &TransferFunction, unit: f64) -> ([f64; 3], f64) {
    let points = transfer.points();
    let after = points.iter().take_while(|point| point.at <= unit).count();
    if after == 0 || after == points.len() {
        let point = points[after.saturating_sub(1)];
        return (point.color, point.extinction);
    }
    let (p, q) = (points[after - 1], points[after]);
    let part = (unit - p.at) / (q.at - p.at);
    let mix = |a: f64, b: f64| a + (b - a) * part;
    let color = [0, 1, 2].map(|c| mix(p.color[c], q.color[c]));
    (color, mix(p.extinction, q.extinction))
}

/// The trilinear stored value of a channel at a position in voxels, by its definition.
pub fn sampled(voxels: &VolumeVoxels, channel: usize, position: DVec3) -> f64 {
    let size = voxels.size.to_array();
    let mut value = 0.0;
    for corner in 0..8 {
        let mut weight = 1.0;
        let mut voxel = [0; 3];
        for axis in 0..3 {
            let place = position[axis] - 0.5;
            let (below, fraction) = (place.floor(), place - place.floor());
            let is_upper = corner >> axis & 1 == 1;
            weight *= if is_upper { fraction } else { 1.0 - fraction };
            let index = below as i64 + i64::from(is_upper);
            voxel[axis] = index.clamp(0, i64::from(size[axis]) - 1) as u32;
        }
        let index = voxels.size.index(voxel[0], voxel[1], voxel[2]);
        value += weight * f64::from(voxels.channels[channel].voxels.value(index));
    }
    value
}
