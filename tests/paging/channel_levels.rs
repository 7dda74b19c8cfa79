//! Channels at levels of their own: against the reference of exactly that mix, through every traversal and
//! integrator; and what levels lose decides them.

use std::sync::Arc;

use ashfall::error::Result;
use ashfall::import::DenseVolume;
use ashfall::reference::{Truth, VolumeLevel};
use ashfall::render::paging::Traversal;
use ashfall::render::{Addressing, Picture, SceneData, Settings, VolumeData};
use ashfall::scene::{Overrides, Scene};
use ashfall::source::{BrickEntry, BrickSource, Description};
use ashfall::study::error_metrics::picture_error;
use ashfall::volume::{BrickId, ValueRange, VoxelFormat};

use crate::common::drawing::Device;
use crate::worlds::{
    Look, at_level_0, bricks, channel, covered, finished, hill, other_hill, paged, psnr_db,
    scene_text, volume, waves, with_transfer,
};

const EDGE: u32 = 64;
/// What every mode and mix of levels must reach against the reference.
const DB_MIN: f64 = 50.0;

fn three_channels() -> Arc<DenseVolume> {
    let size = [EDGE, EDGE, 40];
    let of = |field| channel(size, VoxelFormat::U8, field);
    bricks(volume(size, vec![of(hill), of(waves), of(other_hill)]), 16)
}

/// The scene's text with these bounds of its channels.
fn text_of(levels: &[(u8, Option<u8>)], look: Look) -> String {
    let text = scene_text(&vec![VoxelFormat::U8; levels.len()], look);
    let mut parts = text.split("[[volume.channel]]\n");
    let mut bounded = parts.next().expect("a volume").to_owned();
    for ((least, most), part) in levels.iter().zip(parts) {
        let most = most.map(|most| format!("level_max = {most}\n")).unwrap_or_default();
        bounded += &format!("[[volume.channel]]\nlevel_min = {least}\n{most}{part}");
    }
    bounded
}

fn data_of(source: &Arc<DenseVolume>, text: &str, overrides: &Overrides) -> SceneData {
    let scene = Scene::from_toml(text, std::path::Path::new("made.toml"), overrides)
        .unwrap_or_else(|why| panic!("{why}"));
    let channels = 0..scene.volumes[0].channels.len() as u16;
    let source: Arc<dyn BrickSource> = source.clone();
    SceneData::new(scene, vec![VolumeData::new(source, channels.collect())]).expect("drawable")
}

fn substitute(step: f64) -> Overrides {
    let refine = Some("substitute".to_owned());
    Overrides { refine, step: Some(step), early_stop: Some(0.0), ..at_level_0() }
}

/// The integral of each channel at a level of its own: as many volumes in one place.
fn truth(data: &SceneData, levels: &[u8]) -> Vec<[f64; 4]> {
    let scene = &data.scene;
    let source = &data.volumes[0].source;
    let alone: Vec<_> = levels
        .iter()
        .enumerate()
        .map(|(channel, level)| {
            let one = VolumeData::new(source.clone(), vec![channel as u16]);
            let mut volume = scene.volumes[0].clone();
            volume.channels = vec![volume.channels[channel].clone()];
            let voxels = one.level(*level).unwrap_or_else(|why| panic!("{why}"));
            (volume, voxels, one.extent_voxel(*level))
        })
        .collect();
    let volumes: Vec<VolumeLevel> = alone
        .iter()
        .map(|(volume, voxels, extent)| VolumeLevel { volume, voxels, extent_voxel: *extent })
        .collect();
    let picture = &scene.picture;
    let truth = Truth::of_levels(&scene.views[0], picture.size, picture.background, &volumes, 1e-6);
    truth.picture(2, &|_| {}).rgba
}

fn db(picture: &Picture, truth: &[[f64; 4]]) -> f64 {
    picture_error(&picture.pixels, truth).whole.psnr_db
}

fn ways() -> [Settings; 3] {
    [Traversal::PageTable, Traversal::ResidencyOctree, Traversal::Auto].map(|traversal| {
        paged(|paging| {
            paging.traversal = traversal;
            paging.lockstep = traversal != Traversal::Auto;
        })
    })
}

