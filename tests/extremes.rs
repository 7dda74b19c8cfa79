//! The reference on hostile input: finite, in range and in bounded time, whatever the numbers.

mod random;
mod truth;

use std::time::{Duration, Instant};

use ashfall::reference::Truth;
use ashfall::scene::{Projection, TransferFunction, View, Volume};
use ashfall::volume::{VolumeVoxels, Voxels};
use glam::DVec3;
use random::Random;
use truth::{channel, rows, transfer, volume, voxels};

fn pick<T: Copy>(random: &mut Random, from: &[T]) -> T {
    from[(random.unit() * from.len() as f64) as usize]
}

fn hostile_transfer(random: &mut Random) -> TransferFunction {
    let count = 1 + (random.unit() * 6.0) as usize;
    let near = [0.0, 1e-300, 1e-17, 1e-9, 0.5, 0.5 + 1e-16, 0.5 + 1e-12, 0.75, 1.0];
    let mut at: Vec<f64> = (0..count).map(|_| pick(random, &near)).collect();
    at.sort_by(f64::total_cmp);
    let mut points: Vec<(f64, [f64; 3], f64)> = Vec::new();
    for at in at {
        if points.iter().filter(|point| point.0 == at).count() < 2 {
            let extinction = pick(random, &[0.0, 1e-300, 1e-12, 0.3, 40.0, 1e12, 1e24]);
            let bright = pick(random, &[0.0, 1.0, 1.0, 1e6, 1e8]);
            points.push((at, [random.unit() * bright, bright, 0.25], extinction));
        }
    }
    transfer(&points)
}

fn hostile_voxels(random: &mut Random) -> VolumeVoxels {
    let sizes = [[1, 1, 1], [2, 1, 3], [3, 3, 3], [1, 7, 1]];
    let spacing = pick(random, &[[1.0; 3], [1e-6, 1.0, 1e6], [1e-9; 3], [1e9; 3]]);
    let origin = pick(random, &[[0.0; 3], [1e9, -1e9, 0.0], [-1.5; 3]]);
    let palette = [
        0.0,
        -0.0,
        0.5,
        1.0,
        1e-40,
        f32::MIN_POSITIVE,
        f32::MAX,
        f32::MIN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.500_000_06,
        0.25,
    ];
    let with_nan = random.unit() < 0.3;
    let size = pick(random, &sizes);
    let cell = std::cell::RefCell::new(random);
    let mut made = voxels(size, rows(spacing, origin), |_, _, _| {
        let random = &mut cell.borrow_mut();
        if with_nan && random.unit() < 0.2 { f32::NAN } else { pick(random, &palette) }
    });
    let random = cell.into_inner();
    made.channels[0].slope = pick(random, &[1.0, -1.0, 0.0, 1e-30, 1e30]);
    made.channels[0].intercept = pick(random, &[0.0, 0.5, -1e20]);
    made
}

#[test]
fn hostile_scenes_stay_finite() {
    let mut slowest = Duration::ZERO;
    for seed in 0..3000 {
        let random = &mut Random(seed);
        let window = pick(random, &[[0.0, 1.0], [-1e30, 1e30], [0.5, 0.5 + 1e-12], [-3e38, 3e38]]);
        let scene = volume(&[(window, hostile_transfer(random))]);
        let voxels = hostile_voxels(random);
        let size = voxels.size.to_array().map(f64::from);
        let centre = voxels.world_from_voxel.point(DVec3::from_array(size) * 0.5);
        let edge = voxels.world_from_voxel.smallest_edge();
        let away = pick(random, &[DVec3::X, DVec3::new(0.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 1.0)]);
        let up = DVec3::new(0.1, 0.2, 1.0);
        let projection = pick(
            random,
            &[
                Projection::Perspective { fov_degrees: 60.0 },
                Projection::Orthographic { height: 3.0 * edge },
            ],
        );
        let eye = centre + away * edge * pick(random, &[0.0, 0.3, 4.0, 1e5]);
        let view = View::looking_at("hostile".to_owned(), eye, eye - away, up, projection);
        let Ok(view) = view else { continue };
        let bright = scene.channels[0].transfer.points().iter().flat_map(|p| p.color);
        let bright = bright.fold(1.0, f64::max);
        let started = Instant::now();
        let volumes = [(&scene, &voxels)];
        let truth = Truth::new(&view, [3, 3], [1.0; 3], &volumes, 1e-9);
        for (column, row) in [(0, 0), (1, 1), (2, 1)] {
            let pixel = truth.pixel(column, row);
            let holds = |value: f64, most: f64| value >= -1e-9 && value <= most * (1.0 + 1e-9);
            let good = pixel[..3].iter().all(|c| holds(*c, bright)) && holds(pixel[3], 1.0);
            assert!(good, "seed {seed}, pixel {column}, {row}: {pixel:?}");
        }
        slowest = slowest.max(started.elapsed());
    }
    println!("slowest scene: {slowest:?}");
    assert!(slowest < Duration::from_secs(2), "{slowest:?}");
}

