//! The reference against a quadrature that knows no cells and no crossings, and against itself in
//! moved, turned, mirrored and permuted worlds.

mod random;
mod truth;

use ashfall::reference::{Settings, Truth, render};
use ashfall::scene::{Projection, RayFrame, View, Volume};
use ashfall::volume::{VolumeVoxels, Voxels, WorldFromVoxel};
use glam::{DAffine3, DMat3, DVec3};
use random::Random;
use truth::{channel, rows, transfer, volume, voxels};

/// Optical depth and premultiplied colour of a part of a ray.
type Part = [f64; 4];

fn joined(front: Part, back: Part) -> Part {
    let transmitted = (-front[0]).exp();
    let color = |c: usize| front[c] + transmitted * back[c];
    [front[0] + back[0], color(1), color(2), color(3)]
}

struct Slow<'a> {
    volumes: Vec<SlowVolume<'a>>,
    /// Origin and direction in world space.
    ray: (DVec3, DVec3),
}

struct SlowVolume<'a> {
    scene: &'a Volume,
    voxels: &'a VolumeVoxels,
    voxel_from_world: DAffine3,
    /// Red, green and blue of each channel as channels of their own, if it has any.
    rgb: Vec<Option<VolumeVoxels>>,
}

impl<'a> Slow<'a> {
    fn new(volumes: &[(&'a Volume, &'a VolumeVoxels)], ray: (DVec3, DVec3)) -> Slow<'a> {
        let rgb = |voxels: &VolumeVoxels, index: usize| match &voxels.channels[index].voxels {
            Voxels::Rgba8(rgba) => {
                let component =
                    |c| channel(Voxels::F32(rgba.iter().map(|p| f32::from(p[c])).collect()));
                Some(VolumeVoxels { channels: [0, 1, 2].map(component).into(), ..*voxels })
            }
            _ => None,
        };
        let volumes = volumes.iter().map(|&(scene, voxels)| SlowVolume {
            scene,
            voxels,
            voxel_from_world: voxels.world_from_voxel.voxel_from_world(),
            rgb: (0..voxels.channels.len()).map(|index| rgb(voxels, index)).collect(),
        });
        Slow { volumes: volumes.collect(), ray }
    }

    /// A part as if everything in it were as at one point.
    fn as_at(&self, at: f64, length: f64) -> Part {
        let position_world = self.ray.0 + self.ray.1 * at;
        let (mut extinction, mut emitted) = (0.0, [0.0; 3]);
        for volume in &self.volumes {
            let voxels = volume.voxels;
            let position = volume.voxel_from_world.transform_point3(position_world);
            let size = voxels.size.to_array().map(f64::from);
            if (0..3).any(|axis| position[axis] < 0.0 || position[axis] >= size[axis]) {
                continue;
            }
            for (index, channel) in volume.scene.channels.iter().enumerate() {
                let [low, high] = channel.window;
                let values = &voxels.channels[index];
                let value =
                    values.slope * truth::sampled(voxels, index, position) + values.intercept;
                let unit = ((value - low) / (high - low)).clamp(0.0, 1.0);
                let (mut color, here) = truth::classified(&channel.transfer, unit);
                if let Some(rgb) = &volume.rgb[index] {
                    (0..3).for_each(|c| color[c] *= truth::sampled(rgb, c, position) / 255.0);
                }
                extinction += here;
                (0..3).for_each(|c| emitted[c] += here * color[c]);
            }
        }
        if extinction == 0.0 {
            return [0.0; 4];
        }
        let depth = extinction * length;
        let weight = -(-depth).exp_m1() / extinction;
        [depth, weight * emitted[0], weight * emitted[1], weight * emitted[2]]
    }

    /// The midpoint rule, once.
    fn midpoint(&self, start: f64, end: f64) -> Part {
        self.as_at(0.5 * (start + end), (end - start) * self.ray.1.length())
    }

    /// The trapezoid rule, once.
    fn trapezoid(&self, start: f64, end: f64) -> Part {
        let [a, b] = [start, end].map(|at| self.as_at(at, (end - start) * self.ray.1.length()));
        std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
    }

    /// Halves until both halves and the whole agree, then extrapolates from them. The trapezoid rule
    /// has to agree as well: midpoints alone do not see a jump in the last quarter.
    fn part(&self, start: f64, end: f64, whole: Part) -> Part {
        let middle = 0.5 * (start + end);
        let (front, back) = (self.midpoint(start, middle), self.midpoint(middle, end));
        let halves = joined(front, back);
        let apart = |other: Part| (0..4).map(|k| (halves[k] - other[k]).abs()).fold(0.0, f64::max);
        let is_small = middle <= start || middle >= end;
        if is_small || apart(whole) < 1e-13 && apart(self.trapezoid(start, end)) < 1e-12 {
            return std::array::from_fn(|k| halves[k] + (halves[k] - whole[k]) / 3.0);
        }
        joined(self.part(start, middle, front), self.part(middle, end, back))
    }

    /// The pixel; the volumes lie between the ray parameters 0 and `far`.
    fn pixel(&self, far: f64) -> [f64; 4] {
        let parts = 500;
        let place = |i: u32| far * f64::from(i) / f64::from(parts);
        let one = |i| self.part(place(i), place(i + 1), self.midpoint(place(i), place(i + 1)));
        let [depth, r, g, b] = (0..parts).map(one).fold([0.0; 4], joined);
        [r, g, b, -(-depth).exp_m1()]
    }
}

