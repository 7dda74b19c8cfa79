//! A source that changes while it is drawn: no voxel of before in the finished picture, and an end.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use ashfall::error::Result;
use ashfall::import::DenseVolume;
use ashfall::render::{Picture, SceneData, Settings};
use ashfall::source::{BrickEntry, BrickSource, Description};
use ashfall::volume::{BrickId, VoxelFormat};

use crate::common::drawing::Device;
use crate::worlds::{
    Look, assert_same, at_level_0, bricks, channel, covered, finished, paged, scene, scene_text,
    slots, volume, with_transfer,
};

/// Only a failure takes so long.
const LONG: Duration = Duration::from_secs(60);
const EDGE: u32 = 64;

/// Voxels of an epoch: low and red in even ones, high and green in odd ones, which the transfer function
/// of [`marked`] tells apart.
fn voxels_of(odd: bool) -> Arc<DenseVolume> {
    let size = [EDGE; 3];
    let even: fn([f64; 3]) -> f64 = |[x, y, z]| 0.25 + 0.1 * (9.0 * x + 7.0 * y + 8.0 * z).sin();
    let odds: fn([f64; 3]) -> f64 = |[x, y, z]| 0.75 + 0.1 * (8.0 * x - 7.0 * y + 9.0 * z).sin();
    let field = if odd { odds } else { even };
    bricks(volume(size, vec![channel(size, VoxelFormat::U8, field)]), 16)
}

/// Gives the voxels of the epoch that the renderer counts; the first, until there is a renderer.
struct Changing {
    of_parity: [Arc<DenseVolume>; 2],
    epoch: OnceLock<Arc<AtomicU64>>,
    reads: AtomicU64,
    /// The epoch ends with each of these reads.
    changes: Vec<u64>,
}

impl Changing {
    fn new(changes: Vec<u64>) -> Arc<Changing> {
        let of_parity = [voxels_of(false), voxels_of(true)];
        let (epoch, reads) = (OnceLock::new(), AtomicU64::new(0));
        Arc::new(Changing { of_parity, epoch, reads, changes })
    }

    fn now(&self) -> &DenseVolume {
        let epoch = self.epoch.get().map_or(0, |epoch| epoch.load(Ordering::SeqCst));
        &self.of_parity[(epoch % 2) as usize]
    }
}

impl BrickSource for Changing {
    fn description(&self) -> &Description {
        self.of_parity[0].description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.now().entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        // These voxels are of the epoch in which the read began, which may be over when they arrive.
        self.now().read(id, bytes)?;
        let read = self.reads.fetch_add(1, Ordering::SeqCst);
        if self.changes.contains(&read)
            && let Some(epoch) = self.epoch.get()
        {
            epoch.fetch_add(1, Ordering::SeqCst);
        }
        Ok(())
    }
}

/// Red below half of the window, green above.
fn marked(source: Arc<dyn BrickSource>) -> SceneData {
    let data = scene(source, Look::Corner, &at_level_0());
    let text = scene_text(&[VoxelFormat::U8], Look::Corner);
    let transfer = "transfer = [\n\
        { at = 0.05, color = [1.0, 0.0, 0.0], extinction = 0.0 },\n\
        { at = 0.1, color = [1.0, 0.0, 0.0], extinction = 1.0 },\n\
        { at = 0.4, color = [1.0, 0.0, 0.0], extinction = 2.0 },\n\
        { at = 0.5, color = [1.0, 0.0, 0.0], extinction = 0.0 },\n\
        { at = 0.5, color = [0.0, 1.0, 0.0], extinction = 0.0 },\n\
        { at = 0.6, color = [0.0, 1.0, 0.0], extinction = 1.0 },\n\
        { at = 0.9, color = [0.0, 1.0, 0.0], extinction = 2.0 },\n\
        { at = 0.95, color = [0.0, 1.0, 0.0], extinction = 0.0 },\n]\n";
    let text = with_transfer(&text, transfer);
    let path = std::path::Path::new("marked.toml");
    let parsed = ashfall::scene::Scene::from_toml(&text, path, &at_level_0());
    SceneData { scene: parsed.unwrap_or_else(|why| panic!("{why}")), ..data }
}

