//! The reference against a second integrator that shares no part with it (`second_truth/integral.rs`),
//! to 1e-10 in premultiplied rgb and alpha, over thousands of random rays of made and real scenes.

#[path = "second_truth/integral.rs"]
mod integral;
mod random;
mod truth;

use std::cell::RefCell;
use std::path::Path;

use ashfall::cli::load_scene;
use ashfall::reference::Truth;
use ashfall::scene::{Overrides, Projection, TransferFunction, View, Volume};
use ashfall::volume::{VolumeVoxels, Voxels};
use glam::DVec3;
use random::Random;
use truth::{channel, rows, transfer, volume, voxels};

const CLOSE: f64 = 1e-10;
/// Of rays: they are few among so many pixels that no two are alike.
const SIZE: [u32; 2] = [2011, 1499];

struct Case {
    name: String,
    scenes: Vec<Volume>,
    voxels: Vec<VolumeVoxels>,
    views: Vec<View>,
}

/// The greatest difference over `rays` random pixels of each view, and how many showed something.
fn worst(case: &Case, rays: usize, random: &mut Random) -> (f64, usize) {
    let volumes: Vec<_> = case.scenes.iter().zip(&case.voxels).collect();
    let (mut worst, mut seen) = (0.0_f64, 0);
    for view in &case.views {
        let truth = Truth::new(view, SIZE, [0.0; 3], &volumes, 1e-13);
        for _ in 0..rays {
            let [column, row] = SIZE.map(|edge| (random.unit() * f64::from(edge)) as u32);
            let got = truth.pixel(column, row);
            let expected = integral::pixel(view, SIZE, (column, row), &volumes);
            let differ = (0..4).map(|c| (got[c] - expected[c]).abs());
            // NaN would hide in a maximum.
            let differ = differ.map(|d| if d.is_finite() { d } else { f64::INFINITY });
            worst = worst.max(differ.fold(0.0, f64::max));
            seen += usize::from(expected[3] > 1e-3);
        }
    }
    (worst, seen)
}

fn assert_agree(cases: &[Case], rays: usize) {
    let mut random = Random(2026);
    let mut of_all = 0.0_f64;
    for case in cases {
        let (worst, seen) = worst(case, rays, &mut random);
        let count = rays * case.views.len();
        println!("{}: {worst:.1e} over {count} rays, {seen} of them not empty", case.name);
        assert!(seen * 8 >= count, "{}: {seen} of {count} rays show anything", case.name);
        assert!(worst <= CLOSE, "{}: {worst:.1e}", case.name);
        of_all = of_all.max(worst);
    }
    println!("worst of {} scenes: {of_all:.1e}", cases.len());
}

/// From `from` towards the middle of the first volume's box.
fn view(voxels: &VolumeVoxels, from: DVec3, projection: Projection) -> View {
    let size = DVec3::from_array(voxels.size.to_array().map(f64::from));
    let middle = voxels.world_from_voxel.point(0.5 * size);
    let up = DVec3::new(0.03, 1.0, 0.1);
    View::looking_at("a".to_owned(), from, middle, up, projection).expect("a good view")
}

/// One from outside in perspective, one with parallel rays, one from within.
fn three_views(voxels: &VolumeVoxels, random: &mut Random) -> Vec<View> {
    let size = DVec3::from_array(voxels.size.to_array().map(f64::from));
    let map = &voxels.world_from_voxel;
    let middle = map.point(0.5 * size);
    let wide = map.vector(size).length();
    let mut away = || {
        let [x, y, z] = [(); 3].map(|()| random.between(-1.0, 1.0));
        DVec3::new(x, y, z + 1.1).normalize()
    };
    let (far, parallel) = (middle + 2.0 * wide * away(), middle + wide * away());
    let inside = map.point(size * DVec3::new(0.3, 0.41, 0.37));
    vec![
        view(voxels, far, Projection::Perspective { fov_degrees: 16.0 }),
        view(voxels, parallel, Projection::Orthographic { height: 0.35 * wide }),
        view(voxels, inside, Projection::Frustum { bounds: [-0.9, 1.2, -0.7, 0.8] }),
    ]
}

