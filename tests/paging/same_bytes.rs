//! Scenes of real data: whatever holds, moves and cuts the work, the finished picture has the same bytes.

use ashfall::cli::load_scene;
use ashfall::render::paging::{CopyPath, Traversal};
use ashfall::render::{Addressing, Layout, LayoutChoice, SceneData, Settings};
use ashfall::scene::{Filter, Integrator, Overrides, Refine};

use crate::common::drawing::{Device, Drawn};
use crate::common::shared_data;
use crate::worlds::{assert_same, covered, finished, paged, psnr_db};

const SCENES: [&str; 8] = [
    "scenes/bonsai.toml",
    "scenes/aneurism.toml",
    "scenes/engine.toml",
    "synth256/sparse.toml",
    "synth256/linear.toml",
    "scenes/mni152.toml",
    "scenes/stent.toml",
    "scenes/dna_2_channels.toml",
];
/// Choices of [`choices`].
const ROWS: usize = 16;
/// Against drawing directly; the same bytes are reached.
const DIRECT_DB_MIN: f64 = 90.0;
/// What a sampler's own rounding may do to pictures through different atlases.
const HARDWARE_DB_MIN: f64 = 70.0;

/// Row `row` of 16 in which every two choices meet: column m of an orthogonal array is the parity of
/// row & m; the atlas, of four kinds, takes columns 1 to 3.
fn choices(row: usize) -> (SizeOf, Settings) {
    let column = |mask: usize| (row & mask).count_ones() % 2 == 1;
    let atlas = [SizeOf::Slots(8), SizeOf::Mib(1), SizeOf::Mib(4), SizeOf::Mib(512)][row & 3];
    let settings = paged(|paging| {
        paging.atlas_slots = match atlas {
            SizeOf::Slots(slots) => Some(slots),
            SizeOf::Mib(_) => None,
        };
        paging.staging_bricks = column(4).then_some(1);
        paging.loaders = Some(if column(8) { 1 } else { 8 });
        paging.copy_path = Some(if column(12) { CopyPath::Placed } else { CopyPath::Straight });
        paging.lockstep = !column(9);
        if column(13) {
            paging.traversal = Traversal::ResidencyOctree;
        }
        paging.leaf = if column(14) { [8, 8, 4] } else { [4; 3] };
    });
    let layout = LayoutChoice::Only(if column(6) { Layout::Quads } else { Layout::Plain });
    let tile = if column(10) { [48, 40] } else { settings.tile };
    let steps_per_dispatch = if column(7) { 64 } else { settings.steps_per_dispatch };
    let skipping = !column(5);
    (atlas, Settings { layout, skipping, tile, steps_per_dispatch, ..settings })
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SizeOf {
    Slots(u32),
    Mib(u64),
}

/// Draws with a row's choices; quads of more than bytes do not fit 1 MiB.
fn draw_row(device: &Device, data: &mut SceneData, row: usize) -> (Drawn, Settings) {
    let (atlas, mut settings) = choices(row);
    data.scene.memory.atlas_mib = match atlas {
        SizeOf::Mib(mib) => mib,
        SizeOf::Slots(_) => 256,
    };
    data.scene.memory.staging_mib = 64;
    let texel_bytes: usize = data.volumes[0].shown().map(|channel| channel.format.bytes()).sum();
    let quads_fit = texel_bytes == 1 || atlas != SizeOf::Mib(1);
    if !quads_fit || data.scene.quality.filter == Filter::Hardware {
        settings.layout = LayoutChoice::Only(Layout::Plain);
    }
    (finished(device, data, &settings), settings)
}

fn load(scene: &str, size: u32) -> Option<SceneData> {
    let overrides = Overrides { size: Some([size; 2]), level_max: Some(0), ..Overrides::default() };
    let path = shared_data()?.join(scene);
    Some(load_scene(&path, &overrides).unwrap_or_else(|why| panic!("{why}")))
}

fn every_way_gives_the_same(scene: &str, size: u32, rows: &[usize]) {
    let Some(mut data) = load(scene, size) else { return };
    let Some(device) = Device::open() else { return };
    every_row_gives_the_same(&device, &mut data, scene, rows);
    device.finish();
}

fn every_row_gives_the_same(device: &Device, data: &mut SceneData, scene: &str, rows: &[usize]) {
    let (first, _) = draw_row(device, data, rows[0]);
    assert!(covered(&first.picture) > 300, "{scene}: something is seen");
    for row in &rows[1..] {
        let (drawn, settings) = draw_row(device, data, *row);
        assert_same(&drawn.picture, &first.picture, &format!("{scene}, {settings:?}"));
    }
    data.scene.memory.atlas_mib = 1024;
    let direct = Settings { addressing: Addressing::Direct, ..Settings::default() };
    let direct = device.draw_with(data, 0, &direct);
    let db = psnr_db(&first.picture, &direct.picture);
    let equal = first.picture == direct.picture;
    println!("{scene}: direct {db:.1} dB, the same bytes: {equal}");
    assert!(db >= DIRECT_DB_MIN, "{scene}: {db} dB against direct");
}

/// Rows of one scene: over four scenes every row is drawn.
fn rows_of(scene: usize) -> Vec<usize> {
    (0..4).map(|number| (scene * 4 + number * 5) % ROWS).collect()
}

/// Two tests, so that two cores share them.
fn some_ways_of(scenes: std::ops::Range<usize>) {
    for number in scenes {
        every_way_gives_the_same(SCENES[number], 96, &rows_of(number));
    }
}

#[test]
fn finished_pictures_of_real_scenes_have_the_same_bytes() {
    some_ways_of(0..4);
}

#[test]
fn finished_pictures_of_more_real_scenes_have_the_same_bytes() {
    some_ways_of(4..8);
}

#[test]
#[ignore = "minutes: every row of every scene"]
fn finished_pictures_of_real_scenes_have_the_same_bytes_in_every_row() {
    let rows: Vec<usize> = (0..ROWS).collect();
    for scene in SCENES {
        every_way_gives_the_same(scene, 256, &rows);
    }
}

#[test]
fn spans_have_the_same_bytes_too() {
    for (number, scene) in ["scenes/engine.toml", "scenes/dna_2_channels.toml"].iter().enumerate() {
        let Some(mut data) = load(scene, 96) else { return };
        let Some(device) = Device::open() else { return };
        data.scene.quality.integrator = Integrator::Preintegrated;
        every_row_gives_the_same(&device, &mut data, scene, &rows_of(number)[..3]);
        device.finish();
    }
}

/// In a picture large enough that neighbours in a group of rays do different things; at first where levels
/// grow coarser with the distance.
#[test]
fn an_octree_gives_the_same_bytes_as_the_page_table() {
    let Some(device) = Device::open() else { return };
    for (scene, integrator, level_max, refine, leaf, fan_out) in [
        ("scenes/aneurism.toml", Integrator::Riemann, None, Refine::Exact, [4; 3], 2),
        ("scenes/aneurism.toml", Integrator::Riemann, Some(0), Refine::Substitute, [4; 3], 4),
        (
            "scenes/dna_2_channels.toml",
            Integrator::Preintegrated,
            Some(0),
            Refine::Exact,
            [8; 3],
            2,
        ),
        ("scenes/engine.toml", Integrator::Riemann, None, Refine::Substitute, [8, 8, 4], 2),
    ] {
        let overrides = Overrides { size: Some([384; 2]), level_max, ..Overrides::default() };
        let Some(path) = shared_data() else { return };
        let mut data = load_scene(&path.join(scene), &overrides).expect("a scene");
        data.scene.quality.integrator = integrator;
        let page_table = finished(&device, &data, &paged(|_| {}));
        data.scene.quality.refine = refine;
        let octree = paged(|paging| {
            paging.traversal = Traversal::ResidencyOctree;
            (paging.leaf, paging.fan_out) = (leaf, fan_out);
        });
        let drawn = finished(&device, &data, &octree);
        let what = format!("{scene}, {octree:?}");
        match refine {
            Refine::Exact => assert_same(&drawn.picture, &page_table.picture, &what),
            // Boxes of one value are one sample, and rounded once: aneurism has some.
            Refine::Substitute => {
                let db = psnr_db(&drawn.picture, &page_table.picture);
                assert!(db > 130.0, "{what}: {db:.1} dB");
            }
        }
        let [with, without] = [&drawn, &page_table].map(|drawn| drawn.statistics.samples);
        assert!(
            with * 3 < without * 2 || refine == Refine::Substitute,
            "{scene}: {with}, {without}"
        );
    }
    device.finish();
}

/// With those of the paper's comparison, and where frame by frame either may draw.
#[test]
fn every_traversal_gives_the_same_bytes() {
    let Some(mut data) = load("scenes/dna_2_channels.toml", 160) else { return };
    let Some(device) = Device::open() else { return };
    data.scene.memory.atlas_mib = 256;
    let needed = |traversal: Traversal, frames: u32, first: Option<&Drawn>| -> Drawn {
        let settings = paged(|paging| paging.traversal = traversal);
        let mut renderer = device.renderer(&data, &settings);
        let mut last = None;
        for frame in 0..frames {
            let (picture, statistics) = renderer.draw(0, &mut |_| {}).expect("a picture");
            assert!(statistics.converged, "{traversal:?}");
            if let Some(first) = first {
                assert_same(&picture, &first.picture, &format!("{traversal:?}, frame {frame}"));
            }
            last = Some(Drawn { picture, statistics, records: Vec::new() });
        }
        last.expect("a frame")
    };
    let ours = needed(Traversal::PageTable, 1, None);
    let of = |traversal, frames| needed(traversal, frames, Some(&ours)).statistics.bricks_needed;
    let by_octree = of(Traversal::ResidencyOctree, 2);
    let [of_paper, with_ancestors] =
        [Traversal::PageTableOfPaper, Traversal::Octree].map(|traversal| of(traversal, 1));
    let needed_by_either = of(Traversal::Auto, 6);
    let ours = ours.statistics.bricks_needed;
    println!("{by_octree} {ours} {of_paper} {with_ancestors} {needed_by_either}");
    assert!(by_octree <= ours && ours < of_paper && ours < with_ancestors);
    assert!((by_octree..=ours).contains(&needed_by_either));
    device.finish();
}

#[test]
fn the_sampler_changes_little_between_atlases() {
    for scene in ["scenes/bonsai.toml", "scenes/stent.toml"] {
        let Some(mut data) = load(scene, 128) else { return };
        let Some(device) = Device::open() else { return };
        data.scene.quality.filter = Filter::Hardware;
        let (first, _) = draw_row(&device, &mut data, 0);
        for row in [6, 11] {
            let (drawn, settings) = draw_row(&device, &mut data, row);
            let db = psnr_db(&drawn.picture, &first.picture);
            println!("{scene}, row {row}: {db:.1} dB");
            assert!(db >= HARDWARE_DB_MIN, "{scene}, {settings:?}: {db} dB");
        }
        device.finish();
    }
}

#[test]
fn every_two_choices_meet_in_a_row() {
    let all: Vec<Vec<usize>> = (0..ROWS)
        .map(|row| {
            let (_, settings) = choices(row);
            let paging = settings.paging;
            vec![
                row & 3,
                usize::from(paging.staging_bricks.is_some()),
                usize::from(paging.loaders == Some(1)),
                usize::from(paging.copy_path == Some(CopyPath::Placed)),
                usize::from(settings.skipping),
                usize::from(paging.lockstep),
                usize::from(settings.layout == LayoutChoice::Only(Layout::Quads)),
                usize::from(settings.tile == [48, 40]),
                usize::from(settings.steps_per_dispatch == 64),
                usize::from(paging.traversal == Traversal::ResidencyOctree),
                usize::from(paging.leaf == [4; 3]),
            ]
        })
        .collect();
    let kinds = |factor: usize| if factor == 0 { 4 } else { 2 };
    for first in 0..all[0].len() {
        for second in 0..first {
            let met: std::collections::BTreeSet<_> =
                all.iter().map(|row| (row[first], row[second])).collect();
            assert_eq!(met.len(), kinds(first) * kinds(second), "{first} and {second}");
        }
    }
    let drawn: std::collections::BTreeSet<_> = (0..SCENES.len()).flat_map(rows_of).collect();
    assert_eq!(drawn.len(), ROWS, "every row is drawn with some scene: {drawn:?}");
}
