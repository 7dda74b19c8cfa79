//! Computed volumes: values known in closed form, boxes, bounds.

mod random;
mod truth;

use ashfall::error::Exit;
use ashfall::source::{Computed, KINDS, computed};
use ashfall::volume::{Size3, ValueRange, VoxelFormat, Voxels, WorldFromVoxel};
use random::Random;

fn of(kind: &str, size: [u32; 3]) -> Computed {
    computed(kind, Size3::from_array(size)).expect("a known kind")
}

#[test]
fn an_unknown_kind_is_told_the_known_ones() {
    let error = computed("klein-bottle", Size3::cube(8)).expect_err("unknown");
    assert_eq!(error.exit, Exit::Input);
    assert_eq!(
        error.message,
        "computed volume \"klein-bottle\" is not known: use one of constant, ramp, shells, \
         checkerboard, marschner-lobb, hydrogen, mandelbulb"
    );
    for kind in KINDS {
        assert_eq!(of(kind, [3, 2, 1]).name(), kind);
        assert!(computed(kind, Size3::new(4, 0, 4)).is_err());
    }
}

#[test]
fn plain_kinds_have_the_values_they_state() {
    assert_eq!(of("constant", [2, 3, 4]).value(1, 2, 3), 1.0);
    let ramp = of("ramp", [5, 2, 2]);
    assert_eq!([0, 1, 2, 3, 4].map(|x| ramp.value(x, 1, 0)), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(of("ramp", [1, 1, 1]).value(0, 0, 0), 0.0);
    let board = of("checkerboard", [4, 4, 4]);
    assert_eq!([board.value(0, 0, 0), board.value(1, 0, 0), board.value(1, 1, 1)], [0.0, 1.0, 1.0]);
    // Of 129 voxels the 64th is the middle, and voxel 64 + k has radius 2 k / 129.
    let shells = of("shells", [129, 1, 1]);
    let expected =
        |k: f64, radius: f64| (255.0 - 255.0 * 64.0 * (k * 2.0 / 129.0 - radius).abs()).round();
    assert_eq!(shells.value(64, 0, 0), 0.0);
    assert_eq!(f64::from(shells.value(64 + 32, 0, 0)), expected(32.0, 0.5));
    assert_eq!(f64::from(shells.value(64 - 8, 0, 0)), expected(8.0, 0.125));
    assert_eq!(shells.value(64 + 12, 0, 0), 0.0);
}

#[test]
fn marschner_lobb_is_the_published_signal() {
    // At x = y = 0 the ripple is cos(12 pi) = 1; the middle voxel of an odd size is at 0.
    let volume = of("marschner-lobb", [41, 41, 41]);
    assert!((volume.value(20, 20, 20) - 0.6).abs() < 1e-7);
    let z = -1.0 + 1.0 / 41.0;
    let expected = (1.0 - (std::f64::consts::FRAC_PI_2 * z).sin() + 0.5) / 2.5;
    assert!((f64::from(volume.value(20, 20, 0)) - expected).abs() < 1e-7);
    assert_eq!(volume.format(), VoxelFormat::F32);
}

#[test]
fn hydrogen_has_two_lobes_a_ring_and_cones_without_density() {
    let n = 288;
    let volume = of("hydrogen", [n, n, n]);
    let at = |x: f64, y: f64, z: f64| {
        let voxel = |p: f64| ((p + 24.0) / 48.0 * f64::from(n)) as u32;
        volume.value(voxel(x), voxel(y), voxel(z))
    };
    assert!(at(0.0, 0.0, 6.0) >= 254.0 && at(0.0, 0.0, -6.0) >= 254.0);
    assert!((at(6.0, 0.0, 0.0) - 64.0).abs() <= 1.0, "the ring has a quarter");
    let cone = 6.0 / 3.0_f64.sqrt();
    assert!(at(cone, cone, cone) <= 1.0);
    assert!(at(0.0, 0.0, 23.9) == 0.0);
}

#[test]
fn the_mandelbulb_is_solid_inside_empty_outside_and_has_a_rim() {
    let volume = of("mandelbulb", [64, 64, 64]);
    assert!(volume.value(32, 32, 32) > 250.0);
    assert_eq!(volume.value(0, 0, 0), 0.0);
    assert_eq!(volume.value(0, 32, 32), 0.0);
    let Voxels::U8(voxels) = volume.fill([0; 3], Size3::cube(64)) else { panic!("u8") };
    let part = |from: u8, to: u8| {
        voxels.iter().filter(|v| (from..=to).contains(v)).count() as f64 / voxels.len() as f64
    };
    println!("0: {}, 1 to 99: {}, 100 up: {}", part(0, 0), part(1, 99), part(100, 255));
    assert!(part(0, 0) > 0.5 && part(1, 99) > 0.03 && part(100, 255) > 0.1);
}

#[test]
fn boxes_and_whole_volumes_hold_the_same_values() {
    let identity = WorldFromVoxel::from_spacing([1.0; 3]).expect("good");
    for kind in KINDS {
        let volume = of(kind, [13, 7, 9]);
        let whole = volume.whole(identity).expect("small").channels.remove(0).voxels;
        assert_eq!(whole, volume.fill([0; 3], volume.size()), "{kind}");
        assert_eq!(whole.format(), volume.format());
        let part = volume.fill([4, 2, 5], Size3::new(3, 4, 2));
        assert_eq!(part.len(), 24);
        assert_eq!(part.value(3 * 4 + 3 + 2), volume.value(6, 3, 6), "{kind}");
        assert_eq!(part.value(0), whole.value(volume.size().index(4, 2, 5)), "{kind}");
    }
    let huge = of("constant", [1 << 24, 1 << 24, 1 << 24]).whole(identity).expect_err("huge");
    assert_eq!(huge.exit, Exit::Machine);
}

#[test]
fn bounds_hold_every_voxel_of_random_boxes() {
    let mut random = Random(7);
    for kind in KINDS {
        for size in [[40, 50, 60], [4096, 4096, 4096], [1, 1, 1], [300, 2, 1]] {
            let volume = of(kind, size);
            for _ in 0..60 {
                let mut start = [0; 3];
                let mut extent = [1; 3];
                for axis in 0..3 {
                    start[axis] = (random.unit() * f64::from(size[axis])) as u32;
                    let most = (size[axis] - start[axis]).min(12);
                    extent[axis] = 1 + (random.unit() * f64::from(most)) as u32 % most;
                }
                let extent = Size3::from_array(extent);
                let bounds = volume.bounds(start, extent);
                let seen = volume.fill(start, extent).range();
                let holds = bounds.least <= seen.least && bounds.greatest >= seen.greatest;
                assert!(holds, "{kind} at {start:?}, {extent}: {bounds:?}, saw {seen:?}");
                if ["constant", "ramp", "checkerboard"].contains(&kind) {
                    assert_eq!(bounds, seen, "{kind} at {start:?}, {extent}");
                }
            }
        }
    }
}

/// Bounds that said "anything" would be right and useless.
#[test]
fn bounds_find_most_empty_bricks() {
    for (kind, edge) in [("shells", 256), ("hydrogen", 256), ("mandelbulb", 256)] {
        let volume = of(kind, [edge; 3]);
        let (mut empty, mut found) = (0, 0);
        for brick in 0..512 {
            let start = [brick % 8, brick / 8 % 8, brick / 64].map(|b| b * 32);
            let nothing = ValueRange::of(0.0);
            empty += usize::from(volume.fill(start, Size3::cube(32)).range() == nothing);
            found += usize::from(volume.bounds(start, Size3::cube(32)) == nothing);
        }
        println!("{kind}: {found} of {empty} empty bricks of 512 are known without a look");
        assert!(found * 2 >= empty, "{kind}: {found} of {empty}");
    }
}
