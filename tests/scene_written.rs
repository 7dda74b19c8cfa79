//! Scenes that are written read as themselves.

use std::path::{Path, PathBuf};

use ashfall::scene::{
    Filter, Integrator, Overrides, Place, Projection, Refine, Scene, Source, View,
};
use ashfall::volume::{RawLayout, Size3, VoxelFormat, WorldFromVoxel};
use glam::DVec3;
use proptest::prelude::*;

fn read(text: &str, at: &Path) -> Scene {
    Scene::from_toml(text, at, &Overrides::default()).unwrap_or_else(|why| panic!("{why}\n{text}"))
}

/// The same but for views, which come back to rounding, and for where the file says what.
fn assert_same(got: &Scene, wanted: &Scene) {
    let plain = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.volumes.iter_mut().for_each(|volume| volume.place = Place::Code);
        scene.views.clear();
        scene
    };
    assert_eq!(plain(got), plain(wanted));
    assert_eq!(got.views.len(), wanted.views.len());
    for (got, wanted) in got.views.iter().zip(&wanted.views) {
        assert_eq!((&got.name, got.projection), (&wanted.name, wanted.projection));
        assert_eq!(got.eye, wanted.eye);
        for (got, wanted) in
            [(got.forward, wanted.forward), (got.right, wanted.right), (got.up, wanted.up)]
        {
            assert!((got - wanted).length() < 1e-13, "{got} {wanted}");
        }
    }
}

#[test]
fn the_scenes_at_hand_come_back() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/demo_scenes");
    let is_scene = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml");
    let files = std::fs::read_dir(&folder).expect("scenes").map(|entry| entry.expect("it").path());
    let mut count = 0;
    for file in files.filter(is_scene) {
        let text = std::fs::read_to_string(&file).expect("text");
        let scene = read(&text, &file);
        assert_same(&read(&scene.to_toml(&folder), &file), &scene);
        count += 1;
    }
    assert!(count >= 3, "{count} scenes");
}

#[test]
fn files_are_named_from_the_scenes_folder_where_they_lie_below_it() {
    let base = std::path::absolute("made").expect("a folder");
    let mut scene = read(SCENE, &base.join("scene.toml"));
    let raw = RawLayout { size: Size3::cube(9), format: VoxelFormat::I16, big_endian: true };
    for (path, named) in [
        (base.join("below/a \"b\"\\c.raw"), "below/a"),
        (base.with_file_name("beside.raw"), "beside.raw"),
    ] {
        scene.volumes[0].source = Source::File { path: path.clone(), raw: Some(raw) };
        let text = scene.to_toml(&base);
        assert!(text.contains(named), "{text}");
        assert!(!text.contains(&*base.to_string_lossy()), "{text}");
        assert_same(&read(&text, &base.join("other.toml")), &scene);
    }
}

const SCENE: &str = r#"
format = 1
[[volume]]
name = "made"
source = { computed = "shells", size = [9, 9, 9] }
[[volume.channel]]
window = [0.0, 1.0]
transfer = [{ at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 }, { at = 0.5, color = [0.1, 0.2, 0.8], extinction = 3.0 }]
[[view]]
eye = [1.9, -1.2, 1.3]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 40.0
"#;

proptest! {
    #[test]
    fn whatever_a_panel_may_set_comes_back(
        window in (-1e30f64..1e30, 1e-3f64..1e30),
        extinctions in (0.0f64..1e24, 0.0f64..1.0),
        at in 0.0f64..1.0,
        color in [0.0f64..1e8, 0.0f64..1.0, 0.0f64..1.0],
        quality in (1e-3f64..50.0, 0.0f64..0.5, 0usize..3, any::<bool>(), any::<bool>()),
        eye in [-1e6f64..1e6, -1e6f64..1e6, -1e6f64..1e6],
        turn in (0.0f64..6.2, -1.5f64..1.5),
        projection in 0usize..3,
        levels in (0u8..4, proptest::option::of(4u8..9), 0u32..5),
        spacing in [1e-6f64..1e6, 1e-6f64..1e6, 1e-6f64..1e6],
        size in [1u32..5000, 1u32..5000],
    ) {
        let mut scene = read(SCENE, Path::new("made.toml"));
        scene.picture.size = size;
        let rounded = color.map(|part| (part as f32).min(1.0));
        scene.picture.background = rounded;
        scene.quality.step = quality.0;
        scene.quality.early_stop = quality.1;
        scene.quality.integrator = Integrator::ALL[quality.2];
        scene.quality.filter = if quality.3 { Filter::Exact } else { Filter::Hardware };
        scene.quality.refine = if quality.4 { Refine::Exact } else { Refine::Substitute };
        let volume = &mut scene.volumes[0];
        volume.name = format!("a \"name\" of {at}\n'''");
        volume.world_from_voxel = WorldFromVoxel::from_spacing(spacing).ok();
        let channel = &mut volume.channels[0];
        channel.window = [window.0, window.0 + window.0.abs() + window.1];
        channel.level_min = levels.0;
        channel.level_max = levels.1;
        channel.sample_every = 1 << levels.2;
        let mut points = channel.transfer.points().to_vec();
        points[0].extinction = extinctions.0;
        points[0].color = color;
        points[1].at = at;
        points[1].extinction = extinctions.1;
        channel.transfer = ashfall::scene::TransferFunction::new(points).expect("in order");
        let forward = DVec3::new(
            turn.0.cos() * turn.1.cos(),
            turn.0.sin() * turn.1.cos(),
            turn.1.sin(),
        );
        let projection = [
            Projection::Perspective { fov_degrees: 10.0 + 100.0 * at },
            Projection::Orthographic { height: spacing[0] },
            Projection::Frustum { bounds: [-at - 0.1, 0.2, -0.3, at + 0.1] },
        ][projection];
        let eye = DVec3::from_array(eye);
        let view = View::looking_at("v".into(), eye, eye + forward, DVec3::Z, projection);
        scene.views = vec![view.expect("not along z")];
        let text = scene.to_toml(Path::new("."));
        assert_same(&read(&text, Path::new("made.toml")), &scene);
    }
}
