//! march_bricks.comp against its twin: rays through bricks that come and go, until every ray ends; and
//! the end is the same, whatever came when.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ashfall::gpu::{Buffer, ComputePipeline, Image, Sampler, SamplerFilter};
use ashfall::passes::cache_buffers::CacheBuffers;
use ashfall::passes::march_bricks::{self, OctreeBuffers, RayBuffers, Resources};
use ashfall::passes::march_shape::FilterShape;
use ashfall::passes::rays;
use ashfall::twins::brick_march::Settings;
use ashfall::twins::cache::{Cache, Progress, entry};
use ashfall::twins::exponential::attenuate;
use ashfall::twins::limits::{
    ENTRY_ABSENT, ENTRY_CONSTANT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_HIDDEN, ENTRY_MAPPED,
    ENTRY_STATE_SHIFT, ENTRY_UNMAPPED, PLACE_ENDED, RANK_NONE,
};
use ashfall::twins::march_bricks::{Push, Rays, march_bricks as march_by_twin};
use ashfall::twins::ranks::LevelView;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_block::{MET_PENDING, RayBlock};
use ashfall::twins::ray_march;
use ashfall::twins::ray_setup::ViewRays;
use ashfall::twins::rays::{BrickPush, rays_for_bricks};

use crate::brick_scene::{BrickScene, Skipping, Spec};
use crate::common::device::{Device, device};
use crate::faults::{Fault, all_noticed};
use crate::marching_faults::{
    FAULTS, FAULTS_OF_CLOSED_FORM, FAULTS_OF_LEVELS, FAULTS_OF_OCTREE, FAULTS_OF_RATES,
    FAULTS_OF_STAND_INS,
};
use crate::on_device::{assert_near, buffers, compare, read, write};
use crate::random::Random;
use crate::view_levels::{crossing, depths_between, inner_view, level_views, ray_of_pixel};
use crate::views::placed;
use crate::world::{below, chance, pick};

const TILE: [u32; 2] = [13, 9];
const VIEW_SIZE: [u32; 2] = [20, 16];

#[rustfmt::skip]
const SPECS: &[Spec] = &[
    Spec { size: [13, 17, 10], payload: [4, 5, 3], level: 0, levels: 1, substitute: false, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 3, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [21, 9, 30], payload: [8; 3], level: 0, levels: 1, substitute: false, atlases: &[2, 1], filter: FilterShape::Fetch, early_stop: Some(0.3), holes: true, segments: 2, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [23, 31, 17], payload: [4, 5, 3], level: 1, levels: 1, substitute: false, atlases: &[1, 1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: true, segments: 4, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [140, 102, 128], payload: [8; 3], level: 2, levels: 1, substitute: false, atlases: &[1], filter: FilterShape::Fetch, early_stop: None, holes: false, segments: 30, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 1], payload: [8; 3], level: 1, levels: 1, substitute: false, atlases: &[3], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 2, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [13, 17, 10], payload: [4, 5, 3], level: 0, levels: 1, substitute: false, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: true, segments: 3, preintegrated: true, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [21, 9, 30], payload: [8; 3], level: 0, levels: 1, substitute: false, atlases: &[2, 1], filter: FilterShape::Fetch, early_stop: Some(0.3), holes: true, segments: 2, preintegrated: true, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 20], payload: [8; 3], level: 1, levels: 1, substitute: false, atlases: &[1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: false, segments: 30, preintegrated: true, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [21, 19, 30], payload: [8; 3], level: 0, levels: 1, substitute: false, atlases: &[1, 1], filter: FilterShape::Fetch, early_stop: Some(0.1), holes: false, segments: 2, preintegrated: false, finest: &[], sample_every: &[1, 4], closed_form: false },
    Spec { size: [21, 19, 30], payload: [8; 3], level: 0, levels: 1, substitute: false, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: true, segments: 2, preintegrated: false, finest: &[], sample_every: &[2], closed_form: false },
];