/// Two overlapping sheared volumes of few random voxels; the second has two channels, one RGBA.
struct Random2 {
    scenes: [Volume; 2],
    voxels: [VolumeVoxels; 2],
    view: View,
}

fn random_scene(seed: u64) -> Random2 {
    let mut random = Random(seed);
    let mut points = |jump: bool| {
        let mut at: Vec<f64> = (0..5).map(|_| random.between(0.1, 0.9)).collect();
        at.sort_by(f64::total_cmp);
        if jump {
            at[2] = at[1];
        }
        let points: Vec<_> = at
            .iter()
            .enumerate()
            .map(|(i, at)| {
                let extinction = if i % 3 == 0 { 0.0 } else { random.between(0.0, 3.0) };
                (*at, [random.unit(), random.unit(), random.unit()], extinction)
            })
            .collect();
        transfer(&points)
    };
    let scenes = [
        volume(&[([0.0, 1.0], points(true))]),
        volume(&[([-1.0, 1.0], points(false)), ([0.0, 255.0], points(false))]),
    ];
    let mut cells = Random(seed + 1000);
    let mut sheared = |origin: [f64; 3]| {
        let mut sheared = rows([0.8, 1.0, 1.3], origin);
        sheared.iter_mut().for_each(|row| {
            row[..3].iter_mut().for_each(|entry| *entry += cells.between(-0.3, 0.3));
        });
        sheared
    };
    let transforms = [sheared([0.0; 3]), sheared([1.0, 1.5, 0.5])];
    let cells = std::cell::RefCell::new(cells);
    let value = |_, _, _| cells.borrow_mut().unit() as f32;
    let mut voxels = transforms.map(|rows| voxels([3, 4, 5], rows, value));
    (voxels[1].channels[0].slope, voxels[1].channels[0].intercept) = (-2.0, 1.0);
    let rgba = (0..60).map(|_| [(); 4].map(|()| (cells.borrow_mut().unit() * 255.0) as u8));
    voxels[1].channels.push(channel(Voxels::Rgba8(rgba.collect())));
    let view = View::looking_at(
        "random".to_owned(),
        DVec3::new(-4.0, 6.25, -5.5),
        DVec3::new(1.75, 2.0, 3.0),
        DVec3::Y,
        Projection::Perspective { fov_degrees: 40.0 },
    );
    Random2 { scenes, voxels, view: view.expect("a good view") }
}

impl Random2 {
    fn volumes(&self) -> [(&Volume, &VolumeVoxels); 2] {
        [(&self.scenes[0], &self.voxels[0]), (&self.scenes[1], &self.voxels[1])]
    }

    fn pixels(&self, tolerance: f64) -> Vec<[f64; 4]> {
        let settings = Settings { tolerance, threads: 2 };
        render(&self.view, [9, 7], [0.25, 0.5, 1.0], &self.volumes(), &settings, &|_| {}).rgba
    }
}

