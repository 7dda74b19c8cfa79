//! twins::preintegrate by itself, against closed forms: what a span means, and what bounds it.

use ashfall::twins::classify::Block;
use ashfall::twins::filter::{Along, Texels, filtered, filtered_along};
use ashfall::twins::preintegrate::{Content, Point, Span, composite_span};
use ashfall::twins::transfer::TransferSegment;

use crate::random::Random;

/// Extinction is the value, which is the texel.
const EVEN: TransferSegment = TransferSegment {
    start: [0.5, 0.5, 0.5, 0.0],
    slope: [0.0, 0.0, 0.0, 1.0],
    begins_at: 0.0,
    window_scale: 1.0,
    window_offset: 0.0,
    unused_0: 0.0,
};

fn depth_between(from: Along, to: Along) -> f32 {
    let [from, to] = [from, to].map(|along| Point::new([1.0; 3], along, &[EVEN]));
    let mut block = Block::EMPTY;
    composite_span(&mut block, &[Content::Span(Span::between(from, to), &[EVEN])], 1.0);
    block.depth
}

/// Within a cell the value along a ray is a cubic, and a span's mean is exact.
#[test]
fn a_span_in_one_cell_has_the_mean_of_its_cubic() {
    let random = &mut Random(21);
    for _ in 0..500 {
        let texels: Vec<f32> = (0..8).map(|_| random.between(0.5, 1.5) as f32).collect();
        let image = Texels { size: [2; 3], texels: &texels };
        let start = [(); 3].map(|()| random.unit() as f32);
        let way = start.map(|start| random.unit() as f32 - start);
        let end = std::array::from_fn(|a| start[a] + way[a]);
        let at = |place| filtered_along(&image, [0; 3], place, way, |texel| texel);
        let [from, to] = [start, end].map(at);
        let value = |t: f32| {
            let place = std::array::from_fn(|a| start[a] + t * way[a]);
            let [value] = filtered(&image, [0; 3], place, |texel| [texel]);
            value
        };
        assert_eq!([from.value, to.value], [value(0.0), value(1.0)]);
        // Simpson's rule is exact for cubics.
        let mean = (value(0.0) + 4.0 * value(0.5) + value(1.0)) / 6.0;
        let got = depth_between(from, to);
        assert!((got - mean).abs() < 2e-6, "{got} instead of {mean}");
    }
}

/// Whatever slopes say, nothing is shown that no voxel around the two points has.
#[test]
fn a_span_stays_within_the_voxels_around_it() {
    let random = &mut Random(22);
    let mut bounded = 0;
    for _ in 0..500 {
        let point = |random: &mut Random| {
            let [low, value, high] = [0.25, 0.5, 0.75].map(|at| at * random.between(0.9, 1.1));
            let slope = random.between(-9.0, 9.0) as f32;
            Along { value: value as f32, slope, low: low as f32, high: high as f32 }
        };
        let (from, to) = (point(random), point(random));
        let depth = depth_between(from, to);
        let (low, high) = (from.low.min(to.low), from.high.max(to.high));
        assert!(depth >= low * 0.999_999 && depth <= high * 1.000_001, "{from:?} {to:?}: {depth}");
        bounded += u32::from(depth < low * 1.000_001 || depth > high * 0.999_999);
    }
    assert!(bounded > 100, "{bounded} spans met a bound");
}

/// Voxels whose differences no f32 holds have no slope.
#[test]
fn a_slope_beyond_all_numbers_is_none() {
    for slope in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e30, -3e38] {
        let along = Along { value: 0.5, slope, low: 0.0, high: 1.0 };
        assert_eq!(Point::new([1.0; 3], along, &[EVEN]).slope, 0.0, "{slope}");
    }
}