/// Level after level on the way, and coarser ones in the place of what is missing.
#[rustfmt::skip]
const SPECS_OF_LEVELS: &[Spec] = &[
    Spec { size: [23, 31, 17], payload: [4, 5, 3], level: 0, levels: 3, substitute: false, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 3, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 30], payload: [8; 3], level: 1, levels: 2, substitute: false, atlases: &[1, 1], filter: FilterShape::Fetch, early_stop: Some(0.3), holes: true, segments: 4, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [23, 31, 17], payload: [4, 5, 3], level: 0, levels: 1, substitute: true, atlases: &[1], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 3, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 5], payload: [8; 3], level: 0, levels: 1, substitute: true, atlases: &[3], filter: FilterShape::Fetch, early_stop: None, holes: false, segments: 2, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [23, 31, 17], payload: [4, 5, 3], level: 0, levels: 2, substitute: true, atlases: &[2, 1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: true, segments: 2, preintegrated: false, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 20], payload: [8; 3], level: 0, levels: 2, substitute: true, atlases: &[1], filter: FilterShape::Fetch, early_stop: None, holes: false, segments: 30, preintegrated: true, finest: &[], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 25], payload: [4; 3], level: 0, levels: 2, substitute: true, atlases: &[2, 1], filter: FilterShape::Fetch, early_stop: None, holes: true, segments: 2, preintegrated: false, finest: &[0, 2, 1], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 20], payload: [4; 3], level: 1, levels: 1, substitute: true, atlases: &[1, 1], filter: FilterShape::Quads, early_stop: None, holes: false, segments: 3, preintegrated: true, finest: &[2, 0], sample_every: &[], closed_form: false },
    Spec { size: [41, 33, 25], payload: [8; 3], level: 0, levels: 2, substitute: true, atlases: &[2, 1], filter: FilterShape::Quads, early_stop: Some(0.1), holes: true, segments: 2, preintegrated: false, finest: &[], sample_every: &[2, 1, 8], closed_form: false },
    Spec { size: [41, 33, 30], payload: [16; 3], level: 0, levels: 1, substitute: true, atlases: &[1, 1], filter: FilterShape::Fetch, early_stop: None, holes: false, segments: 3, preintegrated: false, finest: &[], sample_every: &[], closed_form: true },
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
    octree: OctreeBuffers,
    /// By what is skipped.
    march: [Arc<ComputePipeline>; 3],
}

