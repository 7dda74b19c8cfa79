//! march_bricks.comp against its twin: rays through bricks that come and go, until every ray ends; and
//! the end is the same, whatever came when.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ashfall::gpu::{Buffer, ComputePipeline, Image, Sampler, SamplerFilter, ShaderCompiler};
use ashfall::passes::SOURCES;
use ashfall::passes::cache_buffers::CacheBuffers;
use ashfall::passes::march_bricks::{self, RayBuffers, Resources};
use ashfall::passes::march_shape::FilterShape;
use ashfall::passes::rays;
use ashfall::twins::brick_march::Settings;
use ashfall::twins::cache::{Cache, Progress, entry};
use ashfall::twins::limits::{
    ENTRY_ABSENT, ENTRY_CONSTANT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_HIDDEN, ENTRY_MAPPED,
    ENTRY_STATE_SHIFT, ENTRY_UNMAPPED, PLACE_ENDED, RANK_NONE,
};
use ashfall::twins::march_bricks::{Push, Rays, march_bricks as march_by_twin};
use ashfall::twins::ranks::LevelView;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_block::RayBlock;
use ashfall::twins::ray_march;
use ashfall::twins::ray_setup::ViewRays;
use ashfall::twins::rays::{BrickPush, rays_for_bricks};

use crate::brick_scene::{BrickScene, Spec};
use crate::common::device::{Device, device};
use crate::on_device::{buffers, compare, read, write};
use crate::truth::Random;
use crate::view_levels::{inner_view, level_views};
use crate::views::placed;
use crate::world::{below, chance, pick};

const TILE: [u32; 2] = [13, 9];
const VIEW_SIZE: [u32; 2] = [20, 16];

#[rustfmt::skip]
const SPECS: &[Spec] = &[
    Spec { size: [13, 17, 10], payload: [4, 5, 3], level: 0, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 3, preintegrated: false },
    Spec { size: [21, 9, 30], payload: [8; 3], level: 0, atlases: &[2, 1], filter: FilterShape::Fetch, early_stop: Some(0.3), holes: true, segments: 2, preintegrated: false },
    Spec { size: [23, 31, 17], payload: [4, 5, 3], level: 1, atlases: &[1, 1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: true, segments: 4, preintegrated: false },
    Spec { size: [140, 102, 128], payload: [8; 3], level: 2, atlases: &[1], filter: FilterShape::Fetch, early_stop: None, holes: false, segments: 30, preintegrated: false },
    Spec { size: [41, 33, 1], payload: [8; 3], level: 1, atlases: &[3], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 2, preintegrated: false },
    Spec { size: [13, 17, 10], payload: [4, 5, 3], level: 0, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: true, segments: 3, preintegrated: true },
    Spec { size: [21, 9, 30], payload: [8; 3], level: 0, atlases: &[2, 1], filter: FilterShape::Fetch, early_stop: Some(0.3), holes: true, segments: 2, preintegrated: true },
    Spec { size: [41, 33, 20], payload: [8; 3], level: 1, atlases: &[1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: false, segments: 30, preintegrated: true },
];

/// A scene on the device with its rays.
struct Bench<'d> {
    device: &'d Device,
    scene: BrickScene,
    levels: Vec<LevelView>,
    push: BrickPush,
    rays_of_view: ViewRays,
    views: Buffer,
    transfer: Buffer,
    constants: Buffer,
    atlases: Vec<Image>,
    sampler: Sampler,
    set_up: Arc<ComputePipeline>,
    /// Without and with skipping.
    march: [Arc<ComputePipeline>; 2],
}

/// One way to the end.
#[derive(Clone, Copy, Debug)]
struct Way {
    seed: u64,
    skipping: bool,
    /// Bricks of nothing are hidden; else all are mapped.
    hides: bool,
    /// Some bricks are constant, absent, failed or hidden whatever their voxels.
    odd: bool,
    /// Everything is there from the start.
    ready: bool,
}

fn bytes<T: bytemuck::NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}

