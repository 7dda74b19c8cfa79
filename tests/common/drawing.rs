//! Scenes on a device that validation watches, drawn whole.

use std::path::Path;
use std::sync::Arc;

use ashfall::gpu::{DeviceRequest, Gpu, Record, ShaderCompiler};
use ashfall::import::DenseVolume;
use ashfall::passes::SOURCES;
use ashfall::render::{Picture, Plan, Renderer, SceneData, Settings, Statistics, VolumeData};
use ashfall::scene::{Overrides, Scene, Source};
use ashfall::source::computed;
use ashfall::volume::{BRICK_PAYLOAD_DEFAULT, Size3, VolumeVoxels, WorldFromVoxel};

use super::device;

/// An open device that draws scenes; validation with synchronization checks watches.
pub struct Device {
    pub gpu: Arc<Gpu>,
    pub compiler: ShaderCompiler,
}

/// What drawing one view gave.
pub struct Drawn {
    pub picture: Picture,
    pub statistics: Statistics,
    pub records: Vec<Record>,
}

impl Device {
    /// Opens the device that tests run on, as [`device::open`] does.
    pub fn open() -> Option<Device> {
        Device::open_as(DeviceRequest::default())
    }

    /// The same, as `request` says.
    pub fn open_as(request: DeviceRequest) -> Option<Device> {
        let (gpu, _) = device::open_as(request)?;
        let cache = std::env::temp_dir().join("ashfall-test-spirv");
        Some(Device { gpu, compiler: ShaderCompiler::new(SOURCES, Some(cache)) })
    }

    pub fn plan(&self, data: &SceneData, settings: &Settings) -> Plan {
        let settings = settings.checked().unwrap_or_else(|why| panic!("{why}"));
        Plan::new(&self.gpu, &self.compiler, data, &settings).unwrap_or_else(|why| panic!("{why}"))
    }

    pub fn renderer(&self, data: &SceneData, settings: &Settings) -> Renderer {
        Renderer::new(&self.gpu, self.plan(data, settings), data)
            .unwrap_or_else(|why| panic!("{why}"))
    }

    pub fn draw(&self, data: &SceneData, view: usize) -> Drawn {
        self.draw_with(data, view, &Settings::default())
    }

    pub fn draw_with(&self, data: &SceneData, view: usize, settings: &Settings) -> Drawn {
        let mut renderer = self.renderer(data, settings);
        let (picture, statistics) =
            renderer.draw(view, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        Drawn { picture, statistics, records: renderer.records().to_vec() }
    }

    /// Validation must have been silent.
    pub fn finish(self) {
        let messages = self.gpu.messages();
        assert!(messages.is_empty(), "validation said: {messages:#?}");
    }
}

/// A scene of one computed volume in the unit cube's proportions, seen from a corner.
pub fn computed_scene(kind: &str, size: [u32; 3], overrides: &Overrides) -> SceneData {
    let longest = f64::from(size.into_iter().max().unwrap_or(1));
    let [x, y, z] = size.map(|edge| f64::from(edge) / longest);
    let text = format!(
        r#"
format = 1
[[volume]]
name = "{kind}"
source = {{ computed = "{kind}", size = [{}, {}, {}] }}
spacing = [{spacing}, {spacing}, {spacing}]
[[volume.channel]]
window = [0.0, {top}]
transfer = [
  {{ at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 }},
  {{ at = 0.3, color = [0.2, 0.7, 0.4], extinction = 0.5 }},
  {{ at = 0.6, color = [0.9, 0.6, 0.2], extinction = 4.0 }},
  {{ at = 1.0, color = [1.0, 0.9, 0.8], extinction = 2.0 }},
]
[[view]]
name = "corner"
eye = [{ex}, {ey}, {ez}]
target = [{}, {}, {}]
up = [0.0, 0.0, 1.0]
fov_degrees = 38.0
"#,
        size[0],
        size[1],
        size[2],
        x / 2.0,
        y / 2.0,
        z / 2.0,
        spacing = 1.0 / longest,
        top = if ["hydrogen", "shells", "mandelbulb"].contains(&kind) { "255.0" } else { "1.0" },
        ex = x / 2.0 + 1.3,
        ey = y / 2.0 - 1.1,
        ez = z / 2.0 + 0.9,
    );
    scene_data(&text, overrides)
}

/// Voxels in memory as a scene takes them.
pub fn dense(voxels: VolumeVoxels) -> VolumeData {
    let dense = DenseVolume::new("test", Arc::new(voxels), Size3::cube(BRICK_PAYLOAD_DEFAULT));
    let whole = dense.voxels().clone();
    VolumeData::of_whole(Arc::new(dense), whole)
}

/// A scene given as text, all of whose volumes are computed.
pub fn scene_data(text: &str, overrides: &Overrides) -> SceneData {
    let scene = Scene::from_toml(text, Path::new("test.toml"), overrides)
        .unwrap_or_else(|why| panic!("{why}"));
    let unit = WorldFromVoxel::from_spacing([1.0; 3]).unwrap_or_else(|why| panic!("{why}"));
    let volumes = scene.volumes.iter().map(|volume| match &volume.source {
        Source::Computed { kind, size } => computed(kind, *size)
            .and_then(|field| field.whole(volume.world_from_voxel.unwrap_or(unit)))
            .map(dense)
            .unwrap_or_else(|why| panic!("{why}")),
        Source::File { path, .. } => panic!("{} is a file", path.display()),
    });
    let volumes = volumes.collect();
    SceneData::new(scene, volumes).unwrap_or_else(|why| panic!("{why}"))
}