fn random_transfer(random: &mut Random, jumps: bool, most: f64) -> TransferFunction {
    let mut at: Vec<f64> = (0..6).map(|_| random.between(0.02, 0.98)).collect();
    at.sort_by(f64::total_cmp);
    if jumps {
        (at[1], at[5]) = (at[0], at[4]);
    }
    let points: Vec<_> = at
        .iter()
        .map(|at| {
            let extinction = random.between(-0.3, 1.0).max(0.0) * most;
            (*at, [(); 3].map(|()| random.unit()), extinction)
        })
        .collect();
    transfer(&points)
}

fn noise(size: [u32; 3], rows: [[f64; 4]; 3], random: &mut Random) -> VolumeVoxels {
    let random = RefCell::new(random);
    voxels(size, rows, |_, _, _| random.borrow_mut().unit() as f32)
}

/// Two overlapping sheared volumes, three channels, one of them RGBA, jumps, a negative slope.
fn several(seed: u64) -> Case {
    let random = &mut Random(seed);
    let scenes = vec![
        volume(&[([0.1, 0.8], random_transfer(random, true, 2.0))]),
        volume(&[
            ([-1.0, 1.0], random_transfer(random, false, 2.0)),
            ([0.0, 255.0], random_transfer(random, seed.is_multiple_of(2), 2.0)),
        ]),
    ];
    let mut sheared = |origin: [f64; 3]| {
        let mut sheared = rows([0.8, 1.0, 1.3], origin);
        let entries = sheared.iter_mut().flat_map(|row| &mut row[..3]);
        entries.for_each(|entry| *entry += random.between(-0.35, 0.35));
        sheared
    };
    let places = [sheared([0.0; 3]), sheared([1.0, 1.5, 0.5])];
    let mut voxels = places.map(|rows| noise([4, 6, 5], rows, random)).to_vec();
    (voxels[1].channels[0].slope, voxels[1].channels[0].intercept) = (-2.0, 1.0);
    let rgba = (0..120).map(|_| [(); 4].map(|()| (random.unit() * 256.0) as u8)).collect();
    voxels[1].channels.push(channel(Voxels::Rgba8(rgba)));
    let views = three_views(&voxels[0], random);
    Case { name: format!("two volumes, seed {seed}"), scenes, voxels, views }
}

/// One volume of one channel from three sides.
fn one(
    name: &str,
    seed: u64,
    (size, rows): ([u32; 3], [[f64; 4]; 3]),
    (window, transfer): ([f64; 2], TransferFunction),
    stored: impl Fn(&mut Random) -> f32,
) -> Case {
    let random = &mut Random(seed);
    let mut made = noise(size, rows, random);
    let Voxels::F32(values) = &mut made.channels[0].voxels else { unreachable!("as made") };
    values.iter_mut().for_each(|value| *value = stored(random));
    let views = three_views(&made, random);
    let scenes = vec![volume(&[(window, transfer)])];
    Case { name: name.to_owned(), scenes, voxels: vec![made], views }
}

