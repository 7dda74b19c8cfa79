//! Scenes open as sources of bricks: what is read when, whose transform holds, and what is said when
//! something must be whole and may not.

mod binary;
mod folder;
mod random;
mod support;

use std::path::Path;

use ashfall::cli::load_scene;
use ashfall::error::Exit;
use ashfall::render::SceneData;
use ashfall::scene::Overrides;
use ashfall::store::Compression;
use ashfall::volume::{BrickId, Size3, VoxelFormat, Voxels};
use binary::ashfall;
use folder::Folder;
use random::Random;
use support::{Volume, settings, voxels};

const SIZE: Size3 = Size3::new(70, 37, 45);

fn scene(source: &str, channels: &[u32], more: &str) -> String {
    let channel = |index: &u32| {
        format!(
            "[[volume.channel]]\nindex = {index}\nwindow = [0.0, 1.0]\n\
             transfer = [{{ at = 0.0, color = [1.0, 1.0, 1.0], extinction = 1.0 }}]\n"
        )
    };
    let channels: String = channels.iter().map(channel).collect();
    format!(
        "format = 1\n[memory]\nram_mib = 1\n[[volume]]\nname = \"one\"\nsource = {source}\n{more}\n\
         {channels}[[view]]\neye = [0.0, 0.0, -9.0]\ntarget = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n\
         height = 1.0\n"
    )
}

fn load(folder: &Folder, text: &str, overrides: &Overrides) -> ashfall::error::Result<SceneData> {
    let path = folder.path("scene.toml");
    std::fs::write(&path, text).unwrap();
    load_scene(&path, overrides)
}

fn opened(folder: &Folder, text: &str) -> SceneData {
    load(folder, text, &Overrides::default()).unwrap_or_else(|why| panic!("{why}"))
}

fn volume_of(format: VoxelFormat, channels: usize) -> Volume {
    let mut random = Random(77);
    let mut volume = Volume::of(SIZE, [1.0, 1.0, 2.0], voxels(format, SIZE, &mut random, false));
    for _ in 1..channels {
        volume.channels.push(voxels(format, SIZE, &mut random, false));
    }
    volume
}

fn store(folder: &Folder, volume: &Volume) {
    let settings = settings(Size3::new(16, 9, 12), 64, 2, Compression::Lz4);
    volume.import(&folder.path("v.bricks"), &settings).unwrap();
}

fn bytes(voxels: &Voxels) -> &[u8] {
    voxels.bytes()
}

#[test]
fn a_store_is_opened_and_its_shown_channels_gathered() {
    let folder = Folder::in_memory();
    let volume = volume_of(VoxelFormat::U16, 3);
    store(&folder, &volume);
    let data = opened(&folder, &scene("\"v.bricks\"", &[2, 0], ""));
    assert_eq!(data.volumes[0].channels, [2, 0]);
    let whole = data.whole(0).unwrap();
    assert_eq!(whole.size, SIZE);
    for (shown, channel) in [2, 0].into_iter().enumerate() {
        assert!(bytes(&whole.channels[shown].voxels) == bytes(&volume.channels[channel]));
    }
    let source = &data.volumes[0].source;
    assert_eq!(whole.world_from_voxel, source.description().world_from_voxel);
    assert!(std::sync::Arc::ptr_eq(&whole, &data.whole(0).unwrap()), "gathered once");
}

#[test]
fn a_brick_that_is_damaged_is_met_when_it_is_read() {
    let folder = Folder::in_memory();
    store(&folder, &volume_of(VoxelFormat::U8, 1));
    let path = folder.path("v.bricks");
    let mut bytes = std::fs::read(&path).unwrap();
    // Every brick in the first part of the file; what opening reads lies before and behind.
    let bricks = ashfall::store::layout::header::BYTES..bytes.len() / 2;
    bricks.step_by(100).for_each(|place| bytes[place] ^= 1);
    std::fs::write(&path, bytes).unwrap();
    let data = opened(&folder, &scene("\"v.bricks\"", &[0], ""));
    let why = data.whole(0).unwrap_err();
    assert_eq!(why.exit, Exit::Input);
    let says = ["scene.toml:", "volume \"one\"", "v.bricks", "damaged"];
    assert!(says.iter().all(|word| why.message.contains(word)), "{why}");
}

#[test]
fn what_the_scene_says_of_the_place_wins() {
    let folder = Folder::in_memory();
    let volume = volume_of(VoxelFormat::U8, 1);
    store(&folder, &volume);
    std::fs::write(folder.path("v.raw"), volume.channels[0].bytes()).unwrap();
    let raw = "raw = { size = [70, 37, 45], type = \"u8\" }\nspacing = [3.0, 1.0, 1.0]";
    let computed = "{ computed = \"shells\", size = [70, 37, 45] }";
    let cases = [
        ("\"v.bricks\"", "spacing = [3.0, 1.0, 1.0]"),
        ("\"v.raw\"", raw),
        (computed, "spacing = [3.0, 1.0, 1.0]"),
    ];
    for (source, more) in cases {
        let data = opened(&folder, &scene(source, &[0], more));
        assert_eq!(data.world_from_voxel(0).spacing().to_array(), [3.0, 1.0, 1.0], "{source}");
        assert_eq!(data.whole(0).unwrap().world_from_voxel, data.world_from_voxel(0), "{source}");
        let levels = &data.volumes[0].source.description().levels;
        // A store keeps the levels it was cut at, a spacing of 1, 1, 2; all others follow the scene.
        let halved = if source.contains("bricks") { [2, 2, 1] } else { [1, 2, 2] };
        assert_eq!(levels.get(1).unwrap().scale, halved, "{source}");
    }
    let data = opened(&folder, &scene("\"v.bricks\"", &[0], ""));
    assert_eq!(data.world_from_voxel(0).spacing().to_array(), [1.0, 1.0, 2.0]);
    let data = opened(&folder, &scene(computed, &[0], ""));
    assert_eq!(data.world_from_voxel(0).spacing().to_array(), [1.0; 3]);
}

