//! From one scene to the next with one renderer: channels take one another's places, transfer functions and
//! cameras change, also while bricks are on their way; and no voxel of before is ever shown as another's.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ashfall::error::{Exit, Result};
use ashfall::import::DenseVolume;
use ashfall::render::paging::Traversal;
use ashfall::render::{
    NextScene, Picture, Plan, Renderer, SceneChange, SceneData, Settings, VolumeData,
};
use ashfall::scene::{Refine, Scene};
use ashfall::source::{BrickEntry, BrickSource, Description};
use ashfall::volume::{BrickId, VoxelFormat};

use crate::common::drawing::Device;
use crate::worlds::{
    Field, Look, assert_same, at_level_0, bricks, channel, covered, finished, hill, other_hill,
    paged, scene_text, volume, with_transfer,
};

/// Only a failure takes so long.
const LONG: Duration = Duration::from_secs(60);
const EDGE: u32 = 64;

/// Four channels of bytes; of 2 and 3 [`marks`] says which is which.
fn four_channels() -> Arc<DenseVolume> {
    let size = [EDGE; 3];
    let low: Field = |[x, y, z]| 0.25 + 0.1 * (9.0 * x + 7.0 * y + 8.0 * z).sin();
    let high: Field = |[x, y, z]| 0.75 + 0.1 * (8.0 * x - 7.0 * y + 9.0 * z).sin();
    let of = |field| channel(size, VoxelFormat::U8, field);
    bricks(volume(size, vec![of(hill), of(other_hill), of(low), of(high)]), 16)
}

/// These channels of the source, in a scene of that text, refined in that way.
fn of_text(
    source: &Arc<dyn BrickSource>,
    channels: &[u16],
    text: &str,
    refine: Refine,
) -> SceneData {
    let path = std::path::Path::new("made.toml");
    let mut scene =
        Scene::from_toml(text, path, &at_level_0()).unwrap_or_else(|why| panic!("{why}"));
    scene.quality.refine = refine;
    let data = VolumeData::new(source.clone(), channels.to_vec());
    SceneData::new(scene, vec![data]).expect("drawable")
}

fn scene(source: &Arc<dyn BrickSource>, channels: &[u16], refine: Refine) -> SceneData {
    let text = scene_text(&vec![VoxelFormat::U8; channels.len()], Look::Corner);
    of_text(source, channels, &text, refine)
}

/// Low values red, high ones green: channel 2 of [`four_channels`], and channel 3.
fn marks(source: &Arc<dyn BrickSource>, channel: u16, refine: Refine) -> SceneData {
    let text = scene_text(&[VoxelFormat::U8], Look::Corner);
    let transfer = "transfer = [\n\
        { at = 0.0, color = [1.0, 0.0, 0.0], extinction = 0.0 },\n\
        { at = 0.2, color = [1.0, 0.0, 0.0], extinction = 0.0 },\n\
        { at = 0.3, color = [1.0, 0.0, 0.0], extinction = 2.0 },\n\
        { at = 0.45, color = [1.0, 0.0, 0.0], extinction = 0.0 },\n\
        { at = 0.45, color = [0.0, 1.0, 0.0], extinction = 0.0 },\n\
        { at = 0.6, color = [0.0, 1.0, 0.0], extinction = 0.0 },\n\
        { at = 0.8, color = [0.0, 1.0, 0.0], extinction = 2.0 },\n\
        { at = 1.0, color = [0.0, 1.0, 0.0], extinction = 1.0 },\n]\n";
    let text = with_transfer(&text, transfer);
    of_text(source, &[channel], &text, refine)
}

fn change(device: &Device, before: &Plan, data: SceneData) -> SceneChange {
    SceneChange::new(&device.gpu, &device.compiler, before, data)
        .unwrap_or_else(|why| panic!("{why}"))
}

fn ways() -> Vec<Settings> {
    let mut ways = Vec::new();
    for traversal in [Traversal::PageTable, Traversal::ResidencyOctree, Traversal::Auto] {
        for (slots, lockstep) in [(16, true), (24, false), (400, true)] {
            ways.push(paged(|paging| {
                paging.atlas_slots = Some(slots);
                paging.lockstep = lockstep;
                paging.traversal = traversal;
            }));
        }
    }
    ways
}

fn draw(renderer: &mut Renderer) -> (Picture, ashfall::render::Statistics) {
    let (picture, statistics) = renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
    assert!(statistics.converged && statistics.bricks_failed == 0, "{statistics:?}");
    (picture, statistics)
}

