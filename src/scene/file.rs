//! The scene file as written: every value with its place, nothing checked but its type.

use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    pub format: Option<Spanned<i64>>,
    #[serde(default)]
    pub picture: PictureFile,
    #[serde(default)]
    pub quality: QualityFile,
    #[serde(default)]
    pub memory: MemoryFile,
    #[serde(default)]
    pub volume: Vec<Spanned<VolumeFile>>,
    #[serde(default)]
    pub view: Vec<Spanned<ViewFile>>,
    pub path: Option<PathFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathFile {
    #[serde(default)]
    pub through: Vec<Spanned<String>>,
    pub frames: Option<Spanned<i64>>,
    pub closed: Option<bool>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PictureFile {
    pub size: Option<Spanned<[i64; 2]>>,
    pub background: Option<Spanned<[f64; 3]>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct QualityFile {
    pub integrator: Option<Spanned<String>>,
    pub step: Option<Spanned<f64>>,
    pub tolerance: Option<Spanned<f64>>,
    pub filter: Option<Spanned<String>>,
    pub refine: Option<Spanned<String>>,
    pub level_max: Option<Spanned<i64>>,
    pub level_loss: Option<Spanned<f64>>,
    pub early_stop: Option<Spanned<f64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MemoryFile {
    pub atlas_mib: Option<Spanned<i64>>,
    pub ram_mib: Option<Spanned<i64>>,
    pub staging_mib: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VolumeFile {
    pub name: Option<Spanned<String>>,
    pub source: Option<Spanned<SourceFile>>,
    pub raw: Option<Spanned<RawFile>>,
    pub spacing: Option<Spanned<[f64; 3]>>,
    pub transform: Option<Spanned<[[f64; 4]; 3]>>,
    #[serde(default)]
    pub channel: Vec<Spanned<ChannelFile>>,
}

/// A path, or a table that names a formula.
pub(super) enum SourceFile {
    Path(String),
    Computed(ComputedFile),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ComputedFile {
    pub computed: Spanned<String>,
    pub size: Spanned<[i64; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFile {
    pub size: Spanned<[i64; 3]>,
    #[serde(rename = "type")]
    pub format: Spanned<String>,
    pub endian: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ChannelFile {
    pub index: Option<Spanned<i64>>,
    pub window: Option<Spanned<[f64; 2]>>,
    pub transfer: Option<Spanned<Vec<Spanned<PointFile>>>>,
    pub level_min: Option<Spanned<i64>>,
    pub level_max: Option<Spanned<i64>>,
    pub sample_every: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PointFile {
    pub at: Spanned<f64>,
    pub color: Spanned<[f64; 3]>,
    pub extinction: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ViewFile {
    pub name: Option<Spanned<String>>,
    pub eye: Option<Spanned<[f64; 3]>>,
    pub target: Option<Spanned<[f64; 3]>>,
    pub up: Option<Spanned<[f64; 3]>>,
    pub fov_degrees: Option<Spanned<f64>>,
    pub height: Option<Spanned<f64>>,
    pub frustum: Option<Spanned<[f64; 4]>>,
}

impl<'de> Deserialize<'de> for SourceFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PathOrTable;
        impl<'de> Visitor<'de> for PathOrTable {
            type Value = SourceFile;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a path or { computed = \"...\", size = [x, y, z] }")
            }

            fn visit_str<E>(self, path: &str) -> Result<SourceFile, E> {
                Ok(SourceFile::Path(path.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SourceFile, A::Error> {
                ComputedFile::deserialize(MapAccessDeserializer::new(map)).map(SourceFile::Computed)
            }
        }
        deserializer.deserialize_any(PathOrTable)
    }
}