#[test]
fn a_computed_volume_of_any_size_opens_and_gives_bricks() {
    let folder = Folder::in_memory();
    let huge = "{ computed = \"mandelbulb\", size = [1048576, 1048576, 1048576] }";
    let data = opened(&folder, &scene(huge, &[0], ""));
    let source = &data.volumes[0].source;
    let last = source.description().levels.count() as u8 - 1;
    let id = BrickId { volume: 0, channel: 0, level: last, x: 0, y: 0, z: 0 };
    let (size, voxels) = source.read_voxels(id).unwrap();
    assert_eq!((size, voxels.len()), (Size3::cube(34), 34 * 34 * 34));
    let why = data.whole(0).unwrap_err();
    assert_eq!(why.exit, Exit::Input);
    assert!(why.message.contains("lower size or raise --ram-mib"), "{why}");
    let small = "{ computed = \"marschner-lobb\", size = [41, 29, 35] }";
    let data = opened(&folder, &scene(small, &[0], ""));
    let whole = ashfall::source::computed("marschner-lobb", Size3::new(41, 29, 35)).unwrap();
    let whole = whole.whole(data.world_from_voxel(0)).unwrap();
    assert_eq!(*data.whole(0).unwrap(), whole, "bricks of a formula are its voxels");
}

#[test]
fn a_file_is_read_once_and_whole() {
    let folder = Folder::in_memory();
    let volume = volume_of(VoxelFormat::I16, 1);
    std::fs::write(folder.path("v.raw"), volume.channels[0].bytes()).unwrap();
    let raw = "raw = { size = [70, 37, 45], type = \"i16\" }";
    let data = opened(&folder, &scene("\"v.raw\"", &[0], raw));
    std::fs::remove_file(folder.path("v.raw")).unwrap();
    assert!(bytes(&data.whole(0).unwrap().channels[0].voxels) == bytes(&volume.channels[0]));
    assert!(data.volumes[0].source.description().levels.count() > 1);
}

#[test]
fn what_must_be_whole_and_may_not_says_what_to_do() {
    let folder = Folder::in_memory();
    let size = Size3::new(128, 128, 100);
    let mut random = Random(5);
    let volume = Volume::of(size, [1.0; 3], voxels(VoxelFormat::U8, size, &mut random, false));
    store(&folder, &volume);
    std::fs::write(folder.path("v.raw"), volume.channels[0].bytes()).unwrap();
    let text = scene("\"v.bricks\"", &[0], "");
    let data = opened(&folder, &text);
    let refused = data.check_memory().unwrap_err();
    assert_eq!(refused, data.whole(0).unwrap_err());
    assert!(refused.message.contains("take 2 MiB of memory, but ram_mib is 1: raise --ram-mib"));
    let more = Overrides { ram_mib: Some(2), ..Overrides::default() };
    assert!(load(&folder, &text, &more).unwrap().whole(0).is_ok());

    let raw = "raw = { size = [128, 128, 100], type = \"u8\" }";
    let Err(why) = load(&folder, &scene("\"v.raw\"", &[0], raw), &Overrides::default()) else {
        panic!("more than ram_mib was read");
    };
    assert_eq!(why.exit, Exit::Input);
    assert!(why.message.contains("import it first (`ashfall import "), "{why}");
    assert!(why.message.contains("v.raw -o OUT.bricks`) or raise --ram-mib"), "{why}");
}

/// The direct way is refused before a device is looked for, of a scene and of a bare file.
#[test]
fn commands_refuse_in_one_sentence() {
    let folder = Folder::in_memory();
    let size = Size3::new(128, 128, 100);
    let volume = Volume::of(size, [1.0; 3], Voxels::U8(vec![7; size.len().unwrap()]));
    store(&folder, &volume);
    std::fs::write(folder.path("scene.toml"), scene("\"v.bricks\"", &[0], "")).unwrap();
    let output = folder.path("x.exr");
    for command in ["render", "plan", "reference"] {
        for (file, place) in [("scene.toml", "scene.toml:6:10"), ("v.bricks", "\"v.bricks\"")] {
            let path = folder.path(file);
            let mut arguments =
                vec![command.as_ref(), path.as_os_str(), "--ram-mib".as_ref(), "1".as_ref()];
            // In pages they would be drawn.
            if command != "reference" {
                arguments.extend(["--addressing", "direct"].map(std::ffi::OsStr::new));
            }
            if command != "plan" {
                arguments.extend(["-o".as_ref(), output.as_os_str()]);
            }
            let run = ashfall(arguments);
            let sentence = run.sentence().expect("one sentence");
            assert_eq!(run.code, Some(3), "{command}: {sentence}");
            assert!(sentence.contains(place) && sentence.contains("raise --ram-mib"), "{sentence}");
            assert!(!Path::new(&output).exists());
        }
    }
}
