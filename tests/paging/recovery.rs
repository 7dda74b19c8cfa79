//! Sources that stall, vanish and come back; and what the binary says of a picture that lacks bricks.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ashfall::error::{Error, Result};
use ashfall::render::paging::PagingSettings;
use ashfall::render::{Settings, Unfinished};
use ashfall::source::faulty::{Fault, Stalling};
use ashfall::volume::{BrickId, VoxelFormat};

use crate::binary::ashfall;
use crate::common::drawing::Device;
use crate::faults::{faulty, outside};
use crate::folder::Folder;
use crate::worlds::{assert_same, bytes_volume, channel, covered, finished, hill, paged, slots};

/// Only a failure takes so long.
const LONG: Duration = Duration::from_secs(60);

fn with(change: impl Fn(&mut PagingSettings)) -> [Settings; 2] {
    [true, false].map(|lockstep| {
        paged(|paging| {
            paging.atlas_slots = Some(16);
            paging.lockstep = lockstep;
            change(paging);
        })
    })
}

#[test]
fn a_stalled_source_starves_the_loop_and_the_next_drawing_is_whole() {
    let Some(device) = Device::open() else { return };
    let wanted = finished(&device, &outside(bytes_volume(64, hill)), &slots(16));
    for settings in with(|paging| paging.patience = Duration::from_millis(300)) {
        let source = faulty(Stalling::default());
        let data = outside(source.clone());
        let mut renderer = device.renderer(&data, &settings);
        let begun = Instant::now();
        let (picture, statistics) =
            renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        assert!(begun.elapsed() < LONG, "{:?}", begun.elapsed());
        assert!(
            matches!(statistics.unfinished, Some(Unfinished::Starved { bricks }) if bricks > 0),
            "{statistics:?}"
        );
        assert!(!statistics.converged && statistics.rays_waiting > 0, "{statistics:?}");
        assert_eq!(statistics.bricks_failed, 0, "late is not failed: {statistics:?}");
        assert_eq!(covered(&picture), 0, "nothing came");
        source.fault.go_on();
        let (picture, statistics) =
            renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        assert_eq!(statistics.unfinished, None, "{statistics:?}");
        assert!(statistics.converged, "{statistics:?}");
        assert_same(&picture, &wanted.picture, "after the stall");
    }
    device.finish();
}

/// Reads from one to another fail.
struct Vanishing(std::ops::Range<u64>);

impl Fault for Vanishing {
    fn before(&self, read: u64, id: BrickId) -> Result<()> {
        match self.0.contains(&read) {
            true => Err(Error::input(format!("{id}: the source has vanished"))),
            false => Ok(()),
        }
    }
}

#[test]
fn a_source_that_vanishes_while_drawing_and_returns_leaves_no_trace() {
    let Some(device) = Device::open() else { return };
    let wanted = finished(&device, &outside(bytes_volume(64, hill)), &slots(16));
    for settings in with(|_| {}) {
        let source = faulty(Vanishing(12..40));
        let drawn = finished(&device, &outside(source), &settings);
        let loading = drawn.statistics.loading.expect("bricks were loaded");
        println!("vanished: {loading:?}");
        assert!(loading.failed > 0, "some bricks failed for good: {loading:?}");
        assert_same(&drawn.picture, &wanted.picture, "after the return");
    }
    device.finish();
}

#[test]
fn a_source_that_stays_away_is_tried_again_with_the_next_drawing() {
    let Some(device) = Device::open() else { return };
    let wanted = finished(&device, &outside(bytes_volume(64, hill)), &slots(16));
    for settings in with(|_| {}) {
        let gone = Gone::default();
        let source = faulty(gone.clone());
        let data = outside(source);
        let mut renderer = device.renderer(&data, &settings);
        let draw = |renderer: &mut ashfall::render::Renderer| {
            renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"))
        };
        gone.0.store(true, std::sync::atomic::Ordering::SeqCst);
        let (_, statistics) = draw(&mut renderer);
        assert!(statistics.bricks_failed > 0 && statistics.converged, "{statistics:?}");
        gone.0.store(false, std::sync::atomic::Ordering::SeqCst);
        let (picture, statistics) = draw(&mut renderer);
        assert_eq!(statistics.bricks_failed, 0, "{statistics:?}");
        assert_same(&picture, &wanted.picture, "after the return");
    }
    device.finish();
}

#[derive(Clone, Default)]
struct Gone(Arc<std::sync::atomic::AtomicBool>);

impl Fault for Gone {
    fn before(&self, _: u64, id: BrickId) -> Result<()> {
        match self.0.load(std::sync::atomic::Ordering::SeqCst) {
            true => Err(Error::input(format!("{id}: the source is away"))),
            false => Ok(()),
        }
    }
}

const SCENE: &str = r#"format = 1
[picture]
size = [48, 48]
[quality]
level_max = 0
[memory]
atlas_mib = 4
[[volume]]
name = "made"
source = "made.bricks"
[[volume.channel]]
window = [0.0, 255.0]
transfer = [
  { at = 0.12, color = [0.9, 0.3, 0.3], extinction = 0.0 },
  { at = 1.0, color = [1.0, 0.9, 0.8], extinction = 0.2 },
]
[[view]]
name = "front"
eye = [120.0, -70.0, 90.0]
target = [32.0, 32.0, 32.0]
up = [0.0, 0.0, 1.0]
fov_degrees = 36.0
"#;

#[test]
fn the_binary_says_that_bricks_could_not_be_read() {
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("paging-damaged");
    let scene = folder.write("scene.toml", SCENE);
    let voxels = channel([64; 3], VoxelFormat::U8, hill).voxels;
    folder.write("made.raw", voxels.bytes());
    let [raw, store] = ["made.raw", "made.bricks"].map(|name| folder.path(name));
    let text = |path: &std::path::Path| path.to_str().expect("UTF-8").to_owned();
    let imported = ashfall([
        "import",
        &text(&raw),
        "-o",
        &text(&store),
        "--raw-size",
        "64x64x64",
        "--raw-type",
        "u8",
        "--brick",
        "16",
    ]);
    assert_eq!(imported.code, Some(0), "{}", imported.stderr);
    let picture = text(&folder.path("out.exr"));
    let render =
        || ashfall(["render", &text(&scene), "-o", &picture, "--addressing", "paged", "--json"]);
    let whole = render();
    assert_eq!(whole.code, Some(0), "{}", whole.stderr);
    // Voxels are compressed and checked: one turned byte in the middle of them spoils a brick.
    let mut bytes = std::fs::read(&store).expect("the store");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    std::fs::write(&store, bytes).expect("written");
    let damaged = render();
    assert_eq!(damaged.code, Some(5), "{}", damaged.stderr);
    let said = damaged.stderr.lines().last().unwrap_or_default();
    assert!(said.contains("could not be read") && said.contains("front"), "{said}");
    let stats: serde_json::Value = serde_json::from_str(&damaged.stdout).expect("JSON");
    let view = &stats["views"][0];
    assert_eq!(view["converged"], true, "{view}");
    assert!(view["bricks_failed"].as_u64() > Some(0), "{view}");
    assert_eq!(view["bricks_absent"], 0, "{view}");
}