#[test]
fn every_mix_of_levels_is_the_integral_of_that_mix() {
    let Some(device) = Device::open() else { return };
    let source = three_channels();
    // What bounds say, and the levels that come of it: rays are in level 0, or where all are coarser in
    // the finest of them.
    for (bounds, levels) in [
        ([0, 0, 0], [0, 0, 0]),
        ([0, 1, 2], [0, 1, 2]),
        ([2, 0, 1], [2, 0, 1]),
        ([1, 2, 1], [1, 2, 1]),
        ([2, 2, 2], [2, 2, 2]),
    ] {
        let bounds: Vec<_> = bounds.iter().map(|least| (*least, None)).collect();
        for (look, integrator) in [
            (Look::Corner, "riemann"),
            (Look::Inside, "riemann"),
            (Look::Parallel, "riemann"),
            (Look::Corner, "preintegrated"),
        ] {
            let text = text_of(&bounds, look);
            let integrator = Some(integrator.to_owned());
            let overrides = Overrides { integrator, ..substitute(0.125) };
            // With level_max of the view 0, levels are the bounds' alone.
            let data = data_of(&source, &text, &overrides);
            let truth = truth(&data, &levels);
            let mut first: Option<Picture> = None;
            for settings in ways() {
                let what = format!("{levels:?}, {look:?}, {overrides:?}, {settings:?}");
                let drawn = finished(&device, &data, &settings);
                let db = db(&drawn.picture, &truth);
                println!("{levels:?}, {look:?}, {:?}: {db:.1} dB", settings.paging.traversal);
                assert!(covered(&drawn.picture) > 500 && db >= DB_MIN, "{what}: {db:.1} dB");
                let first = first.get_or_insert(drawn.picture.clone());
                crate::worlds::assert_same(&drawn.picture, first, &what);
            }
        }
    }
    device.finish();
}

/// The same picture as if the whole scene were at that level, and as many bricks.
#[test]
fn a_channel_alone_at_its_level_is_the_view_at_that_level() {
    let Some(device) = Device::open() else { return };
    let source = three_channels();
    let free = Overrides { level_max: None, ..substitute(0.5) };
    let coarse = data_of(&source, &text_of(&[(1, Some(1))], Look::Corner), &free);
    let drawn = finished(&device, &coarse, &ways()[0]);
    let settings = Settings { level_min: 1, ..ways()[0] };
    let by_view = Overrides { level_max: Some(1), ..free.clone() };
    let view = data_of(&source, &text_of(&[(0, None)], Look::Corner), &by_view);
    let wanted = finished(&device, &view, &settings);
    crate::worlds::assert_same(&drawn.picture, &wanted.picture, "level 1");
    // And the coarsest level of a channel holds all others back.
    let text = text_of(&[(0, None), (0, Some(0))], Look::Corner);
    let far = text.replace("eye = [1.9, -1.1, 1.4]", "eye = [9.0, -8.0, 7.0]");
    let plan = |text: &str| device.plan(&data_of(&source, text, &free), &ways()[0]);
    assert_eq!(plan(&far).coarsest_level(0), 0);
    let unbounded = text_of(&[(0, None), (0, None)], Look::Corner);
    let unbounded = unbounded.replace("eye = [1.9, -1.1, 1.4]", "eye = [9.0, -8.0, 7.0]");
    assert!(plan(&unbounded).coarsest_level(0) > 0);
    device.finish();
}