#[test]
fn a_channel_in_anothers_place_is_drawn_as_if_it_had_always_been_there() {
    let Some(device) = Device::open() else { return };
    let source: Arc<dyn BrickSource> = four_channels();
    // Another in the second place, both places, one another's, and back.
    let shown: [&[u16]; 5] = [&[0, 1], &[0, 2], &[3, 1], &[1, 3], &[0, 1]];
    for refine in [Refine::Exact, Refine::Substitute] {
        let fresh: Vec<Picture> = shown
            .iter()
            .map(|channels| {
                let roomy = paged(|paging| paging.atlas_slots = Some(400));
                finished(&device, &scene(&source, channels, refine), &roomy).picture
            })
            .collect();
        assert!(fresh.iter().all(|picture| covered(picture) > 500));
        for settings in ways() {
            // Where it does not fit, what is drawn by substitution depends on the way.
            let fits = settings.paging.atlas_slots == Some(400);
            if refine == Refine::Substitute && !fits {
                continue;
            }
            let mut renderer = device.renderer(&scene(&source, shown[0], refine), &settings);
            for (channels, wanted) in shown.iter().zip(&fresh) {
                let next = change(&device, renderer.plan(), scene(&source, channels, refine));
                renderer.change(next).unwrap_or_else(|why| panic!("{why}"));
                let (picture, statistics) = draw(&mut renderer);
                assert_same(&picture, wanted, &format!("{channels:?}, {refine:?}, {settings:?}"));
                let (_, again) = draw(&mut renderer);
                // Where either traversal may draw, the other one needs other bricks. Slots that the host was
                // granted and has no brick for are missed by a few.
                if settings.paging.traversal != Traversal::Auto {
                    let count = again.bricks_uploaded;
                    assert_eq!(
                        count <= 8,
                        fits,
                        "{count} {channels:?}, {settings:?}: {statistics:?}"
                    );
                }
            }
        }
    }
    device.finish();
}

#[test]
fn what_both_scenes_show_stays_where_it_is() {
    let Some(device) = Device::open() else { return };
    let source: Arc<dyn BrickSource> = four_channels();
    for traversal in [Traversal::PageTable, Traversal::ResidencyOctree] {
        let settings = paged(|paging| paging.traversal = traversal);
        let alone = |channels: &[u16]| {
            finished(&device, &scene(&source, channels, Refine::Exact), &settings)
        };
        let mut renderer = device.renderer(&scene(&source, &[0, 1], Refine::Exact), &settings);
        draw(&mut renderer);
        // Of another second channel only its own bricks travel.
        let next = change(&device, renderer.plan(), scene(&source, &[0, 2], Refine::Exact));
        renderer.change(next).unwrap_or_else(|why| panic!("{why}"));
        let (_, swapped) = draw(&mut renderer);
        let both = alone(&[0, 2]).statistics.bricks_uploaded;
        let first = alone(&[0]).statistics.bricks_uploaded;
        assert!(swapped.bricks_uploaded > 0 && first > 0, "{swapped:?}");
        assert!(
            swapped.bricks_uploaded + first <= both + 8,
            "{} of {both}",
            swapped.bricks_uploaded
        );

        // Another camera and a narrower window, under which less shows: nothing travels.
        let text = scene_text(&[VoxelFormat::U8; 2], Look::Corner);
        let moved = text.replace("eye = [1.9, -1.1, 1.4]", "eye = [1.4, -1.6, 1.3]");
        let narrow = moved.replacen("at = 0.12,", "at = 0.45,", 1);
        assert_ne!(text, moved);
        assert_ne!(moved, narrow);
        for text in [&moved, &narrow] {
            let data = || of_text(&source, &[0, 2], text, Refine::Exact);
            let next = change(&device, renderer.plan(), data());
            renderer.change(next).unwrap_or_else(|why| panic!("{why}"));
            let (picture, statistics) = draw(&mut renderer);
            assert_same(&picture, &finished(&device, &data(), &settings).picture, text);
            assert!(statistics.bricks_uploaded <= 8, "{}", statistics.bricks_uploaded);
        }
        // A wider one: what was hidden is loaded.
        let data = || of_text(&source, &[0, 2], &moved, Refine::Exact);
        let of_narrow = of_text(&source, &[0, 2], &narrow, Refine::Exact);
        let mut renderer = device.renderer(&of_narrow, &settings);
        draw(&mut renderer);
        let next = change(&device, renderer.plan(), data());
        renderer.change(next).unwrap_or_else(|why| panic!("{why}"));
        let (picture, statistics) = draw(&mut renderer);
        assert_same(&picture, &finished(&device, &data(), &settings).picture, "a wider window");
        assert!(statistics.bricks_uploaded > 0, "{statistics:?}");
    }
    device.finish();
}

/// Counts what loaders have read.
struct Counting {
    of: Arc<DenseVolume>,
    reads: AtomicU64,
}

impl BrickSource for Counting {
    fn description(&self) -> &Description {
        self.of.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.of.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.of.read(id, bytes)?;
        self.reads.fetch_add(1, Ordering::SeqCst);
        Ok(())
    }
}

