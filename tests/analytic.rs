//! The reference against closed forms, to 1e-10.

mod truth;

use ashfall::reference::Truth;
use ashfall::scene::{Projection, View, Volume};
use ashfall::volume::{VolumeVoxels, Voxels};
use glam::DVec3;
use truth::{channel, rows, transfer, volume, voxels};

const TOLERANCE: f64 = 1e-12;
const CLOSE: f64 = 1e-10;
const RED: [f64; 3] = [1.0, 0.25, 0.0];
const BLUE: [f64; 3] = [0.0, 0.5, 1.0];

fn looking(eye: [f64; 3], target: [f64; 3], projection: Projection) -> View {
    let up = DVec3::new(0.0, 1.0, 0.013);
    let (eye, target) = (DVec3::from_array(eye), DVec3::from_array(target));
    View::looking_at("test".to_owned(), eye, target, up, projection).expect("a good view")
}

/// One orthographic ray from `eye` along +x.
fn along_x(eye: [f64; 3], volumes: &[(&Volume, &VolumeVoxels)]) -> [f64; 4] {
    let view =
        looking(eye, [eye[0] + 1.0, eye[1], eye[2]], Projection::Orthographic { height: 1e-3 });
    Truth::new(&view, [1, 1], [0.0; 3], volumes, TOLERANCE).pixel(0, 0)
}

fn assert_close(what: &str, got: [f64; 4], color: [f64; 3], depth: f64) {
    let expected = [color[0], color[1], color[2], -(-depth).exp_m1()];
    for c in 0..4 {
        let error = (got[c] - expected[c]).abs();
        assert!(error < CLOSE, "{what}: got {got:?}, expected {expected:?}");
    }
    let worst = (0..4).map(|c| (got[c] - expected[c]).abs()).fold(0.0, f64::max);
    println!("{what}: {worst:.1e}");
}

fn scaled(color: [f64; 3], factor: f64) -> [f64; 3] {
    color.map(|c| c * factor)
}

fn opacity(depth: f64) -> f64 {
    -(-depth).exp_m1()
}

/// Colour `RED` and extinction `extinction` whatever the value.
fn even(extinction: f64) -> Volume {
    volume(&[([0.0, 1.0], transfer(&[(0.5, RED, extinction)]))])
}

#[test]
fn a_constant_slab_at_any_extinction() {
    let slab = voxels([4, 3, 5], rows([0.5, 1.0, 2.0], [0.0; 3]), |_, _, _| 1.0);
    for extinction in [0.0, 1e-12, 1e-3, 0.7, 40.0, 1e4, 1e12, 1e24] {
        let depth = 2.0 * extinction;
        let got = along_x([-3.0, 1.2, 4.4], &[(&even(extinction), &slab)]);
        assert_close(&format!("slab {extinction}"), got, scaled(RED, opacity(depth)), depth);
    }
}

#[test]
fn a_thin_haze_keeps_its_digits() {
    let slab = voxels([4, 3, 5], rows([0.5, 1.0, 2.0], [0.0; 3]), |_, _, _| 1.0);
    let got = along_x([-3.0, 1.2, 4.4], &[(&even(1e-12), &slab)]);
    assert!((got[0] / 2e-12 - 1.0).abs() < 1e-11 && (got[3] / 2e-12 - 1.0).abs() < 1e-11);
}

#[test]
fn the_background_shines_through() {
    let slab = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| 1.0);
    let view = looking([-1.0, 1.0, 1.0], [0.0, 1.0, 1.0], Projection::Orthographic { height: 0.1 });
    let scene = even(0.3);
    let got = Truth::new(&view, [1, 1], [0.5, 1.0, 2.0], &[(&scene, &slab)], TOLERANCE).pixel(0, 0);
    let clear = (-0.6_f64).exp();
    let color = std::array::from_fn(|c| RED[c] * (1.0 - clear) + [0.5, 1.0, 2.0][c] * clear);
    assert_close("background", got, color, 0.6);
    let beside = looking([-1.0, 9.0, 1.0], [0.0, 9.0, 1.0], view.projection);
    let missed = Truth::new(&beside, [1, 1], [0.5, 1.0, 2.0], &[(&scene, &slab)], TOLERANCE);
    assert_eq!(missed.pixel(0, 0), [0.5, 1.0, 2.0, 0.0]);
}

