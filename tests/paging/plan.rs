//! The plan of a paged scene against what is created, what an atlas may take, and that nothing of paging
//! exists where nothing is paged.

use std::sync::Arc;

use ashfall::error::Exit;
use ashfall::import::DenseVolume;
use ashfall::render::paging::{CopyPath, LoadOrder, Traversal};
use ashfall::render::{Addressing, Plan, Renderer, SceneData, Settings, VolumeData};
use ashfall::scene::{Overrides, Refine, Scene};
use ashfall::volume::VoxelFormat;

use crate::binary::ashfall;
use crate::common::created::assert_as_planned;
use crate::common::drawing::Device;
use crate::folder::Folder;
use crate::worlds::{
    Look, at_level_0, bricks, bytes_volume, channel, finished, hill, other_hill, paged, scene,
    scene_of_whole, scene_text, slots, volume,
};

/// Set for the child process that counts its own threads.
const CHILD: &str = "ASHFALL_TEST_COUNTS_THREADS";

fn two_formats() -> SceneData {
    let size = [64; 3];
    let channels =
        vec![channel(size, VoxelFormat::U8, hill), channel(size, VoxelFormat::U16, other_hill)];
    let overrides = Overrides { atlas_mib: Some(1), ..at_level_0() };
    scene(bricks(volume(size, channels), 16), Look::Corner, &overrides)
}

fn rungs() -> Vec<(&'static str, SceneData, Settings)> {
    let one = || scene(bytes_volume(64, hill), Look::Corner, &at_level_0());
    let mut substitute = one();
    substitute.scene.quality.refine = Refine::Substitute;
    let mut inside =
        scene(bytes_volume(96, hill), Look::Inside, &Overrides { level_max: None, ..at_level_0() });
    inside.scene.quality.early_stop = 0.0;
    let placed = paged(|paging| {
        paging.atlas_slots = Some(8);
        paging.copy_path = Some(CopyPath::Placed);
        paging.show_states = true;
    });
    vec![
        ("8 slots", one(), slots(8)),
        (
            "tiles, short dispatches",
            one(),
            Settings { tile: [40, 24], steps_per_dispatch: 32, ..slots(8) },
        ),
        ("two atlases, 1 MiB", two_formats(), paged(|_| {})),
        ("placed, states", one(), placed),
        ("several levels", inside, slots(16)),
        ("substitute", substitute, paged(|_| {})),
    ]
}

fn draw(renderer: &mut Renderer) -> ashfall::render::Statistics {
    renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}")).1
}

#[test]
fn a_paged_renderer_creates_what_the_plan_lists_and_nothing_else() {
    for (name, data, settings) in rungs() {
        // A device of its own, so that everything counted belongs to this rung.
        let Some(device) = Device::open() else { return };
        let mut renderer = device.renderer(&data, &settings);
        let statistics = draw(&mut renderer);
        assert!(statistics.converged && statistics.rounds > 2, "{name}: {statistics:?}");
        let plan = renderer.plan().clone();
        assert_as_planned(&device, &plan, name);
        assert!(plan.atlas_bytes <= data.scene.memory.atlas_mib << 20, "{name}: a hard limit");
        device.finish();
    }
}

#[test]
fn atlases_fill_their_limit_and_never_pass_it() {
    let Some(device) = Device::open() else { return };
    let size = [160; 3];
    let formats = [VoxelFormat::U8, VoxelFormat::F32];
    let mut before = 0;
    for mib in [1, 2, 3, 5, 8, 13] {
        let channels = formats.map(|format| channel(size, format, hill)).to_vec();
        let overrides = Overrides { atlas_mib: Some(mib), ..at_level_0() };
        let data = scene(bricks(volume(size, channels), 32), Look::Corner, &overrides);
        let plan = device.plan(&data, &paged(|_| {}));
        let limit = (mib as u64) << 20;
        assert!(plan.atlas_bytes <= limit, "{mib} MiB: {}", plan.atlas_bytes);
        assert!(plan.atlas_bytes * 2 > limit, "{mib} MiB: {} is little", plan.atlas_bytes);
        assert!(plan.atlas_bytes > before, "{mib} MiB");
        before = plan.atlas_bytes;
    }
    device.finish();
}

fn refused(device: &Device, data: &SceneData, settings: &Settings) -> ashfall::error::Error {
    let settings = settings.checked().expect("good numbers");
    Plan::new(&device.gpu, &device.compiler, data, &settings).expect_err("too small")
}

