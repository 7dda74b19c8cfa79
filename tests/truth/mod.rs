//! What the tests of the reference share: scenes made by code, and ../shared's synth256.

// Each test file uses its own part of this.
#![allow(dead_code)]

use std::io::Read;
use std::path::{Path, PathBuf};

use ashfall::scene::{Overrides, Scene};
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels};
use flate2::read::GzDecoder;

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

/// A deterministic stream of numbers from 0 to 1 (splitmix64).
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The next number between two.
    pub fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.unit()
    }
}