#[test]
fn an_eye_inside_sees_what_is_before_it() {
    let slab = voxels([8, 8, 8], rows([1.0; 3], [0.0; 3]), |_, _, _| 1.0);
    let scene = even(0.3);
    let got = along_x([2.25, 4.0, 4.0], &[(&scene, &slab)]);
    assert_close("inside", got, scaled(RED, opacity(0.3 * 5.75)), 0.3 * 5.75);
    assert_close("behind", along_x([8.5, 4.0, 4.0], &[(&scene, &slab)]), [0.0; 3], 0.0);
}

/// Value x / 8 between the outermost centres, extinction proportional to the value.
#[test]
fn a_linear_ramp() {
    let ramp = voxels([9, 2, 2], rows([0.25, 1.0, 1.0], [0.0; 3]), |x, _, _| x as f32 / 8.0);
    let scene = volume(&[([0.0, 1.0], transfer(&[(0.0, RED, 0.0), (1.0, RED, 3.0)]))]);
    // Half a voxel of 0, a ramp over 2 world units, half a voxel of 3.
    let depth = 3.0 + 0.125 * 3.0;
    let got = along_x([-1.0, 1.0, 1.0], &[(&scene, &ramp)]);
    assert_close("ramp", got, scaled(RED, opacity(depth)), depth);
    // Clamped by its window: 0 up to x = 1/4, then twice as steep, then 1 from 3/4 on.
    let clamped = volume(&[([0.25, 0.75], transfer(&[(0.0, RED, 0.0), (1.0, RED, 3.0)]))]);
    let depth = 0.5 * 3.0 + (0.5 + 0.125) * 3.0;
    let got = along_x([-1.0, 1.0, 1.0], &[(&clamped, &ramp)]);
    assert_close("clamped ramp", got, scaled(RED, opacity(depth)), depth);
    // Slope and intercept come before the window.
    let mut stored = ramp.clone();
    (stored.channels[0].slope, stored.channels[0].intercept) = (-2.0, 7.0);
    let turned = volume(&[([5.0, 7.0], transfer(&[(0.0, RED, 3.0), (1.0, RED, 0.0)]))]);
    let depth = 3.0 + 0.125 * 3.0;
    let got = along_x([-1.0, 1.0, 1.0], &[(&turned, &stored)]);
    assert_close("scaled ramp", got, scaled(RED, opacity(depth)), depth);
}

/// Extinction k and colour (1 - u) RED + u BLUE with u = x / length: the integral of
/// k exp(-k x) (x / length) is (1 - exp(-kL) (1 + kL)) / (kL).
#[test]
fn an_exponential_with_a_colour_that_changes() {
    let ramp =
        voxels([9, 2, 2], rows([0.25, 1.0, 1.0], [-0.125, 0.0, 0.0]), |x, _, _| x as f32 / 8.0);
    for k in [1e-3, 0.4, 3.0, 50.0, 1e5] {
        let scene = volume(&[([0.0, 1.0], transfer(&[(0.0, RED, k), (1.0, BLUE, k)]))]);
        // The eye on the first centre; half a voxel of BLUE behind the last.
        let got = along_x([0.0, 1.0, 1.0], &[(&scene, &ramp)]);
        let (kl, tail) = (2.0 * k, 0.125 * k);
        let blue = if kl < 0.01 {
            kl / 2.0 - kl * kl / 3.0 + kl.powi(3) / 8.0 - kl.powi(4) / 30.0
        } else {
            (1.0 - (-kl).exp() * (1.0 + kl)) / kl
        };
        let behind = (-kl).exp() * opacity(tail);
        let red = opacity(kl) - blue;
        let color = std::array::from_fn(|c| RED[c] * red + BLUE[c] * (blue + behind));
        assert_close(&format!("exponential {k}"), got, color, kl + tail);
    }
}