/// A source whose surveys of channel 2 wait until `opens`, and whose reads of channel 3 until they came back.
struct Late {
    of: Arc<DenseVolume>,
    asked: AtomicU64,
    opens: AtomicU64,
    told: AtomicU64,
}

impl Late {
    fn wait_for(count: &AtomicU64) {
        while count.load(Ordering::SeqCst) == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl BrickSource for Late {
    fn description(&self) -> &Description {
        self.of.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        if id.channel == 2 {
            self.asked.fetch_add(1, Ordering::SeqCst);
            Late::wait_for(&self.opens);
            self.told.fetch_add(1, Ordering::SeqCst);
        }
        self.of.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        if id.channel == 3 {
            Late::wait_for(&self.told);
            // The survey itself, after its last entry.
            std::thread::sleep(Duration::from_millis(30));
        }
        self.of.read(id, bytes)
    }
}

/// A survey that comes while its channel is not shown says nothing to anybody: it is asked for again when the
/// channel comes back.
#[test]
fn a_survey_that_came_while_another_channel_was_shown_is_made_again() {
    let Some(device) = Device::open() else { return };
    let late = Arc::new(Late {
        of: four_channels(),
        asked: AtomicU64::new(0),
        opens: AtomicU64::new(0),
        told: AtomicU64::new(0),
    });
    let source: Arc<dyn BrickSource> = late.clone();
    let settings = paged(|paging| {
        paging.lockstep = false;
        paging.loaders = Some(2);
    });
    let of = |channel| marks(&source, channel, Refine::Exact);
    let mut renderer = device.renderer(&of(2), &settings);
    let next = renderer.next_scene();
    let planned = change(&device, renderer.plan(), of(3));
    let leaving = std::thread::spawn(move || {
        Late::wait_for(&late.asked);
        next.leave(planned);
        // Taken up after the round under way.
        std::thread::sleep(Duration::from_millis(200));
        late.opens.fetch_add(1, Ordering::SeqCst);
    });
    let (green, _) = draw(&mut renderer);
    leaving.join().expect("no panic");
    assert!(colors(&green)[1] > 500, "channel 3");
    let back = change(&device, renderer.plan(), of(2));
    renderer.change(back).unwrap_or_else(|why| panic!("{why}"));
    let (red, _) = draw(&mut renderer);
    assert_same(&red, &finished(&device, &of(2), &settings).picture, "channel 2");
    device.finish();
}

/// Pixels with red, and with green.
fn colors(picture: &Picture) -> [usize; 2] {
    [0, 1].map(|part| picture.pixels.iter().filter(|pixel| pixel[part] > 0.0).count())
}

/// While one thread draws, another leaves scenes of channel 2 and channel 3 in turns, faster than a picture
/// is finished. Every finished picture is of one channel alone, the last one of the last.
#[test]
fn a_swap_under_load_shows_no_voxel_of_before() {
    let Some(device) = Device::open() else { return };
    let dense = four_channels();
    for refine in [Refine::Exact, Refine::Substitute] {
        for settings in ways() {
            if refine == Refine::Substitute && settings.paging.atlas_slots != Some(400) {
                continue;
            }
            let counting = Arc::new(Counting { of: dense.clone(), reads: AtomicU64::new(0) });
            let source: Arc<dyn BrickSource> = counting.clone();
            let wanted = [2, 3].map(|of| finished(&device, &marks(&source, of, refine), &settings));
            let seen = wanted.each_ref().map(|drawn| colors(&drawn.picture));
            assert!(seen[0][0] > 500 && seen[0][1] == 0, "red alone: {seen:?}");
            assert!(seen[1][1] > 500 && seen[1][0] == 0, "green alone: {seen:?}");
            let data = marks(&source, 2, refine);
            let mut renderer = device.renderer(&data, &settings);
            let next: NextScene = renderer.next_scene();
            // Planned before, so that swaps follow one another fast.
            let planned: Vec<SceneChange> = (0..11)
                .map(|turn| change(&device, renderer.plan(), marks(&source, 3 - turn % 2, refine)))
                .collect();
            let (begun, before) = (Instant::now(), counting.reads.load(Ordering::SeqCst));
            let leaving = std::thread::spawn(move || {
                for (turn, change) in planned.into_iter().enumerate() {
                    // Paced by the loaders' own reads, so that swaps fall into the work; once all is in
                    // memory by time alone.
                    let due = Duration::from_millis(4 * turn as u64);
                    while counting.reads.load(Ordering::SeqCst) < before + 6 * turn as u64
                        && begun.elapsed() < due
                    {
                        std::thread::yield_now();
                    }
                    next.leave(change);
                }
            });
            let mut pictures = Vec::new();
            while pictures.len() < 2 || !leaving.is_finished() {
                pictures.push(draw(&mut renderer).0);
                assert!(begun.elapsed() < LONG, "{settings:?}");
            }
            leaving.join().expect("no panic");
            pictures.push(draw(&mut renderer).0);
            for picture in &pictures {
                let [red, green] = colors(picture);
                let of = usize::from(green > 0);
                assert!(red == 0 || green == 0, "{settings:?}: {red} red, {green} green");
                assert_same(picture, &wanted[of].picture, &format!("{refine:?}, {settings:?}"));
            }
            assert_same(
                pictures.last().expect("one"),
                &wanted[1].picture,
                "the last that was left",
            );
        }
    }
    device.finish();
}

/// Every round's picture, while it is refined by substitution: the first one after a swap too.
#[test]
fn no_round_after_a_swap_shows_a_voxel_of_before() {
    let Some(device) = Device::open() else { return };
    let source: Arc<dyn BrickSource> = four_channels();
    for traversal in [Traversal::PageTable, Traversal::ResidencyOctree] {
        for lockstep in [true, false] {
            let settings = paged(|paging| {
                paging.lockstep = lockstep;
                paging.grants_per_round = Some(4);
                paging.traversal = traversal;
            });
            let substitute = Refine::Substitute;
            let mut renderer = device.renderer(&marks(&source, 2, substitute), &settings);
            let next = renderer.next_scene();
            let mut planned: Vec<SceneChange> = (0..6)
                .map(|turn| {
                    change(&device, renderer.plan(), marks(&source, 2 + turn % 2, substitute))
                })
                .collect();
            let (mut green, mut rounds, mut seen) = (false, 0, [0; 2]);
            let mut watch = |round: ashfall::render::paging::RoundPicture| {
                rounds += 1;
                let shown = colors(&round.picture);
                assert_eq!(
                    shown[usize::from(!green)],
                    0,
                    "round {rounds}: {shown:?}, green: {green}"
                );
                seen[usize::from(green)] += shown[usize::from(green)];
                if rounds % 5 == 0
                    && let Some(change) = planned.pop()
                {
                    green = !green;
                    next.leave(change);
                }
                ControlFlow::Continue(())
            };
            let drawn = renderer.draw_watched(0, &mut watch).unwrap_or_else(|why| panic!("{why}"));
            let (picture, statistics) = drawn.expect("not broken off");
            assert!(statistics.converged, "{statistics:?}");
            assert!(planned.is_empty() && seen.iter().all(|count| *count > 500), "{seen:?}");
            let alone = finished(&device, &marks(&source, 2, substitute), &settings).picture;
            assert_same(&picture, &alone, "the last that was left");
        }
    }
    device.finish();
}

#[test]
fn what_cannot_go_on_is_refused_in_a_sentence() {
    let Some(device) = Device::open() else { return };
    let source: Arc<dyn BrickSource> = four_channels();
    let settings = paged(|paging| paging.atlas_slots = Some(32));
    let mut renderer = device.renderer(&scene(&source, &[0, 1], Refine::Exact), &settings);
    let refused = |data: SceneData| {
        let planned = SceneChange::new(&device.gpu, &device.compiler, renderer.plan(), data);
        let why = planned.err().expect("refused");
        assert_eq!(why.exit, Exit::Input, "{why}");
        why.to_string()
    };
    let more = refused(scene(&source, &[0, 1, 2], Refine::Exact));
    assert!(more.contains("number of channels"), "{more}");
    let other = refused(scene(&source, &[0, 1], Refine::Substitute));
    assert!(other.contains("refines in another way"), "{other}");
    let text = scene_text(&[VoxelFormat::U8; 2], Look::Corner);
    let views = format!("{text}{}", &text[text.find("[[view]]").expect("a view")..]);
    let views = views.replacen("[[view]]", "[[view]]\nname = \"first\"", 1);
    let two = refused(of_text(&source, &[0, 1], &views, Refine::Exact));
    assert!(two.contains("number of views"), "{two}");
    let mut larger = scene(&source, &[0, 1], Refine::Exact);
    larger.scene.picture.size[0] += 1;
    let larger = refused(larger);
    assert!(larger.contains("pictures are larger"), "{larger}");
    // Another volume, and nothing is lost: the renderer draws on.
    let others: Arc<dyn BrickSource> = four_channels();
    let next = change(&device, renderer.plan(), scene(&others, &[0, 1], Refine::Exact));
    let why = renderer.change(next).expect_err("another volume");
    assert!(why.to_string().contains("make a new renderer"), "{why}");
    let (picture, _) = draw(&mut renderer);
    let alone = finished(&device, &scene(&source, &[0, 1], Refine::Exact), &settings);
    assert_same(&picture, &alone.picture, "after a refusal");
    device.finish();
}