fn made() -> Vec<Case> {
    let mut random = Random(77);
    let mut curve = |jumps: bool, most: f64| random_transfer(&mut random, jumps, most);
    let cube = ([7, 6, 8], rows([0.5, 0.7, 0.6], [0.0; 3]));
    let unit = |random: &mut Random| random.unit() as f32;
    let ramp = transfer(&[(0.0, [0.9, 0.5, 0.1], 0.1), (1.0, [0.1, 0.5, 0.9], 1.0)]);
    let stairs: Vec<(f64, [f64; 3], f64)> = (0..16_u32)
        .map(|i| {
            let high = f64::from(i % 3);
            (f64::from(i.div_ceil(2)) / 8.0, [high / 2.0, 0.5, 1.0 - high / 2.0], high)
        })
        .collect();
    let survey = [[12.5, 3.0, 0.0, 5e5], [-3.0, 12.5, 0.0, 6.7e6], [0.0, 0.0, -4.0, -900.0]];
    let mirrored = [[-0.5, 0.2, 0.0, 3.0], [0.0, 0.7, 0.1, 1.0], [0.1, 0.0, -0.6, 9.0]];
    let few = |random: &mut Random| [0.0, 0.25, 0.5, 1.0][(random.unit() * 4.0) as usize];
    let holes = |random: &mut Random| match random.unit() {
        u if u < 0.03 => f32::NAN,
        u if u < 0.05 => f32::INFINITY,
        u if u < 0.07 => f32::NEG_INFINITY,
        _ => random.unit() as f32,
    };
    let extremes = |random: &mut Random| match random.unit() {
        u if u < 0.2 => f32::MAX,
        u if u < 0.3 => -f32::MAX,
        u if u < 0.5 => 1e-42,
        _ => random.unit() as f32,
    };
    let mut cases: Vec<Case> = (1..=12).map(several).collect();
    cases.extend([
        one("smooth", 1, cube, ([0.0, 1.0], curve(false, 2.0)), unit),
        one("jumps", 2, cube, ([0.0, 1.0], curve(true, 2.0)), unit),
        one("stairs", 3, cube, ([0.0, 1.0], transfer(&stairs)), unit),
        one("clamped on both sides", 4, cube, ([0.45, 0.55], curve(true, 2.0)), unit),
        one("window beyond the values", 5, cube, ([-0.9, 2.4], ramp.clone()), unit),
        one("constant", 6, cube, ([0.0, 1.0], ramp), |_| 0.6),
        one("constant on a jump", 7, cube, ([0.0, 1.0], transfer(&stairs)), |_| 0.5),
        one("few values, on points", 8, cube, ([0.0, 1.0], transfer(&stairs)), few),
        one("thin haze", 9, cube, ([0.0, 1.0], curve(true, 2e-2)), unit),
        one("nearly opaque", 10, cube, ([0.0, 1.0], curve(true, 1e4)), unit),
        one("mirrored and sheared", 11, (cube.0, mirrored), ([0.0, 1.0], curve(true, 2.0)), unit),
        one("survey", 12, ([9, 8, 7], survey), ([0.0, 1.0], curve(true, 0.02)), unit),
        one("NaN and infinite", 13, cube, ([0.0, 1.0], curve(true, 2.0)), holes),
        one("f32's whole range", 14, cube, ([0.0, 1.0], curve(true, 2.0)), extremes),
        one("one voxel", 15, ([1; 3], cube.1), ([0.0, 1.0], curve(false, 2.0)), |_| 0.4),
        one("a sheet", 16, ([9, 1, 11], cube.1), ([0.0, 1.0], curve(true, 2.0)), unit),
    ]);
    let uneven = ([6, 5, 4], rows([1.0, 1000.0, 30.0], [0.0; 3]));
    cases.push(one("spacing 1 to 1000", 17, uneven, ([0.0, 1.0], curve(true, 2e-3)), unit));
    // Along an axis, not within faces: two directions stay zero.
    let mut along = one("along an axis", 18, cube, ([0.0, 1.0], curve(true, 2.0)), unit);
    let eye = DVec3::new(-3.0, 2.11, 2.43);
    let axis = View::looking_at(
        "axis".to_owned(),
        eye,
        eye + DVec3::X,
        DVec3::Y,
        Projection::Orthographic { height: 2.0 },
    );
    along.views = vec![axis.expect("a good view")];
    cases.push(along);
    cases
}

#[test]
fn made_scenes_agree() {
    assert_agree(&made(), 300);
}

#[test]
fn computed_volumes_agree() {
    let mut random = Random(5);
    let cases: Vec<Case> = ["marschner-lobb", "shells", "hydrogen", "checkerboard", "ramp"]
        .into_iter()
        .map(|kind| {
            let size = ashfall::volume::Size3::new(40, 33, 29);
            let map = ashfall::volume::WorldFromVoxel::from_rows(rows([0.1; 3], [0.0; 3]));
            let field = ashfall::source::computed(kind, size).expect("a known kind");
            let made = field.whole(map.expect("a good transform")).expect("it fits");
            let top = if ["hydrogen", "shells"].contains(&kind) { 255.0 } else { 1.0 };
            let views = three_views(&made, &mut random);
            let curve = transfer(&[
                (0.0, [0.1, 0.2, 0.8], 0.0),
                (0.3, [0.2, 0.7, 0.4], 0.5),
                (0.3, [0.9, 0.7, 0.4], 1.5),
                (1.0, [1.0, 0.9, 0.8], 2.0),
            ]);
            let scenes = vec![volume(&[([0.0, top], curve)])];
            Case { name: kind.to_owned(), scenes, voxels: vec![made], views }
        })
        .collect();
    assert_agree(&cases, 200);
}