fn one_pixel(eye: DVec3, toward: DVec3, scene: &Volume, voxels: &VolumeVoxels) -> [f64; 4] {
    let projection = Projection::Orthographic { height: 1e-3 };
    let view = View::looking_at("one".to_owned(), eye, eye + toward, DVec3::Y, projection);
    let view = view.expect("a good view");
    Truth::new(&view, [1, 1], [0.0; 3], &[(scene, voxels)], 1e-12).pixel(0, 0)
}

/// A long way through haze, then something opaque: nothing may be lost on 20,000 cells.
#[test]
fn a_long_way_adds_up() {
    let long = voxels([20_000, 1, 1], rows([0.01, 1.0, 1.0], [0.0; 3]), |_, _, _| 0.5);
    let scene = volume(&[([0.0, 1.0], transfer(&[(0.0, [0.3; 3], 0.02), (1.0, [0.7; 3], 0.04)]))]);
    let got = one_pixel(DVec3::new(-1.0, 0.5, 0.5), DVec3::X, &scene, &long);
    let opacity = -(-0.03_f64 * 200.0).exp_m1();
    assert!((got[0] - 0.5 * opacity).abs() < 1e-13, "{got:?}");
    assert!((got[3] - opacity).abs() < 1e-13, "{got:?}");
}

/// Extinction that rises from 0 to 1e12 along a ramp: all of the light comes from its very foot.
#[test]
fn a_cliff_of_extinction_shows_its_foot() {
    // The integral of k x^2 exp(-k x^2 / 2) is sqrt(pi / (2 k)).
    let expected = (std::f64::consts::PI / 2e12).sqrt();
    // Rising with the value, and rising against it: the foot is a difference of large numbers then.
    let rising = (0.0, [(0.0, [0.0; 3], 0.0), (1.0, [1.0; 3], 1e12)]);
    let falling = (1.0, [(0.0, [1.0; 3], 1e12), (1.0, [0.0; 3], 0.0)]);
    for (first, points) in [rising, falling] {
        let value = |x, _, _| (x as f32 - first as f32).abs();
        let ramp = voxels([2, 1, 1], rows([1.0; 3], [0.0; 3]), value);
        let scene = volume(&[([0.0, 1.0], transfer(&points))]);
        let got = one_pixel(DVec3::new(-1.0, 0.5, 0.5), DVec3::X, &scene, &ramp);
        assert!((got[0] / expected - 1.0).abs() < 1e-6, "{} is not {expected}", got[0]);
        assert!((got[0] - expected).abs() < 1e-12 && got[3] == 1.0, "{got:?}");
    }
}

/// u16 and i16 channels, their sum and an rgba channel beside them.
#[test]
fn every_format_is_read() {
    let mut all = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| 0.25);
    all.channels.push(channel(Voxels::U8(vec![64; 8])));
    all.channels.push(channel(Voxels::U16(vec![40_000; 8])));
    all.channels.push(channel(Voxels::I16(vec![-20_000; 8])));
    all.channels.push(channel(Voxels::Rgba8(vec![[0, 255, 0, 51]; 8])));
    let linear = || transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 1.0)]);
    let scene = volume(&[
        ([0.0, 1.0], linear()),
        ([0.0, 256.0], linear()),
        ([0.0, 64_000.0], linear()),
        ([-32_000.0, 0.0], linear()),
        ([0.0, 255.0], linear()),
    ]);
    let got = one_pixel(DVec3::new(-1.0, 1.0, 1.0), DVec3::X, &scene, &all);
    let white = 0.25 + 0.25 + 0.625 + 0.375;
    let opacity = -(-2.0_f64 * (white + 0.2)).exp_m1();
    assert!((got[3] - opacity).abs() < 1e-12, "{got:?}");
    assert!((got[0] - opacity * white / (white + 0.2)).abs() < 1e-12, "{got:?}");
    assert!((got[1] - opacity).abs() < 1e-12, "{got:?}");
}