/// One way to the end.
#[derive(Clone, Copy, Debug)]
struct Way {
    seed: u64,
    skipping: Skipping,
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
    fn run(&self, way: &Way) -> End {
        let (device, scene) = (self.device, &self.scene);
        let mut random = Random(way.seed);
        let brick_levels = scene.spec.brick_levels(&scene.levels);
        let is_used = |at: &u32| {
            scene.world.bricks[*at as usize].is_some_and(|b| brick_levels.contains(&b.level))
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
        let substitute = scene.spec.substitute;
        let mut stand_ins = 0;
        for round in 1..1000 {
            let what = format!("{way:?}, round {round}");
            // For three rounds nothing is known of the leaves.
            let known = way.ready || round > 3;
            write(&self.octree.leaf_words, &scene.leaf_words.words[usize::from(known)]);
            // Where nothing waits, every round begins anew.
            if round == 1 || substitute {
                rays = rays_for_bricks(&[self.rays_of_view], &self.levels, &self.push);
                self.set_up_on_device(&on_device, &ray_buffers);
                self.compare_rays(&ray_buffers, &rays, "set up");
            }
            let pieces: &[u32] =
                pick(&mut random, &[&[1][..], &[1, 0, 1, 3], &[2, 40], &[1000], &[1000, 1000]]);
            cache.progress = Progress { front: RANK_NONE, ..Progress::default() };
            self.march_on_device(&on_device, &ray_buffers, &cache, way, round, pieces);
            let settings = Settings {
                several_levels: scene.spec.levels > 1,
                substitute,
                early_stop: scene.spec.early_stop.is_some(),
                preintegrated: scene.spec.preintegrated,
            };
            for piece in 0..pieces.len() {
                let push = self.march_push(round, pieces, piece);
                scene.with_scene(&self.levels, known, way.skipping, |twin| {
                    let views = [self.rays_of_view];
                    march_by_twin(&mut rays, &mut cache, twin, &settings, &views, &push);
                });
            }
            self.compare_rays(&ray_buffers, &rays, &what);
            let got = read(device, &on_device, 0).expect("nothing behind");
            compare(&got, &cache, !substitute).unwrap_or_else(|why| panic!("{what}: {why}"));
            let ended = rays.places.iter().all(|place| *place == PLACE_ENDED);
            if ended && rays.blocks.iter().all(|block| block.met & MET_PENDING == 0) {
                assert_eq!(cache.progress.front, RANK_NONE);
                return End { states: rays.states, stand_ins };
            }
            stand_ins += rays.blocks.iter().map(|block| block.met & MET_PENDING).sum::<u32>();
            let told = cache.progress;
            if substitute {
                // In whichever dispatch a ray ended.
                let pending = |ray: usize| {
                    let ended = rays.places[ray] == PLACE_ENDED;
                    ended && rays.blocks[ray].met & MET_PENDING != 0
                };
                let waiting = (0..rays.places.len()).filter(|ray| pending(*ray)).count();
                assert_eq!(told.waiting as usize, waiting, "{what}");
            } else {
                assert!(told.front < RANK_NONE, "{what}: nobody knows of the waiting rays");
            }
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
        cache.wish_weight.fill(0);
    }

    fn set_up_on_device(&self, on_device: &CacheBuffers, rays: &RayBuffers) {
        self.device.run(|recorder| {
            let (views, push) = (&self.views, &self.push);
            rays::record_for_bricks(recorder, &self.set_up, views, on_device, rays, push);
            host_reads(recorder, rays);
        });
    }

    /// Of one of a round's dispatches, each of which takes so many blocks.
    fn march_push(&self, round: u32, pieces: &[u32], piece: usize) -> Push {
        Push {
            tile_origin_pixel: self.push.tile_origin_pixel,
            tile_size_pixel: TILE,
            volume_size: self.push.volume_size,
            view: 0,
            blocks_max: pieces[piece],
            early_stop: self.scene.spec.early_stop.unwrap_or(0.0),
            round,
            last: u32::from(piece + 1 == pieces.len()),
        }
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
        on_device.wish_weight.iter().for_each(|weight| write(weight, &cache.wish_weight));
        let pipeline = &self.march[way.skipping as usize];
        self.device.run(|recorder| {
            for piece in 0..pieces.len() {
                let push = self.march_push(round, pieces, piece);
                let resources = Resources {
                    views: &self.views,
                    transfer: &self.transfer,
                    constants: &self.constants,
                    atlases: &self.atlases,
                    sampler: &self.sampler,
                    octree: Some(&self.octree),
                };
                march_bricks::record(recorder, pipeline, on_device, rays, &resources, &push);
            }
            host_reads(recorder, rays);
            let marks = [&on_device.slot_used, &on_device.wished, &on_device.progress];
            let optional = on_device.slot_needed.iter().chain(&on_device.wish_weight);
            marks.into_iter().chain(optional).for_each(|buffer| recorder.host_read(buffer));
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

    /// Rays that take samples in several levels.
    fn crossing(&self) -> u32 {
        let Bench { scene, levels, rays_of_view, .. } = self;
        let counts = |level: usize| {
            let push = BrickPush { level: level as u32, ..self.push };
            rays_for_bricks(&[*rays_of_view], levels, &push).geometry
        };
        let of_levels: Vec<_> =
            (scene.spec.level..scene.spec.level + scene.spec.levels).map(counts).collect();
        let met = |ray: usize| of_levels.iter().filter(|rays| rays[ray].sample_count > 0).count();
        (0..of_levels[0].len()).filter(|ray| met(*ray) > 1).count() as u32
    }

    /// By the twin of marching without bricks, level after level.
    fn whole(&self) -> Vec<RayState> {
        let Bench { scene, levels, .. } = self;
        let mut push = self.push;
        let mut states = rays_for_bricks(&[self.rays_of_view], levels, &push).states;
        let early_stop = scene.spec.early_stop;
        let preintegrated = scene.spec.preintegrated;
        let settings = ray_march::Settings {
            blocks_max: u32::MAX,
            early_stop,
            preintegrated,
            macrocells: None,
            sample_every: scene.spec.sample_every,
        };
        for level in scene.spec.level..scene.spec.level + scene.spec.levels {
            push.level = level as u32;
            let channels = scene.whole(level);
            let rays = rays_for_bricks(&[self.rays_of_view], levels, &push);
            for (geometry, state) in rays.geometry.iter().zip(&mut states) {
                let left = attenuate(state.optical_depth).transmitted;
                if early_stop.is_none_or(|stop| left >= stop) {
                    state.next_sample = 0;
                    ray_march::march_ray(geometry, state, &channels, &settings);
                }
            }
        }
        states
    }
}

/// How a way ended.
struct End {
    states: Vec<RayState>,
    /// Times that a ray took a coarser level for what was not there.
    stand_ins: u32,
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

/// Which of a level's samples was the last: the level in which a ray ends is the last one here, and the
/// last in use there.
fn without_last(states: &[RayState]) -> Vec<RayState> {
    states.iter().map(|state| RayState { next_sample: 0, ..*state }).collect()
}

/// What a check saw.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Rays that skip.
    skipped: u32,
    /// Rays that leave out more with an octree.
    skipped_in_bricks: u32,
    /// Samples with an octree that are taken, and without.
    samples: [u32; 2],
    /// Rays that see something.
    hits: u32,
    /// Rays that go through several levels.
    crossing: u32,
    /// As [`End`] says.
    stand_ins: u32,
}

/// Random scenes of a kind.
fn check(device: &Device, spec: Spec, seed: u64, scenes: u32) -> Seen {
    let mut random = Random(seed);
    let mut pipelines = None;
    let mut seen = Seen::default();
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
        let middle = ray_of_pixel(&rays_of_view, VIEW_SIZE.map(|edge| f64::from(edge) / 2.0));
        let (near, far) = crossing(middle, spec.size);
        let depths = depths_between(&mut random, [near, far.max(near)], spec.levels as u32);
        let (levels, _) =
            level_views(&scene.levels, spec.payload, &rays_of_view, spec.level, &depths, step);
        let (set_up, march) = pipelines.get_or_insert_with(|| {
            let set_up = device.pipeline(&rays::brick_variant(1, levels.len() as u32));
            let march = [Skipping::Nothing, Skipping::Bricks, Skipping::Boxes]
                .map(|skipping| device.pipeline(&scene.shape(skipping).variant()));
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
            octree: OctreeBuffers {
                level_leaves: device.filled("level_leaves", &scene.leaf_words.levels),
                leaf_words: device.filled("leaf_words", &scene.leaf_words.words[0]),
            },
            scene,
            levels,
            rays_of_view,
        };
        seen.crossing += bench.crossing();
        let mut run = |way: &Way| {
            let End { states, stand_ins } = bench.run(way);
            seen.stand_ins += stand_ins;
            states
        };
        let way = Way { seed, skipping: Skipping::Nothing, hides: false, odd: false, ready: true };
        let whole = run(&way);
        let image = bench.whole();
        // Where bricks meet, the end of one sample and the start of the next are fetched apart.
        let fetched = |rays: &[RayState]| {
            let rays = if spec.levels > 1 { without_last(rays) } else { rays.to_vec() };
            if spec.preintegrated { without_samples(&rays) } else { rays }
        };
        // One image has one level for all channels.
        let alike = bytes(&fetched(&whole)) == bytes(&fetched(&image));
        assert!(alike || !spec.finest.is_empty(), "{spec:?}: not as one image");
        let piecewise = run(&Way { seed: seed + 1, ready: false, ..way });
        assert_eq!(bytes(&piecewise), bytes(&whole), "{spec:?}: another order, another end");
        let hides = Way { hides: true, ready: false, ..way };
        let hidden = run(&Way { seed: seed + 2, ..hides });
        assert_eq!(bytes(&hidden), bytes(&whole), "{spec:?}: hidden bricks show");
        let skips = run(&Way { seed: seed + 3, skipping: Skipping::Bricks, ..hides });
        let [a, b] = [without_samples(&skips), without_samples(&whole)];
        assert_eq!(bytes(&a), bytes(&b), "{spec:?}: skipping changes the end");
        for (skips, whole) in skips.iter().zip(&whole) {
            assert!(skips.samples_taken <= whole.samples_taken);
            seen.skipped += u32::from(skips.samples_taken < whole.samples_taken);
            seen.hits += u32::from(whole.optical_depth > 0.0);
        }
        let octree = Way { skipping: Skipping::Boxes, ..hides };
        for (order, ready) in [(0, true), (1, false)] {
            let boxes = run(&Way { seed: seed + 6 + order, ready, ..octree });
            let [a, b] = [without_samples(&boxes), without_samples(&whole)];
            match spec.closed_form {
                true => assert_near(&a, &b),
                false => {
                    assert_eq!(bytes(&a), bytes(&b), "{spec:?}: boxes change the end, {ready}");
                }
            }
            for (boxes, skips) in boxes.iter().zip(&skips).filter(|_| ready) {
                seen.skipped_in_bricks += u32::from(boxes.samples_taken < skips.samples_taken);
                seen.samples =
                    [seen.samples[0] + boxes.samples_taken, seen.samples[1] + skips.samples_taken];
            }
        }
        let odd = Way { odd: true, hides: true, ready: false, ..way };
        // Leaves speak of voxels that are not there.
        run(&Way { seed: seed + 8, skipping: Skipping::Boxes, ..odd });
        let ends = [Skipping::Nothing, Skipping::Bricks].map(|skipping| {
            let ends: Vec<_> =
                (0..2).map(|order| run(&Way { seed: seed + 4 + order, skipping, ..odd })).collect();
            // What stands in for a failed brick is what happens to be there.
            if !spec.substitute {
                assert_eq!(bytes(&ends[0]), bytes(&ends[1]), "{spec:?}: odd states, another order");
            }
            without_samples(&ends[0])
        });
        if !spec.substitute {
            assert_eq!(bytes(&ends[0]), bytes(&ends[1]), "{spec:?}: odd states, skipping");
        }
    }
    seen
}

#[test]
fn rays_through_bricks_equal_the_twin_and_end_alike_in_every_order() {
    let Some(device) = device() else { return };
    if !device.same_bits() {
        eprintln!("SKIPPED: joined operations change bits, and with them where rays stop early");
        return;
    }
    let mut in_bricks = 0;
    for (seed, spec) in (800..).step_by(100).zip(SPECS) {
        let seen = check(&device, *spec, seed, 4);
        assert!(seen.skipped > 20 && seen.hits > 20, "{spec:?}: {seen:?}");
        in_bricks += seen.skipped_in_bricks;
    }
    assert!(in_bricks > 100, "{in_bricks}");
}

/// The same from level to level, and where coarser levels stand in: what rays take, wish and remember in
/// every round, and the end, which is as if all had been there.
#[test]
fn rays_through_levels_equal_the_twin_and_end_alike_in_every_order() {
    let Some(device) = device() else { return };
    if !device.same_bits() {
        eprintln!("SKIPPED: joined operations change bits, and with them where rays stop early");
        return;
    }
    let mut in_bricks = 0;
    for (seed, spec) in (2000..).step_by(100).zip(SPECS_OF_LEVELS) {
        let seen = check(&device, *spec, seed, 4);
        assert!(seen.skipped > 20 && seen.hits > 20, "{spec:?}: {seen:?}");
        in_bricks += seen.skipped_in_bricks;
        assert!(seen.crossing > 20 || spec.levels == 1, "{spec:?}: {seen:?}");
        assert!(seen.stand_ins > 100 || !spec.substitute, "{spec:?}: {seen:?}");
        let [taken, of_bricks] = seen.samples;
        assert!(taken * 3 < of_bricks * 2 || !spec.closed_form, "{spec:?}: {seen:?}");
    }
    assert!(in_bricks > 100, "{in_bricks}");
}

/// Each fault is noticed by some scene.
fn assert_noticed(faults: &[Fault], specs: &[Spec]) {
    let Some(mut device) = device() else { return };
    if !device.same_bits() {
        return;
    }
    // Without a fault there is nothing to notice.
    for spec in specs {
        check(&device, *spec, 900, 3);
    }
    let notice = |device: &Device| specs.iter().find_map(|spec| noticed(device, *spec));
    all_noticed(&mut device, faults, notice);
}

#[test]
fn planted_faults_are_noticed() {
    assert_noticed(FAULTS, &[2, 1, 0, 3].map(|spec: usize| SPECS[spec]));
}

#[test]
fn faults_planted_where_levels_change_are_noticed() {
    assert_noticed(FAULTS_OF_LEVELS, &SPECS_OF_LEVELS[..2]);
}

#[test]
fn faults_planted_where_levels_stand_in_are_noticed() {
    assert_noticed(FAULTS_OF_STAND_INS, &[2, 4].map(|spec: usize| SPECS_OF_LEVELS[spec]));
}

#[test]
fn faults_planted_among_leaves_are_noticed() {
    assert_noticed(FAULTS_OF_OCTREE, &[1, 0, 5].map(|spec: usize| SPECS[spec]));
}

#[test]
fn faults_planted_where_channels_leave_samples_out_are_noticed() {
    assert_noticed(FAULTS_OF_RATES, &SPECS[8..10]);
}

#[test]
fn faults_planted_where_boxes_have_one_value_are_noticed() {
    assert_noticed(FAULTS_OF_CLOSED_FORM, &SPECS_OF_LEVELS[9..10]);
}

/// What is wrong with some scenes of a kind.
fn noticed(device: &Device, spec: Spec) -> Option<String> {
    let checked = catch_unwind(AssertUnwindSafe(|| check(device, spec, 900, 3)));
    checked.err().map(|_| format!("{spec:?}"))
}