fn ways() -> [Settings; 4] {
    let of = |slots, lockstep| {
        paged(|paging| {
            paging.atlas_slots = Some(slots);
            paging.lockstep = lockstep;
        })
    };
    let tiles = |settings| Settings { tile: [40, 24], ..settings };
    [of(8, true), of(24, false), tiles(of(24, true)), tiles(of(8, false))]
}

/// Whether every pixel is of one epoch's voxels alone.
fn colors(picture: &Picture) -> (usize, usize) {
    let of = |part: usize| picture.pixels.iter().filter(|pixel| pixel[part] > 0.0).count();
    (of(0), of(1))
}

#[test]
fn no_voxel_of_before_is_in_the_finished_picture() {
    let Some(device) = Device::open() else { return };
    let wanted =
        [false, true].map(|odd| finished(&device, &marked(voxels_of(odd)), &slots(64)).picture);
    assert!(wanted.iter().all(|picture| covered(picture) > 500));
    assert_eq!((colors(&wanted[0]).1, colors(&wanted[1]).0), (0, 0), "the marks tell them apart");
    // Early, in the middle, near the end, several times in a row.
    for changes in [vec![0], vec![7], vec![20, 21, 22], vec![30], vec![40, 70, 100], vec![63, 64]] {
        for settings in ways() {
            let source = Changing::new(changes.clone());
            let data = marked(source.clone());
            let mut renderer = device.renderer(&data, &settings);
            assert!(source.epoch.set(renderer.epoch()).is_ok());
            let (picture, statistics) =
                renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
            let what = format!("changes {changes:?}, {settings:?}");
            assert!(statistics.converged, "{what}: {statistics:?}");
            let epoch = renderer.epoch().load(Ordering::SeqCst);
            // A late change may come after the last round: then the next drawing shows it.
            if colors(&picture) != colors(&wanted[(epoch % 2) as usize]) {
                let before = &wanted[((epoch + 1) % 2) as usize];
                assert_same(&picture, before, &format!("{what}: of one epoch alone"));
            }
            let (picture, _) = renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
            let epoch = renderer.epoch().load(Ordering::SeqCst);
            assert_same(&picture, &wanted[(epoch % 2) as usize], &what);
        }
    }
    device.finish();
}

#[test]
fn the_loop_ends_while_another_thread_changes_the_source() {
    let Some(device) = Device::open() else { return };
    let wanted =
        [false, true].map(|odd| finished(&device, &marked(voxels_of(odd)), &slots(64)).picture);
    for settings in ways() {
        let source = Changing::new(Vec::new());
        let data = marked(source.clone());
        let mut renderer = device.renderer(&data, &settings);
        assert!(source.epoch.set(renderer.epoch()).is_ok());
        let begun = Instant::now();
        let epoch = renderer.epoch();
        let changing = std::thread::spawn({
            let source = source.clone();
            move || {
                // Paced by the loaders' own reads, so that every change falls into the work.
                for change in 1..=12 {
                    while source.reads.load(Ordering::SeqCst) < change * 5 && begun.elapsed() < LONG
                    {
                        std::thread::yield_now();
                    }
                    epoch.fetch_add(1, Ordering::SeqCst);
                }
            }
        });
        let (picture, statistics) =
            renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        changing.join().expect("no panic");
        assert!(begun.elapsed() < LONG, "{:?}", begun.elapsed());
        assert!(statistics.converged, "{statistics:?}");
        let (red, green) = colors(&picture);
        assert!(
            red == 0 || green == 0,
            "{settings:?}: {red} pixels of one epoch, {green} of another"
        );
        let (picture, _) = renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
        assert_same(&picture, &wanted[0], "after twelve changes");
    }
    device.finish();
}