#[test]
fn an_atlas_that_is_too_small_is_refused_with_what_is_needed() {
    let Some(device) = Device::open() else { return };
    let size = [96; 3];
    let four = vec![channel(size, VoxelFormat::F32, hill); 4];
    let overrides = Overrides { atlas_mib: Some(1), ..at_level_0() };
    let mut data = scene(bricks(volume(size, four), 32), Look::Corner, &overrides);
    let why = refused(&device, &data, &paged(|_| {}));
    assert_eq!(why.exit, Exit::Input, "{why}");
    // Eight bricks of 34 cubed f32: two for each channel.
    assert!(why.message.contains("8 bricks of 157216 bytes, 2 MiB"), "{why}");
    assert!(why.message.contains("atlas_mib is 1") && why.message.contains("--atlas-mib"), "{why}");
    data.scene.memory.atlas_mib = 2;
    finished(&device, &data, &paged(|_| {}));
    let why = refused(&device, &data, &slots(7));
    assert_eq!(why.exit, Exit::Arguments, "{why}");
    assert!(why.message.contains("at least 8"), "{why}");
    device.finish();
}

#[test]
fn the_binary_refuses_it_with_exit_code_3() {
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("paging-too-small");
    let text = "format = 1\n[quality]\nlevel_max = 0\n[[volume]]\nname = \"made\"\nsource = \"made.bricks\"\n\
        [[volume.channel]]\nwindow = [0, 255]\ntransfer = [{ at = 1.0, color = [1, 1, 1], extinction = 0.1 }]\n\
        [[view]]\neye = [64, 64, -160]\ntarget = [64, 64, 64]\nup = [0, 1, 0]\nfov_degrees = 30\n";
    let scene = folder.write("scene.toml", text);
    let raw = folder.write("made.raw", channel([128; 3], VoxelFormat::U8, hill).voxels.bytes());
    let store = folder.path("made.bricks");
    let path = |path: &std::path::Path| path.to_str().expect("UTF-8").to_owned();
    let (scene, raw, store) = (path(&scene), path(&raw), path(&store));
    let size = ["--raw-size", "128x128x128", "--raw-type", "u8", "--brick", "96"];
    let imported = ashfall([&["import", &raw, "-o", &store], &size[..]].concat());
    assert_eq!(imported.code, Some(0), "{}", imported.stderr);
    let out = folder.path("out.exr");
    let picture = path(&out);
    let render = |flags: &[&str]| {
        ashfall([&["render", &scene, "-o", &picture, "--addressing", "paged"], flags].concat())
    };
    let run = render(&["--atlas-mib", "1"]);
    assert_eq!(run.code, Some(3), "{}", run.stderr);
    let sentence = run.sentence().unwrap_or_else(|why| panic!("{why}"));
    // Two bricks of 98 cubed bytes, and what the device adds.
    assert!(sentence.contains("2 bricks of 941192 bytes, "), "{sentence}");
    let needed = sentence.split(" MiB").next().and_then(|text| text.rsplit(' ').next());
    let needed = needed.expect("a number");
    assert!(sentence.contains("\"made\"") && sentence.contains("--atlas-mib"), "{sentence}");
    assert!(!out.exists(), "no picture");
    let run = render(&["--atlas-mib", needed, "--atlas-slots", "1"]);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(run.stderr.contains("--atlas-slots") && run.stderr.contains("at least 2"));
    let run = render(&["--atlas-mib", needed, "--size", "16x16"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
}

fn has(plan: &Plan, pass: &str, binding: &str) -> bool {
    let pass = plan.passes.iter().find(|planned| planned.name == pass);
    pass.is_some_and(|pass| pass.bindings.iter().any(|bound| bound == binding))
}

#[test]
fn what_a_scene_does_not_need_is_nowhere_in_its_plan() {
    let Some(device) = Device::open() else { return };
    let dense = bytes_volume(96, hill);
    let direct = Settings { addressing: Addressing::Direct, ..Settings::default() };
    let plan = device.plan(&scene_of_whole(&dense, Look::Corner, &at_level_0()), &direct);
    for buffer in ["page_table", "wished", "updates_0", "requests", "constants", "ray_place"] {
        assert!(plan.buffers.iter().all(|planned| planned.name != buffer), "direct: {buffer}");
    }
    assert!(plan.images.iter().all(|image| !image.name.starts_with("atlas")), "direct: an atlas");

    let exact = scene(dense.clone(), Look::Corner, &at_level_0());
    let mut substitute = scene(dense.clone(), Look::Corner, &at_level_0());
    substitute.scene.quality.refine = Refine::Substitute;
    let levels = Overrides { level_max: None, ..at_level_0() };
    let inside = scene(dense, Look::Inside, &levels);
    let plan = device.plan(&exact, &slots(8));
    let buffer = |plan: &Plan, name| plan.buffers.iter().any(|planned| planned.name == name);
    assert!(!buffer(&plan, "wish_weight") && buffer(&plan, "slot_needed"), "exact");
    assert!(!has(&plan, "march_bricks", "views"), "one level: rays are not set up again");
    assert!(!buffer(&plan, "upload") && !buffer(&plan, "placements"), "straight");
    assert!(plan.passes.iter().all(|pass| pass.name != "place"), "straight");
    assert!(!has(&plan, "resolve", "ray_place"), "no states are shown");
    let plan = device.plan(&inside, &slots(8));
    assert!(has(&plan, "march_bricks", "views"), "several levels");
    let plan = device.plan(&substitute, &paged(|_| {}));
    assert!(buffer(&plan, "wish_weight") && !buffer(&plan, "slot_needed"), "substitute");
    assert!(has(&plan, "march_bricks", "wish_weight"), "substitute");
    let shown = paged(|paging| {
        paging.show_states = true;
        paging.copy_path = Some(CopyPath::Placed);
    });
    let plan = device.plan(&exact, &shown);
    assert!(has(&plan, "resolve", "ray_place"), "states are shown");
    assert!(buffer(&plan, "upload") && plan.passes.iter().any(|pass| pass.name == "place"));
    let papers = paged(|paging| paging.order = LoadOrder::Papers);
    assert!(buffer(&device.plan(&exact, &papers), "wish_weight"), "papers");
    device.finish();
}

/// One channel of sixteen costs what it costs alone, buffer by buffer and instruction by instruction.
#[test]
fn a_scene_of_one_channel_pays_nothing_for_the_other_fifteen() {
    let Some(device) = Device::open() else { return };
    let size = [48; 3];
    let of = |count: usize| {
        let channels = (0..count).map(|_| channel(size, VoxelFormat::U8, hill)).collect();
        bricks(volume(size, channels), 16)
    };
    let (alone, sixteen) = (of(1), of(16));
    for traversal in [Traversal::PageTable, Traversal::ResidencyOctree, Traversal::Auto] {
        let settings = paged(|paging| paging.traversal = traversal);
        let plan = |source: &Arc<DenseVolume>, channels: &[u16]| {
            let text = scene_text(&vec![VoxelFormat::U8; channels.len()], Look::Corner);
            let path = std::path::Path::new("made.toml");
            let parsed = Scene::from_toml(&text, path, &at_level_0());
            let parsed = parsed.unwrap_or_else(|why| panic!("{why}"));
            let data = VolumeData::new(source.clone(), channels.to_vec());
            let data = SceneData::new(parsed, vec![data]).expect("drawable");
            device.plan(&data, &settings)
        };
        let json = |plan: &Plan| serde_json::to_value(plan).expect("a plan");
        let wanted = json(&plan(&alone, &[0]));
        assert_eq!(json(&plan(&sixteen, &[7])), wanted, "{traversal:?}");
        let all: Vec<u16> = (0..16).collect();
        assert_ne!(json(&plan(&sixteen, &all)), wanted, "sixteen are not one");
        // What a channel more takes of the octree's memory.
        for count in [1, 2, 4, 5, 8, 12, 16] {
            let Some(octree) = plan(&sixteen, &all[..count]).octree else {
                assert_eq!(traversal, Traversal::PageTable);
                continue;
            };
            let bits = if count <= 4 {
                8
            } else if count <= 12 {
                16
            } else {
                32
            };
            assert_eq!((octree.channels, octree.word_bits), (count, bits));
            assert_eq!(octree.device_bytes, (octree.leaves * u64::from(bits)).div_ceil(32) * 4);
            println!("{count} channels: {octree:?}");
        }
    }
    device.finish();
}

/// Threads of this process that are loaders.
fn loader_threads() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let names = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.starts_with("loader")).count()
}