/// One voxel of value 1 behind one of value 0, told apart by a jump of the transfer function.
#[test]
fn a_slab_behind_a_slab() {
    let step = voxels([2, 1, 1], rows([1.0; 3], [0.0; 3]), |x, _, _| x as f32);
    let jump = transfer(&[(0.0, RED, 0.5), (0.3, RED, 0.5), (0.3, BLUE, 2.0), (1.0, BLUE, 2.0)]);
    let scene = volume(&[([0.0, 1.0], jump)]);
    // The value is 0.3 at x = 0.8.
    let (front, back) = (0.5 * 0.8, 2.0 * 1.2);
    let color =
        std::array::from_fn(|c| RED[c] * opacity(front) + BLUE[c] * opacity(back) * (-front).exp());
    let got = along_x([-5.0, 0.4, 0.6], &[(&scene, &step)]);
    assert_close("slab behind slab", got, color, front + back);
}

#[test]
fn two_volumes_one_behind_the_other_and_one_in_the_other() {
    let front = voxels([3, 3, 3], rows([1.0; 3], [0.0; 3]), |_, _, _| 1.0);
    let back = voxels([2, 2, 2], rows([2.0; 3], [5.0, 0.0, 0.0]), |_, _, _| 1.0);
    let (red, blue) = (even(0.4), volume(&[([0.0, 1.0], transfer(&[(0.0, BLUE, 0.2)]))]));
    let color =
        std::array::from_fn(|c| RED[c] * opacity(1.2) + BLUE[c] * opacity(0.8) * (-1.2_f64).exp());
    let volumes = [(&blue, &back), (&red, &front)];
    assert_close("behind", along_x([-2.0, 1.0, 1.0], &volumes), color, 2.0);
    // Overlapping from x = 1 to 3: extinctions add up, colours mix by extinction.
    let inner = voxels([4, 2, 2], rows([0.5, 2.0, 2.0], [1.0, 0.0, 0.0]), |_, _, _| 1.0);
    let got = along_x([-2.0, 1.0, 1.0], &[(&red, &front), (&blue, &inner)]);
    let color = std::array::from_fn(|c| {
        let mixed = (RED[c] * 0.4 + BLUE[c] * 0.2) / 0.6;
        RED[c] * opacity(0.4) + mixed * opacity(1.2) * (-0.4_f64).exp()
    });
    assert_close("overlapping", got, color, 1.6);
    // The same as two channels of one volume.
    let mut both = voxels([3, 3, 3], rows([1.0; 3], [0.0; 3]), |_, _, _| 1.0);
    both.channels.push(channel(Voxels::U8(vec![200; 27])));
    let scene = volume(&[
        ([0.0, 1.0], transfer(&[(0.0, RED, 0.4)])),
        ([0.0, 255.0], transfer(&[(0.0, BLUE, 0.2)])),
    ]);
    let mixed = std::array::from_fn(|c| (RED[c] * 0.4 + BLUE[c] * 0.2) / 0.6 * opacity(1.8));
    assert_close("two channels", along_x([-2.0, 1.0, 1.0], &[(&scene, &both)]), mixed, 1.8);
}

