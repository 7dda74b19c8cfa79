//! The power-8 Mandelbulb of White and Nylander as a volume.
//!
//! An orbit starts at the point c itself and goes on with z -> z^8 + c, where z^8 multiplies both
//! spherical angles by 8. The value is the mean of (1 - |z|^2 / 4)^2 over orbit points 2 to 5, which
//! is 0 from |z| = 2 on, so it is smooth, needs no logarithm and is exactly 0 a short way outside.
//! Powers of angles are repeated squares of (cosine, sine) pairs: no trigonometry, hence the same
//! bytes everywhere.

use crate::source::formula::{SLACK, quantized, radius, radius_range};
use crate::volume::ValueRange;

/// Half the edge of the cube that any size samples.
pub const HALF: f64 = 1.2;

/// Orbit points that count, and how many come before them: the first two are round and dull.
const COUNTED: u32 = 4;
const SKIPPED: u32 = 2;

/// An orbit point farther away than this never comes back: |z|^8 - |c| is far beyond |z|.
const ESCAPED: f64 = 2.0;

/// The value at a point of the cube.
pub fn value(c: [f64; 3]) -> u8 {
    // Outside of this radius point 1 has escaped: r^8 - r > 2.
    const ROUND: f64 = 1.21;
    if c[0] * c[0] + c[1] * c[1] + c[2] * c[2] > ROUND * ROUND {
        return 0;
    }
    let mut z = c;
    let mut sum = 0.0;
    for step in 1..SKIPPED + COUNTED {
        z = next(z, c);
        let square = z[0] * z[0] + z[1] * z[1] + z[2] * z[2];
        if square >= ESCAPED * ESCAPED {
            break;
        }
        if step >= SKIPPED {
            sum += weight(square);
        }
    }
    quantized(sum / f64::from(COUNTED))
}

fn weight(square: f64) -> f64 {
    let part = (1.0 - square / (ESCAPED * ESCAPED)).max(0.0);
    part * part
}

/// z^8 + c.
fn next([x, y, z]: [f64; 3], c: [f64; 3]) -> [f64; 3] {
    let cylinder_square = x * x + y * y;
    let cylinder = cylinder_square.sqrt();
    // r^8 times (cosine, sine) of 8 theta, theta counted from the z axis.
    let [up, out] = eighth_power([z, cylinder]);
    let around =
        if cylinder > 0.0 { eighth_power([x / cylinder, y / cylinder]) } else { [1.0, 0.0] };
    [out * around[0] + c[0], out * around[1] + c[1], up + c[2]]
}

fn eighth_power(mut pair: [f64; 2]) -> [f64; 2] {
    for _ in 0..3 {
        let [a, b] = pair;
        pair = [a * a - b * b, 2.0 * a * b];
    }
    pair
}

/// Halvings of a box along each axis before its bounds are taken as they are.
const HALVINGS: u32 = 3;

/// A range that holds the values in a box, of which parts are looked at one by one where a look at
/// the whole says too little.
pub fn bounds(corners: [[f64; 3]; 2]) -> ValueRange {
    bounds_of_parts(corners, HALVINGS)
}

fn bounds_of_parts([low, high]: [[f64; 3]; 2], halvings: u32) -> ValueRange {
    let whole = bounds_at_once([low, high]);
    if halvings == 0 || whole.least == whole.greatest {
        return whole;
    }
    let middle: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
    (0..8).fold(ValueRange::EMPTY, |range, part| {
        let is_upper = |axis: usize| part >> axis & 1 == 1;
        let part_low = std::array::from_fn(|a| if is_upper(a) { middle[a] } else { low[a] });
        let part_high = std::array::from_fn(|a| if is_upper(a) { high[a] } else { middle[a] });
        range.union(bounds_of_parts([part_low, part_high], halvings - 1))
    })
}

/// From two bounds on |z| at each orbit point: one from |z^8| = |z|^8 alone, one from the orbit of
/// the box's middle and how fast orbits part.
fn bounds_at_once(corners: [[f64; 3]; 2]) -> ValueRange {
    let [low, high] = corners;
    let [nearest, farthest] = radius_range(corners);
    let middle = std::array::from_fn(|a| 0.5 * (low[a] + high[a]));
    let spread = 0.5 * radius(std::array::from_fn(|a| high[a] - low[a]));
    let (mut z, mut apart) = (middle, spread);
    let (mut size_least, mut size_most) = (nearest, farthest);
    let (mut least, mut greatest) = (0.0, 0.0);
    for step in 1..SKIPPED + COUNTED {
        apart = apart * stretch(z, apart) + spread;
        z = next(z, middle);
        let size = radius(z);
        (size_least, size_most) =
            ((size_least.powi(8) - farthest).max(0.0), size_most.powi(8) + farthest);
        if apart.is_finite() && size.is_finite() {
            size_least = size_least.max(size - apart);
            size_most = size_most.min(size + apart);
        }
        if size_least >= ESCAPED + SLACK {
            break;
        }
        if step >= SKIPPED {
            greatest += weight(size_least * size_least);
            least += weight(size_most * size_most);
        }
    }
    let counted = f64::from(COUNTED);
    ValueRange {
        least: f32::from(quantized(least / counted - SLACK)),
        greatest: f32::from(quantized(greatest / counted + SLACK)),
    }
}

/// How much z -> z^8 stretches distances at most, within `apart` of z: 8 |z|^7 along the radius and
/// the polar angle, and that times |sin 8 theta / sin theta| around the axis, which is at most 8 and
/// at most 1 / sin theta.
fn stretch(z: [f64; 3], apart: f64) -> f64 {
    let size_most = radius(z) + apart;
    let cylinder_least = (z[0] * z[0] + z[1] * z[1]).sqrt() - apart;
    let around = if cylinder_least > 0.0 { (size_most / cylinder_least).min(8.0) } else { 8.0 };
    8.0 * size_most.powi(7) * around
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points all over the cube, dense near the axis, where distances around it stretch most.
    #[test]
    fn no_pair_of_points_parts_faster_than_the_stretch() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1 << 23) as f64 - 1.0
        };
        let mut tightest = 0.0_f64;
        for _ in 0..200_000 {
            let near_axis = random().abs().powi(6);
            let z = [random() * near_axis, random() * near_axis, random() * 1.3];
            let apart = 10.0_f64.powf(-1.0 - 3.0 * random().abs());
            let step = [random(), random(), random()].map(|c| c * apart / 3.0_f64.sqrt());
            let other: [f64; 3] = std::array::from_fn(|a| z[a] + step[a]);
            let (p, q) = (next(z, [0.0; 3]), next(other, [0.0; 3]));
            let distance = radius(std::array::from_fn(|a| p[a] - q[a]));
            let allowed = radius(step) * stretch(z, apart);
            assert!(distance <= allowed * (1.0 + 1e-9) + 1e-15, "{z:?} to {other:?}");
            tightest = tightest.max(distance / allowed);
        }
        assert!(tightest > 0.8, "a bound that is never nearly met: {tightest}");
    }
}