impl Bench<'_> {
    /// What an entry comes to be.
    fn last_value(&self, random: &mut Random, way: &Way, at: u32) -> u32 {
        if way.odd && chance(random, 0.3) {
            let state = pick(random, &[ENTRY_CONSTANT, ENTRY_HIDDEN, ENTRY_ABSENT, ENTRY_FAILED]);
            return entry(state, below(random, self.scene.constants.len() as u32));
        }
        if way.hides && self.scene.is_nothing[at as usize] {
            return entry(ENTRY_HIDDEN, 0);
        }
        entry(ENTRY_MAPPED, self.scene.slot_of_entry[at as usize])
    }

    /// Marches on the device and by the twin until every ray has ended; both are the same all the way.
    fn run(&self, way: &Way) -> Vec<RayState> {
        let (device, scene) = (self.device, &self.scene);
        let mut random = Random(way.seed);
        let is_used = |at: &u32| {
            scene.world.bricks[*at as usize].is_some_and(|b| b.level == scene.spec.level)
        };
        let used: Vec<u32> = (0..scene.world.entries).filter(is_used).collect();
        // The same in every order: from a stream of its own.
        let mut of_states = Random(77);
        let mut last = vec![0; scene.world.entries as usize];
        let mut cache = scene.world.cache();
        for at in &used {
            last[*at as usize] = self.last_value(&mut of_states, way, *at);
            cache.page_table[*at as usize] = match random.unit() {
                _ if way.ready => last[*at as usize],
                0.0..0.4 => last[*at as usize],
                0.4..0.5 => entry(ENTRY_EXPECTED, 0),
                _ => entry(ENTRY_UNMAPPED, 0),
            };
        }
        let mut rays = rays_for_bricks(&[self.rays_of_view], &self.levels, &self.push);
        let on_device = buffers(device, &scene.world, &cache);
        let ray_buffers = RayBuffers {
            ray_geometry: device.filled("ray_geometry", &rays.geometry),
            ray_state: device.filled("ray_state", &rays.states),
            ray_block: device.filled("ray_block", &rays.blocks),
            ray_place: device.filled("ray_place", &rays.places),
        };
        write(&on_device.levels, &self.levels);
        device.run(|recorder| {
            let (views, push) = (&self.views, &self.push);
            rays::record_for_bricks(recorder, &self.set_up, views, &on_device, &ray_buffers, push);
            host_reads(recorder, &ray_buffers);
        });
        self.compare_rays(&ray_buffers, &rays, "set up");
        for round in 1..1000 {
            let what = format!("{way:?}, round {round}");
            let pieces: &[u32] =
                pick(&mut random, &[&[1][..], &[1, 0, 1, 3], &[2, 40], &[1000], &[1000, 1000]]);
            cache.progress = Progress { front: RANK_NONE, ..Progress::default() };
            self.march_on_device(&on_device, &ray_buffers, &cache, way, round, pieces);
            for (index, blocks_max) in pieces.iter().enumerate() {
                let early_stop = scene.spec.early_stop;
                let preintegrated = scene.spec.preintegrated;
                let settings =
                    Settings { blocks_max: *blocks_max, early_stop, round, preintegrated };
                scene.with_scene(&self.levels, way.skipping, |twin| {
                    let is_last = index + 1 == pieces.len();
                    march_by_twin(&mut rays, &mut cache, twin, &settings, is_last);
                });
            }
            self.compare_rays(&ray_buffers, &rays, &what);
            let got = read(device, &on_device, 0).expect("nothing behind");
            compare(&got, &cache, true).unwrap_or_else(|why| panic!("{what}: {why}"));
            if rays.places.iter().all(|place| *place == PLACE_ENDED) {
                assert_eq!(cache.progress.front, RANK_NONE);
                return rays.states;
            }
            assert!(cache.progress.front < RANK_NONE, "{what}: nobody knows of the waiting rays");
            self.host(&mut random, &used, &last, &mut cache, round);
        }
        panic!("{way:?}: rays wait for ever");
    }

    /// Brings some of what is wished, and now and then gives something up.
    fn host(&self, random: &mut Random, used: &[u32], last: &[u32], cache: &mut Cache, round: u32) {
        for at in used {
            let at = *at as usize;
            let wished = cache.wished[at / 32] >> (at % 32) & 1 == 1;
            let state = cache.page_table[at] >> ENTRY_STATE_SHIFT;
            if (wished || state == ENTRY_EXPECTED) && chance(random, 0.6) {
                cache.page_table[at] = last[at];
            } else if wished && chance(random, 0.5) {
                cache.page_table[at] = entry(ENTRY_EXPECTED, 0);
            }
            if state == ENTRY_MAPPED && round < 60 && chance(random, 0.05) {
                cache.page_table[at] = entry(ENTRY_UNMAPPED, 0);
            }
        }
        cache.wished.fill(0);
    }

    fn march_on_device(
        &self,
        on_device: &CacheBuffers,
        rays: &RayBuffers,
        cache: &Cache,
        way: &Way,
        round: u32,
        pieces: &[u32],
    ) {
        write(&on_device.page_table, &cache.page_table);
        write(&on_device.wished, &cache.wished);
        write(&on_device.progress, &[cache.progress]);
        let pipeline = &self.march[usize::from(way.skipping)];
        self.device.run(|recorder| {
            for (index, blocks_max) in pieces.iter().enumerate() {
                let push = Push {
                    tile_origin_pixel: self.push.tile_origin_pixel,
                    tile_size_pixel: TILE,
                    volume_size: self.push.volume_size,
                    view: 0,
                    blocks_max: *blocks_max,
                    early_stop: self.scene.spec.early_stop.unwrap_or(0.0),
                    round,
                    last: u32::from(index + 1 == pieces.len()),
                };
                let resources = Resources {
                    views: &self.views,
                    transfer: &self.transfer,
                    constants: &self.constants,
                    atlases: &self.atlases,
                    sampler: &self.sampler,
                };
                march_bricks::record(recorder, pipeline, on_device, rays, &resources, &push);
            }
            host_reads(recorder, rays);
            let marks = [&on_device.slot_used, &on_device.wished, &on_device.progress];
            marks.into_iter().chain(&on_device.slot_needed).for_each(|b| recorder.host_read(b));
        });
    }

    fn compare_rays(&self, buffers: &RayBuffers, rays: &Rays, what: &str) {
        let device = self.device;
        let geometry = device.values::<RayGeometry>(&buffers.ray_geometry);
        let states = device.values::<RayState>(&buffers.ray_state);
        let blocks = device.values::<RayBlock>(&buffers.ray_block);
        let places = device.values::<u32>(&buffers.ray_place);
        for ray in 0..places.len() {
            let got = (geometry[ray], states[ray], blocks[ray], places[ray]);
            let wanted = (rays.geometry[ray], rays.states[ray], rays.blocks[ray], rays.places[ray]);
            let same = bytes(&[got.0]) == bytes(&[wanted.0])
                && bytes(&[got.1]) == bytes(&[wanted.1])
                && bytes(&[got.2]) == bytes(&[wanted.2])
                && got.3 == wanted.3;
            assert!(same, "{what}, ray {ray}:\n{got:x?}\n{wanted:x?}");
        }
    }

    /// By the twin of marching without bricks.
    fn whole(&self) -> Vec<RayState> {
        let rays = rays_for_bricks(&[self.rays_of_view], &self.levels, &self.push);
        let mut states = rays.states;
        let early_stop = self.scene.spec.early_stop;
        let preintegrated = self.scene.spec.preintegrated;
        let settings = ray_march::Settings {
            blocks_max: u32::MAX,
            early_stop,
            preintegrated,
            macrocells: None,
        };
        let channels = self.scene.whole();
        for (geometry, state) in rays.geometry.iter().zip(&mut states) {
            ray_march::march_ray(geometry, state, &channels, &settings);
        }
        states
    }
}