#[test]
fn what_levels_lose_decides_which_are_drawn() {
    let Some(device) = Device::open() else { return };
    let size = [EDGE; 3];
    // Hardly anything is lost of the first, of the second a lot.
    let smooth: crate::worlds::Field = |[x, y, z]| 0.5 + 0.2 * (x + y + z - 1.5);
    let rough: crate::worlds::Field =
        |[x, y, z]| 0.5 + 0.4 * (150.0 * x).sin() * (140.0 * y).cos() * (130.0 * z).sin();
    let of = |field| channel(size, VoxelFormat::U8, field);
    let source = bricks(volume(size, vec![of(smooth), of(rough)]), 16);
    let text = text_of(&[(0, None), (0, None)], Look::Corner);
    let at = |loss: Option<f64>| {
        let overrides = Overrides { level_loss: loss, ..substitute(0.5) };
        let data = data_of(&source, &text, &overrides);
        let levels = device.plan(&data, &ways()[0]).finest_levels().to_vec();
        (levels, finished(&device, &data, &ways()[0]))
    };
    let (levels, whole) = at(None);
    assert_eq!(levels, [0, 0]);
    let mut before = (f64::INFINITY, u64::MAX, [0, 0]);
    for loss in [0.0, 0.01, 0.03, 0.1, 0.9] {
        let (levels, drawn) = at(Some(loss));
        let (db, bricks) =
            (psnr_db(&drawn.picture, &whole.picture), drawn.statistics.bricks_uploaded);
        println!("loss {loss}: levels {levels:?}, {db:.1} dB, {bricks} bricks");
        assert!(levels[0] >= levels[1], "the rough one is no coarser");
        assert!(levels[0] >= before.2[0] && levels[1] >= before.2[1], "more loss, coarser");
        assert!(bricks <= before.1, "and fewer bricks");
        before = (db, bricks, [levels[0], levels[1]]);
    }
    let (levels, drawn) = at(Some(0.03));
    assert!(levels[0] > 0 && levels[1] == 0, "{levels:?}");
    assert!(drawn.statistics.bricks_uploaded < whole.statistics.bricks_uploaded * 2 / 3);
    let (levels, none) = at(Some(0.0));
    assert_eq!(levels[1], 0, "nothing may be lost");
    assert!(psnr_db(&none.picture, &whole.picture) > 60.0);
    device.finish();
}

#[test]
fn levels_of_channels_need_substitution() {
    let Some(device) = Device::open() else { return };
    let source = three_channels();
    let exact = Overrides { refine: None, ..substitute(0.5) };
    let text = text_of(&[(1, None), (0, None)], Look::Corner);
    let loss = Overrides { level_loss: Some(0.1), ..exact.clone() };
    let plain = text_of(&[(0, None), (0, None)], Look::Corner);
    for (text, overrides) in [(&text, &exact), (&plain, &loss)] {
        let data = data_of(&source, text, overrides);
        let why = ashfall::render::Plan::new(&device.gpu, &device.compiler, &data, &ways()[0])
            .expect_err("refused");
        assert!(why.to_string().contains("need refine \"substitute\""), "{why}");
        let direct = Settings { addressing: Addressing::Direct, ..ways()[0] };
        let why = ashfall::render::Plan::new(&device.gpu, &device.compiler, &data, &direct)
            .expect_err("refused");
        assert!(why.to_string().contains("need voxels in pages"), "{why}");
    }
    device.finish();
}

/// Bricks that lose 3 values where level 1 is drawn, 4 more where level 2 is: 5 together.
struct Losing(Arc<DenseVolume>);

impl BrickSource for Losing {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        let range = ValueRange { least: 0.0, greatest: 255.0 };
        let loss = [3.0, 4.0].get(usize::from(id.level)).copied().unwrap_or(0.0);
        Ok(BrickEntry::Stored { range, loss })
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.0.read(id, bytes)
    }
}

#[test]
fn losses_of_levels_add_up_as_squares() {
    let Some(device) = Device::open() else { return };
    let size = [EDGE; 3];
    let dense = bricks(volume(size, vec![channel(size, VoxelFormat::U8, hill)]), 16);
    let source: Arc<dyn BrickSource> = Arc::new(Losing(dense));
    // One value is a 255th of the greatest extinction.
    let ramp = "transfer = [\n{ at = 0.0, color = [1, 1, 1], extinction = 0.0 },\n\
        { at = 1.0, color = [1, 1, 1], extinction = 4.0 },\n]\n";
    let text = text_of(&[(0, None)], Look::Corner);
    let text = with_transfer(&text, ramp);
    for (values, level) in [(0.0, 0), (2.9, 0), (3.1, 1), (4.9, 1), (5.1, 2)] {
        let overrides = Overrides { level_loss: Some(values / 255.0), ..substitute(0.5) };
        let scene = Scene::from_toml(&text, std::path::Path::new("made.toml"), &overrides)
            .unwrap_or_else(|why| panic!("{why}"));
        let data = VolumeData::new(source.clone(), vec![0]);
        let data = SceneData::new(scene, vec![data]).expect("drawable");
        let plan = device.plan(&data, &ways()[0]);
        assert_eq!(plan.finest_levels(), [level], "{values} values");
    }
    device.finish();
}