fn loaded(path: &Path) -> Case {
    let data = load_scene(path, &Overrides::default());
    let data = data.unwrap_or_else(|why| panic!("{why}"));
    let whole = |index: usize| data.whole(index).unwrap_or_else(|why| panic!("{why}"));
    let voxels = (0..data.volumes.len()).map(|index| (*whole(index)).clone()).collect();
    let (scenes, views) = (data.scene.volumes.clone(), data.scene.views.clone());
    Case { name: path.file_stem().unwrap_or_default().display().to_string(), scenes, voxels, views }
}

#[test]
fn real_scenes_agree() {
    let Some(shared) = truth::shared() else { return };
    let scenes = ["bonsai", "engine", "stent", "mni152", "dna_2_channels", "aneurism"];
    let mut cases: Vec<Case> = Vec::new();
    for scene in scenes {
        cases.push(loaded(&shared.join(format!("data/scenes/{scene}.toml"))));
    }
    for name in ["sparse", "linear"] {
        let (scene, made) = truth::synth256(&shared, name);
        let (scenes, views) = (scene.volumes, scene.views);
        cases.push(Case { name: format!("synth256 {name}"), scenes, voxels: vec![made], views });
    }
    assert_agree(&cases, 600);
}

/// What a comparison to 1e-10 is worth: one voxel of 240 moved by 1e-7, an extinction by 1e-9.
#[test]
fn a_small_fault_is_seen() {
    let case = several(3);
    let (sound, _) = worst(&case, 100, &mut Random(9));
    assert!(sound <= CLOSE, "{sound:.1e}");
    let volumes: Vec<_> = case.scenes.iter().zip(&case.voxels).collect();
    let mut moved = case.voxels.clone();
    let Voxels::F32(values) = &mut moved[0].channels[0].voxels else { unreachable!("as made") };
    values[51] += 1e-7;
    let mut thicker = case.scenes.clone();
    let points = thicker[1].channels[0].transfer.points();
    let points: Vec<_> =
        points.iter().map(|p| (p.at, p.color, p.extinction * (1.0 + 1e-9))).collect();
    thicker[1].channels[0].transfer = transfer(&points);
    let faults: [Vec<(&Volume, &VolumeVoxels)>; 2] =
        [case.scenes.iter().zip(&moved).collect(), thicker.iter().zip(&case.voxels).collect()];
    for fault in faults {
        let mut random = Random(9);
        let mut worst = 0.0_f64;
        for _ in 0..100 {
            let [column, row] = SIZE.map(|edge| (random.unit() * f64::from(edge)) as u32);
            let faulty = Truth::new(&case.views[0], SIZE, [0.0; 3], &fault, 1e-13);
            let got = faulty.pixel(column, row);
            let expected = integral::pixel(&case.views[0], SIZE, (column, row), &volumes);
            worst = (0..4).map(|c| (got[c] - expected[c]).abs()).fold(worst, f64::max);
        }
        println!("a planted fault differs by {worst:.1e}");
        assert!(worst > CLOSE, "{worst:.1e} is not seen");
    }
}

/// Typed wrongly, a node or a weight would only make the second integrator halve more often.
#[test]
fn the_rules_have_their_degrees() {
    for power in 0..=22 {
        let exact = if power % 2 == 0 { 2.0 / f64::from(power + 1) } else { 0.0 };
        let (mut kronrod, mut gauss) = (0.0, 0.0);
        for (index, node) in integral::NODES.iter().enumerate() {
            for x in [-node, *node].into_iter().take(8 - index) {
                kronrod += integral::KRONROD[index] * x.powi(power);
                if index % 2 == 1 {
                    gauss += integral::GAUSS[index / 2] * x.powi(power);
                }
            }
        }
        assert!((kronrod - exact).abs() < 4e-16, "Kronrod, power {power}: {kronrod}");
        assert!(power > 13 || (gauss - exact).abs() < 4e-16, "Gauss, power {power}: {gauss}");
    }
}