fn host_reads<'r>(recorder: &mut ashfall::gpu::Recorder<'r>, rays: &'r RayBuffers) {
    let RayBuffers { ray_geometry, ray_state, ray_block, ray_place } = rays;
    for buffer in [ray_geometry, ray_state, ray_block, ray_place] {
        recorder.host_read(buffer);
    }
}

/// Skipping takes fewer samples; nothing else may differ.
fn without_samples(states: &[RayState]) -> Vec<RayState> {
    states.iter().map(|state| RayState { samples_taken: 0, ..*state }).collect()
}

/// Random scenes of a kind; gives how many rays skip and how many see something.
fn check(device: &Device, spec: Spec, seed: u64, scenes: u32) -> [u32; 2] {
    let mut random = Random(seed);
    let mut pipelines = None;
    let (mut skipped, mut hits) = (0, 0);
    for number in 0..scenes {
        let scene = BrickScene::new(&mut random, spec);
        let volume = placed(&mut random, spec.size, number % 2 == 0);
        let view = match number % 4 {
            0 | 1 => inner_view(&volume, &mut random),
            2 => volume.view_along_axis(&mut random),
            _ => volume.view(&mut random),
        };
        let rays_of_view = volume.rays(&view, VIEW_SIZE);
        let step = volume.diagonal_world() / pick(&mut random, &[20.0, 130.0, 400.0]);
        // Both ends of a sample are to lie in the slot of the brick that its middle is in.
        let most = 0.98 / volume.world_from_voxel.voxels_per_world_max();
        let step = if spec.preintegrated { step.min(most) } else { step };
        let (levels, _) =
            level_views(&scene.levels, spec.payload, &rays_of_view, spec.level, &[0.0], step);
        let (set_up, march) = pipelines.get_or_insert_with(|| {
            let set_up = device.pipeline(&rays::brick_variant(1, levels.len() as u32));
            let march =
                [false, true].map(|skipping| device.pipeline(&scene.shape(skipping).variant()));
            (set_up, march)
        });
        let bench = Bench {
            device,
            push: BrickPush {
                tile_origin_pixel: [5, 4],
                tile_size_pixel: TILE,
                volume_size: spec.size,
                view: 0,
                step_world: step,
                level: spec.level as u32,
                unused_0: 0,
            },
            views: device.filled("views", &[rays_of_view]),
            transfer: device.filled("transfer", &scene.segments.concat()),
            constants: device.filled("constants", &scene.constants),
            atlases: scene.images(device),
            sampler: Sampler::new(&device.gpu, SamplerFilter::Nearest).expect("a sampler"),
            set_up: set_up.clone(),
            march: march.clone(),
            scene,
            levels,
            rays_of_view,
        };
        let way = Way { seed, skipping: false, hides: false, odd: false, ready: true };
        let whole = bench.run(&way);
        let image = bench.whole();
        // Where bricks meet, the end of one sample and the start of the next are fetched apart.
        let fetched = |rays: &[RayState]| {
            if spec.preintegrated { without_samples(rays) } else { rays.to_vec() }
        };
        assert_eq!(bytes(&fetched(&whole)), bytes(&fetched(&image)), "{spec:?}: not as one image");
        let piecewise = bench.run(&Way { seed: seed + 1, ready: false, ..way });
        assert_eq!(bytes(&piecewise), bytes(&whole), "{spec:?}: another order, another end");
        let hides = Way { hides: true, ready: false, ..way };
        let hidden = bench.run(&Way { seed: seed + 2, ..hides });
        assert_eq!(bytes(&hidden), bytes(&whole), "{spec:?}: hidden bricks show");
        let skips = bench.run(&Way { seed: seed + 3, skipping: true, ..hides });
        let [a, b] = [without_samples(&skips), without_samples(&whole)];
        assert_eq!(bytes(&a), bytes(&b), "{spec:?}: skipping changes the end");
        for (skips, whole) in skips.iter().zip(&whole) {
            assert!(skips.samples_taken <= whole.samples_taken);
            skipped += u32::from(skips.samples_taken < whole.samples_taken);
            hits += u32::from(whole.optical_depth > 0.0);
        }
        let odd = Way { odd: true, hides: true, ready: false, ..way };
        let ends = [false, true].map(|skipping| {
            let ends: Vec<_> = (0..2)
                .map(|order| bench.run(&Way { seed: seed + 4 + order, skipping, ..odd }))
                .collect();
            assert_eq!(bytes(&ends[0]), bytes(&ends[1]), "{spec:?}: odd states, another order");
            without_samples(&ends[0])
        });
        assert_eq!(bytes(&ends[0]), bytes(&ends[1]), "{spec:?}: odd states, skipping");
    }
    [skipped, hits]
}