fn greatest_difference(some: &[[f64; 4]], others: &[[f64; 4]]) -> f64 {
    let pairs = some.iter().flatten().zip(others.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn adaptive_midpoints_agree() {
    for seed in 1..=4 {
        let scene = random_scene(seed);
        let volumes = scene.volumes();
        let frame: RayFrame = scene.view.ray_frame_world([9, 7]);
        let truth = Truth::new(&scene.view, [9, 7], [0.0; 3], &volumes, 1e-12);
        for (column, row) in [(4, 3), (3, 2), (5, 4)] {
            let expected = Slow::new(&volumes, frame.ray(column, row)).pixel(20.0);
            let got = truth.pixel(column, row);
            let difference = greatest_difference(&[got], &[expected]);
            println!("seed {seed}, pixel {column}, {row}: {got:.3?}, {difference:.1e}");
            assert!(expected[3] > 0.1, "an empty pixel shows nothing: {expected:?}");
            assert!(difference < 1e-10, "got {got:?}, expected {expected:?}");
        }
    }
}

#[test]
fn the_tolerance_is_kept() {
    for seed in 5..=12 {
        let scene = random_scene(seed);
        let exact = scene.pixels(1e-14);
        for tolerance in [1e-3, 1e-5, 1e-7, 1e-9, 1e-11] {
            let difference = greatest_difference(&scene.pixels(tolerance), &exact);
            assert!(difference <= tolerance, "seed {seed}: {difference:.1e} for {tolerance:.0e}");
        }
    }
}

#[test]
fn threads_and_single_pixels_make_no_difference() {
    let scene = random_scene(3);
    let picture = |threads| {
        let settings = Settings { tolerance: 1e-9, threads };
        let volumes = scene.volumes();
        let heard = std::sync::Mutex::new(Vec::new());
        let progress = |part: f64| heard.lock().expect("no panic").push(part);
        let picture = render(&scene.view, [9, 7], [0.0; 3], &volumes, &settings, &progress);
        let mut heard = heard.into_inner().expect("no panic");
        heard.sort_by(f64::total_cmp);
        assert_eq!((heard.len(), heard[6]), (7, 1.0));
        picture
    };
    let one = picture(1);
    assert_eq!(one.size, [9, 7]);
    assert_eq!(one, picture(3));
    assert_eq!(one, picture(100));
    let volumes = scene.volumes();
    let truth = Truth::new(&scene.view, [9, 7], [0.0; 3], &volumes, 1e-9);
    assert_eq!(one.rgba[2 * 9 + 5], truth.pixel(5, 2));
}

/// Runs a change of the world over camera and volumes; the picture must stay.
fn assert_invariant(what: &str, close: f64, change: impl Fn(&mut Random2)) {
    for seed in 20..24 {
        let mut scene = random_scene(seed);
        let before = scene.pixels(1e-13);
        change(&mut scene);
        let difference = greatest_difference(&before, &scene.pixels(1e-13));
        println!("{what}: {difference:.1e}");
        assert!(difference < close, "{what}: {difference:.1e}");
    }
}

fn map_world(scene: &mut Random2, map: impl Fn([f64; 4]) -> [f64; 4], of_columns: bool) {
    for voxels in &mut scene.voxels {
        let old = voxels.world_from_voxel.rows();
        let mut new = old;
        if of_columns {
            for c in 0..4 {
                let point = if c == 3 { 1.0 } else { 0.0 };
                let column = map([old[0][c], old[1][c], old[2][c], point]);
                (0..3).for_each(|r| new[r][c] = column[r]);
            }
        } else {
            new = old.map(&map);
        }
        voxels.world_from_voxel = WorldFromVoxel::from_rows(new).expect("still good");
    }
}

#[test]
fn a_world_far_away_looks_the_same() {
    // The volumes' origins and the eye have few digits, so that the move itself loses none.
    let offset = DVec3::new(f64::from(1 << 20), -f64::from(1 << 24), f64::from(1 << 22));
    assert_invariant("far away", 1e-12, |scene| {
        map_world(
            scene,
            |[x, y, z, w]| [x + offset.x * w, y + offset.y * w, z + offset.z * w, w],
            true,
        );
        scene.view.eye += offset;
    });
}

#[test]
fn a_turned_world_looks_the_same() {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    assert_invariant("turned", 1e-11, |scene| {
        map_world(
            scene,
            |[x, y, z, w]| {
                let turned = turn * DVec3::new(x, y, z);
                [turned.x, turned.y, turned.z, w]
            },
            true,
        );
        let view = &mut scene.view;
        view.eye = turn * view.eye;
        (view.forward, view.right, view.up) =
            (turn * view.forward, turn * view.right, turn * view.up);
    });
}

/// Voxels stored backwards along x and a transform that says so.
#[test]
fn a_mirrored_grid_looks_the_same() {
    assert_invariant("mirrored", 1e-11, |scene| {
        map_world(scene, |[x, y, z, t]| [-x, y, z, t + 3.0 * x], false);
        reorder(scene, |x, y, z| (2 - x) + 3 * (y + 4 * z));
    });
}

/// Voxels stored with z fastest and a transform that says so.
#[test]
fn a_permuted_grid_looks_the_same() {
    assert_invariant("permuted", 1e-11, |scene| {
        map_world(scene, |[x, y, z, t]| [z, x, y, t], false);
        for voxels in &mut scene.voxels {
            voxels.size = ashfall::volume::Size3::new(5, 3, 4);
        }
        reorder(scene, |z, x, y| x + 3 * (y + 4 * z));
    });
}

/// Fills each volume anew, voxel (x, y, z) from the given old place.
fn reorder(scene: &mut Random2, old_place: impl Fn(usize, usize, usize) -> usize) {
    for voxels in &mut scene.voxels {
        let [nx, ny, nz] = voxels.size.to_array().map(|edge| edge as usize);
        let places: Vec<usize> =
            (0..nx * ny * nz).map(|i| old_place(i % nx, i / nx % ny, i / nx / ny)).collect();
        for channel in &mut voxels.channels {
            channel.voxels = match &channel.voxels {
                Voxels::F32(v) => Voxels::F32(places.iter().map(|&i| v[i]).collect()),
                Voxels::Rgba8(v) => Voxels::Rgba8(places.iter().map(|&i| v[i]).collect()),
                other => other.clone(),
            };
        }
    }
}

/// A linear function of world position sampled on a sheared grid is that function still: a tent of
/// extinction over it has a closed form.
#[test]
fn a_sheared_grid_holds_a_linear_function() {
    let sheared = [[1.0, 0.25, -0.5, 0.0], [0.125, 1.0, 0.25, 0.0], [0.0, -0.25, 1.0, 0.0]];
    let mut grid = voxels([16, 16, 16], sheared, |_, _, _| 0.0);
    let centre = |i: usize| {
        let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(|v| v as f64 + 0.5);
        grid.world_from_voxel.point(DVec3::new(x, y, z))
    };
    // Exact in f32: all entries are eighths.
    let values = (0..4096).map(|i| centre(i).x as f32).collect();
    grid.channels = vec![channel(Voxels::F32(values))];
    let scene = volume(&[(
        [0.0, 16.0],
        transfer(&[(0.375, [1.0; 3], 0.0), (0.5, [1.0; 3], 0.8), (0.625, [1.0; 3], 0.0)]),
    )]);
    let middle = DVec3::new(8.0, 9.0, 6.0);
    for toward in [DVec3::X, DVec3::new(1.0, 0.5, -0.25), DVec3::new(-1.0, 0.25, 0.5)] {
        let view = View::looking_at(
            "sheared".to_owned(),
            middle - toward * 30.0,
            middle,
            DVec3::Y,
            Projection::Orthographic { height: 0.01 },
        );
        let view = view.expect("a good view");
        let volumes = [(&scene, &grid)];
        let got = Truth::new(&view, [1, 1], [0.0; 3], &volumes, 1e-12).pixel(0, 0);
        // The tent is 4 wide in world x and 0.8 high.
        let depth = 0.5 * 4.0 * 0.8 * toward.length();
        let opacity = -(-depth).exp_m1();
        let difference = greatest_difference(&[got], &[[opacity; 4]]);
        assert!(difference < 1e-10, "{toward}: {difference:.1e}");
    }
}