#[test]
fn at_a_jump_the_later_point_holds() {
    let jump = transfer(&[(0.0, RED, 0.5), (0.5, RED, 0.5), (0.5, BLUE, 2.0), (1.0, BLUE, 2.0)]);
    let scene = volume(&[([0.0, 1.0], jump)]);
    let at = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| 0.5);
    let got = along_x([-1.0, 1.0, 1.0], &[(&scene, &at)]);
    assert_close("at the jump", got, scaled(BLUE, opacity(4.0)), 4.0);
    let below = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| 0.499_999_97);
    let got = along_x([-1.0, 1.0, 1.0], &[(&scene, &below)]);
    assert_close("below the jump", got, scaled(RED, opacity(1.0)), 1.0);
    // A window clamps to the ends, where jumps hold as anywhere.
    let ends = transfer(&[(0.0, RED, 0.0), (0.0, RED, 0.5), (1.0, RED, 0.5), (1.0, BLUE, 2.0)]);
    let scene = volume(&[([0.0, 1.0], ends)]);
    for (value, color, depth) in
        [(-3.0, RED, 1.0), (0.0, RED, 1.0), (1.0, BLUE, 4.0), (9.0, BLUE, 4.0)]
    {
        let slab = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| value);
        let got = along_x([-1.0, 1.0, 1.0], &[(&scene, &slab)]);
        assert_close(&format!("clamped {value}"), got, scaled(color, opacity(depth)), depth);
    }
}

#[test]
fn one_voxel_seen_from_everywhere() {
    let one = voxels([1, 1, 1], rows([1.0, 2.0, 3.0], [10.0, 20.0, 30.0]), |_, _, _| 0.7);
    let scene = even(0.9);
    let got = along_x([0.0, 21.0, 31.0], &[(&scene, &one)]);
    assert_close("one voxel", got, scaled(RED, opacity(0.9)), 0.9);
    // Corner to corner, 14 ^ 1/2 long, in perspective.
    let view = looking(
        [9.0, 18.0, 27.0],
        [10.5, 21.0, 31.5],
        Projection::Perspective { fov_degrees: 1.0 },
    );
    let got = Truth::new(&view, [1, 1], [0.0; 3], &[(&scene, &one)], TOLERANCE).pixel(0, 0);
    let depth = 0.9 * 14.0_f64.sqrt();
    assert_close("diagonal", got, scaled(RED, opacity(depth)), depth);
}

/// A perspective pixel off the axis crosses a slab on a longer way: length / cosine.
#[test]
fn perspective_rays_are_longer_off_the_axis() {
    let slab = voxels([3, 40, 40], rows([1.0, 1.0, 1.0], [5.0, -20.0, -20.0]), |_, _, _| 1.0);
    let projection = Projection::Perspective { fov_degrees: 90.0 };
    let view = looking([0.0; 3], [1.0, 0.0, 0.0], projection);
    let scene = even(0.2);
    let truth = Truth::new(&view, [4, 4], [0.0; 3], &[(&scene, &slab)], TOLERANCE);
    for (column, row) in [(0, 0), (1, 2), (3, 1)] {
        let across = (f64::from(column) + 0.5) / 2.0 - 1.0;
        let down = (f64::from(row) + 0.5) / 2.0 - 1.0;
        let depth = 0.2 * 3.0 * (1.0_f64 + across * across + down * down).sqrt();
        let got = truth.pixel(column, row);
        assert_close(&format!("pixel {column}, {row}"), got, scaled(RED, opacity(depth)), depth);
    }
}

#[test]
fn nothing_is_there_in_cells_with_a_nan_corner() {
    // Voxel 2 of 5 is NaN: the cells between centres 1.5 and 3.5 are empty.
    let holed =
        voxels([5, 1, 1], rows([1.0; 3], [0.0; 3]), |x, _, _| if x == 2 { f32::NAN } else { 1.0 });
    let got = along_x([-1.0, 0.5, 0.5], &[(&even(0.5), &holed)]);
    assert_close("NaN", got, scaled(RED, opacity(1.5)), 1.5);
    let all = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| f32::NAN);
    assert_eq!(along_x([-1.0, 1.0, 1.0], &[(&even(0.5), &all)]), [0.0; 4]);
}