#[test]
fn rays_through_bricks_equal_the_twin_and_end_alike_in_every_order() {
    let Some(device) = device() else { return };
    if !device.same_bits() {
        eprintln!("SKIPPED: joined operations change bits, and with them where rays stop early");
        return;
    }
    for (seed, spec) in (800..).step_by(100).zip(SPECS) {
        let seen = check(&device, *spec, seed, 4);
        assert!(seen.iter().all(|rays| *rays > 20), "{spec:?}: skip, see something: {seen:?}");
    }
}

/// A shader, what it says, and what it would say with a fault.
type Fault = (&'static str, &'static str, &'static str);

#[rustfmt::skip]
const FAULTS: &[Fault] = &[
    ("rays.comp", "block_of_ray[ray] = fresh_block(push.level);", "block_of_ray[ray] = fresh_block(0u);"),
    ("march_bricks.comp", "place = PLACE_RUNNING;\n        bool", "bool"),
    ("march_bricks.comp", "waits = place < PLACE_RUNNING;", "waits = false;"),
    ("march_bricks.comp", "atomicMin(round_progress.front, rank)", "atomicMax(round_progress.front, rank)"),
    ("march_bricks.comp", "push.last != 0u && (counted || !all_ended)", "push.last != 0u && counted"),
    ("common/brick_march.glsl", "return state <= ENTRY_EXPECTED;", "return state < ENTRY_EXPECTED;"),
    ("common/brick_march.glsl", "        round_needed[slot] = round;\n", "        round_needed[slot] = 0u;\n"),
    ("common/brick_march.glsl", "if (state == ENTRY_UNMAPPED) {\n        wish(entry);", "if (state <= ENTRY_EXPECTED) {\n        wish(entry);"),
    ("common/brick_march.glsl", "missing = missing || found.state <= ENTRY_EXPECTED;", "missing = found.state <= ENTRY_EXPECTED;"),
    ("common/brick_march.glsl", "nothing_here = nothing_here && found.has", "nothing_here = found.has"),
    ("common/brick_march.glsl", "(position + 0.5)) / (step_voxel + still)", "(position - 1.5)) / (step_voxel + still)"),
    ("common/brick_march.glsl", "mix(vec3(near), vec3(near + ivec3(PAYLOAD))", "mix(vec3(near + ivec3(PAYLOAD)), vec3(near + ivec3(PAYLOAD))"),
    ("common/brick_march.glsl", "shown_to < known ? known : sample_index", "shown_to < known ? known + 3u : sample_index"),
    ("common/brick_march.glsl", "shown_to = shows ? end : shown_to;", "shown_to = shows ? end - 1u : shown_to;"),
    ("common/brick_march.glsl", "shown_to == 0u ? end : sample_index", "shown_to == 0u ? end + 1u : sample_index"),
    ("common/brick_march.glsl", "run < RUNS && known < samples && !missing", "run < RUNS && !missing"),
    ("common/brick_march.glsl", "if (run == 2u) { NAME##_2 = found; }", "if (run == 2u) { NAME##_1 = found; }"),
    ("common/brick_march.glsl", "sample_index > skipped ? sample_index - skipped : 0u", "0u"),
    ("common/brick_march.glsl", "partial.sample_index = state.next_sample < geometry.sample_count ? sample_index : 0u;", "partial.sample_index = 0u;"),
    ("common/brick_march.glsl", "partial.transmitted = block.transmitted;", "partial.transmitted = 1.0;"),
    ("common/brick_march.glsl", "if (attenuate(state.optical_depth).transmitted < early_stop)", "if (state.optical_depth > 0.0 && attenuate(state.optical_depth).transmitted < 2.0 * early_stop)"),
    ("common/brick_march.glsl", "found.origin += anchor_cell + 1;", "found.origin += anchor_cell;"),
    ("common/brick_march.glsl", "LEAVE_OUT_NAN(texel, classified) \\\n        classified.a = has == HAS_NOTHING ? 0.0 : classified.a; \\\n        mix_in(medium, classified.rgb", "mix_in(medium, classified.rgb"),
    ("common/brick_march.glsl", "round_used[slot_first + payload] = round;", "round_used[payload] = round;"),
    ("common/filter.glsl", "near.xz * without.x + near.yw", "near.xy * without.x + near.yw"),
    ("common/classify.glsl", "precise float lost = state.optical_depth_rest + ", "precise float lost = "),
];

/// Each fault is noticed by some scene.
#[test]
fn planted_faults_are_noticed() {
    let Some(mut device) = device() else { return };
    if !device.same_bits() {
        return;
    }
    // Without a fault there is nothing to notice.
    let specs = [2, 1, 0, 3].map(|spec: usize| SPECS[spec]);
    for spec in specs {
        check(&device, spec, 900, 3);
    }
    let mut unnoticed = Vec::new();
    for (file, from, to) in FAULTS {
        let mut sources = SOURCES.to_vec();
        let source = sources.iter_mut().find(|(name, _)| name == file).expect("a shader");
        assert_eq!(source.1.matches(from).count(), 1, "{file}: {from}");
        source.1 = source.1.replace(from, to).leak();
        device.compiler = ShaderCompiler::new(sources.leak(), None);
        let noticed = specs
            .iter()
            .any(|spec| catch_unwind(AssertUnwindSafe(|| check(&device, *spec, 900, 3))).is_err());
        if !noticed {
            unnoticed.push((file, from, to));
        }
    }
    assert!(unnoticed.is_empty(), "unnoticed: {unnoticed:#?}");
}
