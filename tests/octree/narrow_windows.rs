//! Ranges of 8 bits, as the paper has them, leave out what narrow windows show; exact ones do not.

use std::collections::HashMap;

use ashfall::twins::octree::Nodes;
use ashfall::twins::octree_ranges::{Coding, Ranges, Work, leaf_ranges, update_ranges};
use ashfall::twins::octree_words::{Class, class_of};
use ashfall::volume::{ValueRange, VoxelFormat};

use crate::random::Random;
use crate::world::{PLANS, Plan, World, extent};

/// Leaves by what they hold and what ranges say: shown and kept, shown but left out, kept in vain.
#[derive(Debug, Default)]
struct Count {
    kept: u32,
    left_out: u32,
    in_vain: u32,
}

/// Leaves of level 0 under random windows of `width` of all values. `rounded` and `window_rounded` are what
/// is kept of ranges and windows, 0 to 1.
fn count(
    plan: Plan,
    width: f64,
    rounded: impl Fn([f64; 2]) -> [f64; 2],
    window_rounded: impl Fn(f64) -> f64,
) -> Count {
    let mut world = World::new(plan, 77);
    let shape = plan.shape(2);
    let (least, greatest, whole) = extent(plan.format);
    // Waves that take up a hundredth of all values, as pictures of microscopes do.
    let waves = |at: usize| {
        let [nx, ny, _] = plan.size.map(|edge| edge as usize);
        let place = [at % nx, at / nx % ny, at / nx / ny].map(|at| at as f32);
        let unit = 0.015 + 0.005 * (0.11 * place[0] + 0.07 * place[1] + 0.05 * place[2]).sin();
        let value = least + (greatest - least) * unit;
        if whole { value.round() } else { value }
    };
    let of = &mut world.sources[0][0].values;
    *of = (0..of.len()).map(waves).collect();
    let unit = |value: f32| f64::from(value - least) / f64::from(greatest - least);
    let mut ranges = Ranges::unknown(Coding::of(plan.format), shape.nodes());
    let [nx, ny, nz] = shape.bricks(0);
    let mut none = Work::default();
    for brick in (Nodes { start: [0; 3], end: [nx, ny, nz] }).each() {
        let (voxels, size) = world.brick(0, 0, brick);
        let of = leaf_ranges(&voxels, size, shape.leaf_edges(0));
        let leaves = shape.leaves_of_brick(0, brick);
        let each: HashMap<[u32; 3], ValueRange> = leaves.each().zip(of).collect();
        let range = |leaf| each.get(&leaf).copied().expect("each leaf has a range");
        update_ranges(&shape, 0, &mut ranges, leaves, range, &mut none);
    }
    let tree = &shape.trees[0];
    let mut random = Random(12);
    let mut count = Count::default();
    for _ in 0..40 {
        let from = random.between(0.01, 0.02 - width);
        let window = [from, from + width];
        for leaf in Nodes::all(shape.lowest(tree)).each() {
            let range = ranges.get(tree.number(shape.lowest(tree), leaf));
            if range.is_empty() {
                continue;
            }
            let ends = [unit(range.least), unit(range.greatest)];
            let truly = ends[0] <= window[1] && ends[1] >= window[0];
            let [low, high] = rounded(ends);
            let said = low <= window_rounded(window[1]) && high >= window_rounded(window[0]);
            match (truly, said) {
                (true, true) => count.kept += 1,
                (true, false) => count.left_out += 1,
                (false, true) => count.in_vain += 1,
                (false, false) => {}
            }
        }
    }
    count
}

#[test]
fn eight_bits_are_wrong_for_narrow_windows_and_exact_ranges_are_not() {
    let nearest = |at: f64| (at * 255.0).round() / 255.0;
    for format in [VoxelFormat::U16, VoxelFormat::F32] {
        // Small bricks of one leaf each, so that ranges are narrow; windows of 26 steps of 65535.
        let plan = Plan { size: [48, 40, 36], format, leaf: [2; 3], ..PLANS[0] };
        let exact = count(plan, 0.0004, |ends| ends, |at| at);
        assert!(exact.left_out == 0 && exact.in_vain == 0 && exact.kept > 100, "{exact:?}");
        // To the nearest of 256, window as it is: what shows is left out.
        let eight = count(plan, 0.0004, |ends| ends.map(nearest), |at| at);
        assert!(eight.left_out > exact.kept / 20, "{format}: {eight:?}");
        // Outwards nothing is left out, but much is kept in vain.
        let outwards = count(
            plan,
            0.0004,
            |[low, high]| [(low * 255.0).floor() / 255.0, (high * 255.0).ceil() / 255.0],
            |at| at,
        );
        assert!(outwards.left_out == 0, "{format}: {outwards:?}");
        assert!(outwards.in_vain > outwards.kept, "{format}: {outwards:?}");
        // Voxels and window in 8 bits, as the paper has them: right by themselves, but of other data.
        let both = count(plan, 0.0004, |ends| ends.map(nearest), nearest);
        assert!(both.left_out + both.in_vain > exact.kept / 2, "{format}: {both:?}");
        eprintln!(
            "{format}: exact {exact:?}, nearest {eight:?}, outwards {outwards:?}, all {both:?}"
        );
    }
}

#[test]
fn packed_ranges_are_exact_for_whole_values_and_round_outwards() {
    let mut random = Random(4);
    for (coding, low, high) in
        [(Coding::Unsigned, 0, 65536), (Coding::Signed, -32768, 32768), (Coding::Float, -9, 9)]
    {
        let mut ranges = Ranges::unknown(coding, 3);
        assert_eq!(ranges.get(1), coding.unknown());
        for _ in 0..2000 {
            let span = |random: &mut Random| low + random.below((high - low) as u64) as i64;
            let (a, b) = (span(&mut random) as f32, span(&mut random) as f32);
            let whole = ValueRange::over([a, b]);
            ranges.set(1, whole);
            assert_eq!(ranges.get(1), whole);
            let part = random.between(0.0, 0.5) as f32;
            let inside = ValueRange { least: whole.least + part, greatest: whole.greatest + part };
            ranges.set(1, inside);
            let got = ranges.get(1);
            assert!(got.least <= inside.least);
            assert!(got.greatest >= inside.greatest || inside.greatest > high as f32 - 1.0);
            assert!(coding != Coding::Float || got == inside);
        }
        assert!(ranges.set(1, ValueRange::EMPTY) && !ranges.set(1, ValueRange::EMPTY));
        assert!(ranges.get(1).is_empty() && ranges.get(0) == coding.unknown());
        assert_eq!(class_of(ranges.get(1), |_| true), Class::Nothing);
        assert_eq!(class_of(ranges.get(0), |_| true), Class::Something);
        ranges.set(1, ValueRange::of(3.0));
        assert_eq!(class_of(ranges.get(1), |_| true), Class::OneValue);
        assert_eq!(class_of(ranges.get(1), |_| false), Class::Nothing);
    }
}
