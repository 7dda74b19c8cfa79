//! What midpoint sampling in f64 gives at several steps: the figures to which `riemann` is held.
//!
//! A program of its own: it shares no code with the reference but the rays of a view.
//!
//! Equal steps, as many as are needed to be no longer than asked, and the weight
//! 1 - exp(-extinction * step) give the figures that the project was given, to their last digit.

mod truth;

use ashfall::reference::{Settings, render};
use ashfall::scene::{Overrides, Scene};
use ashfall::source::computed;
use ashfall::study::error_metrics::picture_error_f64;
use ashfall::volume::{Size3, VolumeVoxels, Voxels};
use rayon::prelude::*;

/// Where samples lie and how one is weighed.
#[derive(Clone, Copy)]
struct Convention {
    name: &'static str,
    /// Steps of one length, the last one shortened; else a whole number of equal steps.
    last_is_shortened: bool,
    /// How many, from the length in steps.
    count: fn(f64) -> f64,
    /// 1 - exp(-extinction * step); else extinction * step.
    is_exponential: bool,
}

/// The convention of the given figures.
const GIVEN: &str = "equal steps (ceil), 1 - exp";

const CONVENTIONS: [Convention; 4] = [
    Convention {
        name: "shortened last step, 1 - exp",
        last_is_shortened: true,
        count: f64::ceil,
        is_exponential: true,
    },
    Convention { name: GIVEN, last_is_shortened: false, count: f64::ceil, is_exponential: true },
    Convention {
        name: "shortened last step, sigma h",
        last_is_shortened: true,
        count: f64::ceil,
        is_exponential: false,
    },
    Convention {
        name: "equal steps (round), 1 - exp",
        last_is_shortened: false,
        count: f64::round,
        is_exponential: true,
    },
];

fn picture(
    scene: &Scene,
    voxels: &VolumeVoxels,
    edge: u32,
    step_voxels: f64,
    convention: Convention,
) -> Vec<[f64; 4]> {
    let view = &scene.views[0];
    let frame_world = view.ray_frame_world([edge; 2]);
    let frame = frame_world.mapped(&voxels.world_from_voxel.voxel_from_world());
    let step_world = step_voxels * voxels.world_from_voxel.smallest_edge();
    let channel = &scene.volumes[0].channels[0];
    let [low, high] = channel.window;
    let pixel = |index: u32| {
        let (origin, direction) = frame.ray(index % edge, index / edge);
        let per_parameter = frame_world.ray(index % edge, index / edge).1.length();
        let (mut enter, mut exit) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let far = f64::from(voxels.size.to_array()[axis]);
            let (a, b) = (-origin[axis] / direction[axis], (far - origin[axis]) / direction[axis]);
            enter = enter.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        let length = (exit - enter) * per_parameter;
        if length <= 0.0 {
            return [0.0; 4];
        }
        let steps = (convention.count)(length / step_world).max(1.0);
        let equal = length / steps;
        let (mut color, mut transmitted) = ([0.0; 3], 1.0);
        for i in 0..steps as u64 {
            let (start, width) = if convention.last_is_shortened {
                let start = i as f64 * step_world;
                (start, step_world.min(length - start))
            } else {
                (i as f64 * equal, equal)
            };
            let at = enter + (start + 0.5 * width) / per_parameter;
            let unit = (truth::sampled(voxels, 0, origin + direction * at) - low) / (high - low);
            let (rgb, extinction) = truth::classified(&channel.transfer, unit.clamp(0.0, 1.0));
            let depth = extinction * width;
            let weight = if convention.is_exponential { -(-depth).exp_m1() } else { depth };
            for c in 0..3 {
                color[c] += transmitted * weight * rgb[c];
            }
            transmitted *= (-depth).exp();
        }
        [color[0], color[1], color[2], 1.0 - transmitted]
    };
    (0..edge * edge).into_par_iter().map(pixel).collect()
}

#[test]
#[ignore = "prints a table in two minutes: the figures of riemann at four steps"]
fn table() {
    let Some(shared) = truth::shared() else { return };
    let mut scenes = Vec::new();
    let load = |name: &str| {
        let path = shared.join(format!("data/scenes/{name}.toml"));
        Scene::load(&path, &Overrides::default()).expect("a good scene")
    };
    let scene = load("marschner_lobb");
    let signal = computed("marschner-lobb", Size3::cube(41)).expect("known");
    let transform = scene.volumes[0].world_from_voxel.expect("the scene's");
    let voxels = signal.whole(transform).expect("small");
    scenes.push(("marschner_lobb", scene, voxels, [29.5, 41.6, 54.0, 66.1]));
    let (scene, voxels) = truth::synth256(&shared, "sparse");
    scenes.push(("synth256 sparse", scene, voxels, [26.3, 36.1, 49.3, 61.1]));
    let (scene, voxels) = truth::synth256(&shared, "linear");
    scenes.push(("synth256 linear", scene, voxels, [75.2, 86.6, 98.7, 110.9]));
    let scene = load("engine");
    let bytes = truth::unpacked(&shared.join("data/volumes/raw/engine_256x256x128_uint8.raw.gz"));
    let voxels = VolumeVoxels {
        size: Size3::new(256, 256, 128),
        world_from_voxel: scene.volumes[0].world_from_voxel.expect("the scene's"),
        channels: vec![truth::channel(Voxels::U8(bytes))],
    };
    scenes.push(("engine", scene, voxels, [45.8, 52.7, 61.6, 75.3]));
    for (name, scene, voxels, stated) in &scenes {
        let volumes = [(&scene.volumes[0], voxels)];
        let started = std::time::Instant::now();
        let settings = Settings::default();
        let truth = render(&scene.views[0], [256; 2], [0.0; 3], &volumes, &settings, &|_| {});
        println!("{name}: stated {stated:?} (reference in {:.1?})", started.elapsed());
        for convention in CONVENTIONS {
            let psnr_db = [1.0, 0.5, 0.25, 0.125].map(|step| {
                let picture = picture(scene, voxels, 256, step, convention);
                picture_error_f64(&picture, &truth.rgba).whole.psnr_db
            });
            println!("    {:32} {psnr_db:6.1?}", convention.name);
            if convention.name == GIVEN {
                for (got, stated) in psnr_db.iter().zip(stated) {
                    assert!((got - stated).abs() < 0.0501, "{name}: {got} dB, not {stated}");
                }
            }
        }
    }
}