/// In a process of its own: other tests have loaders too.
#[test]
fn loaders_run_for_paged_scenes_alone() {
    if std::env::var_os(CHILD).is_none() {
        let test = std::env::current_exe().expect("this program");
        let name = "plan::loaders_run_for_paged_scenes_alone";
        let child = std::process::Command::new(test)
            .args(["--exact", name, "--nocapture"])
            .env(CHILD, "1")
            .output()
            .expect("it runs");
        let said = String::from_utf8_lossy(&child.stdout).into_owned();
        assert!(child.status.success() && said.contains("1 passed"), "{said}");
        return;
    }
    let Some(device) = Device::open() else { return };
    let data = scene_of_whole(&bytes_volume(64, hill), Look::Corner, &at_level_0());
    let direct = Settings { addressing: Addressing::Direct, ..Settings::default() };
    let mut renderer = device.renderer(&data, &direct);
    draw(&mut renderer);
    assert_eq!(loader_threads(), 0, "direct");
    drop(renderer);
    let mut renderer = device.renderer(&data, &paged(|paging| paging.loaders = Some(3)));
    draw(&mut renderer);
    assert_eq!(loader_threads(), 3, "paged");
    drop(renderer);
    assert_eq!(loader_threads(), 0, "after the renderer");
    device.finish();
}