#[test]
fn infinities_are_the_largest_finite_values() {
    // From -max to max in one voxel: the window is crossed at once, in the middle.
    let scene = volume(&[(
        [0.0, 1.0],
        transfer(&[(0.0, RED, 0.5), (0.5, [1e3; 3], 1e12), (1.0, BLUE, 2.0)]),
    )]);
    let extreme = voxels([2, 1, 1], rows([1.0; 3], [0.0; 3]), |x, _, _| {
        if x == 0 { f32::NEG_INFINITY } else { f32::INFINITY }
    });
    let color =
        std::array::from_fn(|c| RED[c] * opacity(0.5) + BLUE[c] * opacity(2.0) * (-0.5_f64).exp());
    assert_close("infinite", along_x([-1.0, 0.5, 0.5], &[(&scene, &extreme)]), color, 2.5);
    // From 0: the window ends at 3e-39 of the way.
    let half =
        voxels(
            [2, 1, 1],
            rows([1.0; 3], [0.0; 3]),
            |x, _, _| {
                if x == 0 { 0.0 } else { f32::INFINITY }
            },
        );
    assert_close(
        "half infinite",
        along_x([-1.0, 0.5, 0.5], &[(&scene, &half)]),
        color_of_half(),
        0.25 + 3.0,
    );
}

/// Half a voxel at RED 0.5, then one and a half at BLUE 2.
fn color_of_half() -> [f64; 3] {
    std::array::from_fn(|c| RED[c] * opacity(0.25) + BLUE[c] * opacity(3.0) * (-0.25_f64).exp())
}

/// A pixel of alpha u and rgb: its own colour times the transfer function's.
#[test]
fn an_rgba_channel_multiplies_colours() {
    let mut slab = voxels([2, 2, 2], rows([1.0; 3], [0.0; 3]), |_, _, _| 0.0);
    slab.channels = vec![channel(Voxels::Rgba8(vec![[255, 51, 0, 102]; 8]))];
    let scene =
        volume(&[([0.0, 255.0], transfer(&[(0.0, [0.0; 3], 0.0), (1.0, [1.0, 1.0, 1.0], 2.0)]))]);
    let got = along_x([-1.0, 1.0, 1.0], &[(&scene, &slab)]);
    assert_close("rgba", got, scaled([0.4, 0.08, 0.0], opacity(1.6)), 1.6);
    // rgb falls from 1 to 0 over one voxel while alpha stays: the integral of k exp(-k x) (1 - x).
    slab.channels =
        vec![channel(Voxels::Rgba8((0..8).map(|i| [255 * (1 - i % 2), 0, 0, 255]).collect()))];
    let got = along_x([0.5, 1.0, 1.0], &[(&scene, &slab)]);
    let k = 2.0_f64;
    let falling = 1.0 - opacity(k) / k;
    assert_close("falling rgba", got, [falling, 0.0, 0.0], k * 1.5);
}

#[test]
fn rays_within_faces_belong_to_the_upper_side() {
    let slab = voxels([4, 4, 4], rows([1.0; 3], [0.0; 3]), |_, _, _| 1.0);
    let scene = even(0.5);
    let exactly = |y: f64, z: f64| {
        let mut view = looking([-1.0, y, z], [0.0, y, z], Projection::Orthographic { height: 0.0 });
        (view.forward, view.right, view.up) = (DVec3::X, DVec3::Z, DVec3::Y);
        Truth::new(&view, [1, 1], [0.0; 3], &[(&scene, &slab)], TOLERANCE).pixel(0, 0)
    };
    for (y, z) in [(0.0, 0.0), (0.5, 0.5), (2.5, 3.5), (0.0, 2.0)] {
        assert_close(&format!("face {y}, {z}"), exactly(y, z), scaled(RED, opacity(2.0)), 2.0);
    }
    for (y, z) in [(4.0, 1.0), (1.0, 4.0), (-1e-300, 1.0)] {
        assert_eq!(exactly(y, z), [0.0; 4], "beside {y}, {z}");
    }
}
