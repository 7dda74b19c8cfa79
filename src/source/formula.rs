//! The formulas of the computed volumes, and bounds of them over boxes.
//!
//! A box is given by its least and greatest corner. Where bounds rest on functions of which the last
//! digits may not be monotone, they are widened by [`SLACK`].

use std::f64::consts::PI;

use crate::volume::ValueRange;

/// Half the edge of the cube of `hydrogen`, in Bohr radii: the density at its faces is below 1/255.
pub const HYDROGEN_HALF_BOHR: f64 = 24.0;

/// More than rounding can move a value, in parts of the full scale.
pub const SLACK: f64 = 1e-9;

const SHELLS: f64 = 8.0;
const SHELL_HALF_WIDTH: f64 = 1.0 / 64.0;

/// 0 in the first of `len` voxels, 1 in the last.
pub fn ramp(x: u32, len: u32) -> f32 {
    if len == 1 { 0.0 } else { (f64::from(x) / f64::from(len - 1)) as f32 }
}

/// Distance from the middle.
pub fn radius([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Least and greatest distance from the middle within a box.
pub fn radius_range([low, high]: [[f64; 3]; 2]) -> [f64; 2] {
    let nearest = std::array::from_fn(|a| {
        if low[a] <= 0.0 && high[a] >= 0.0 { 0.0 } else { low[a].abs().min(high[a].abs()) }
    });
    let farthest = std::array::from_fn(|a| low[a].abs().max(high[a].abs()));
    [radius(nearest), radius(farthest)]
}

/// A full scale of 0 to 1 as u8.
pub fn quantized(part: f64) -> u8 {
    (part.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn quantized_range(least: f64, greatest: f64) -> ValueRange {
    ValueRange {
        least: f32::from(quantized(least - SLACK)),
        greatest: f32::from(quantized(greatest + SLACK)),
    }
}

/// Number of the shell that is nearest to a radius; shell k has radius k / 8, k from 1 to 7.
fn nearest_shell(radius: f64) -> f64 {
    (radius * SHELLS).round().clamp(1.0, SHELLS - 1.0)
}

fn shell_part(radius: f64) -> f64 {
    1.0 - (radius - nearest_shell(radius) / SHELLS).abs() / SHELL_HALF_WIDTH
}

/// `shells` at a distance from the middle.
pub fn shells(radius: f64) -> u8 {
    quantized(shell_part(radius))
}

/// `shells` between two distances.
pub fn shells_bounds([nearest, farthest]: [f64; 2]) -> ValueRange {
    let (a, b) = (shell_part(nearest), shell_part(farthest));
    let first = (nearest * SHELLS).ceil().max(1.0);
    let holds_a_shell = first <= SHELLS - 1.0 && first <= farthest * SHELLS;
    let leaves_a_shell = nearest_shell(nearest) != nearest_shell(farthest);
    quantized_range(
        if leaves_a_shell { 0.0 } else { a.min(b) },
        if holds_a_shell { 1.0 } else { a.max(b) },
    )
}

const MARSCHNER_LOBB_F: f64 = 6.0;
const MARSCHNER_LOBB_ALPHA: f64 = 0.25;

/// Marschner and Lobb, "An evaluation of reconstruction filters for volume rendering", 1994.
pub fn marschner_lobb([x, y, z]: [f64; 3]) -> f64 {
    let r = (x * x + y * y).sqrt();
    let ripple = (2.0 * PI * MARSCHNER_LOBB_F * (PI * r / 2.0).cos()).cos();
    marschner_lobb_of(z, ripple)
}

fn marschner_lobb_of(z: f64, ripple: f64) -> f64 {
    let alpha = MARSCHNER_LOBB_ALPHA;
    (1.0 - (PI * z / 2.0).sin() + alpha * (1.0 + ripple)) / (2.0 * (1.0 + alpha))
}

/// `marschner-lobb` in a box: it falls with z, and the ripple is whatever it may be.
pub fn marschner_lobb_bounds([low, high]: [[f64; 3]; 2]) -> ValueRange {
    ValueRange {
        least: (marschner_lobb_of(high[2], -1.0) - SLACK) as f32,
        greatest: (marschner_lobb_of(low[2], 1.0) + SLACK) as f32,
    }
}

/// Density of the 3d orbital, n = 3, l = 2, m = 0, in parts of its greatest:
/// |r^2 exp(-r/3) (3 cos^2 theta - 1)|^2, which peaks at r = 6 on the z axis.
pub fn hydrogen(position: [f64; 3]) -> u8 {
    let [x, y, z] = position;
    let square = x * x + y * y + z * z;
    let cosine_square = if square > 0.0 { z * z / square } else { 0.0 };
    quantized(hydrogen_radial(square.sqrt()) * hydrogen_angular(cosine_square))
}

/// 1 at r = 6, its only peak.
fn hydrogen_radial(radius: f64) -> f64 {
    (radius / 6.0).powi(4) * ((6.0 - radius) * (2.0 / 3.0)).exp()
}

/// 1 on the axis, 1/4 on the equator, 0 where the square of the cosine is 1/3.
fn hydrogen_angular(cosine_square: f64) -> f64 {
    (1.5 * cosine_square - 0.5).powi(2)
}

/// `hydrogen` in a box: the radial and the angular factor each at their most and least.
pub fn hydrogen_bounds([low, high]: [[f64; 3]; 2]) -> ValueRange {
    let squares = |axis: usize| {
        let (a, b) = (low[axis].powi(2), high[axis].powi(2));
        let least = if low[axis] <= 0.0 && high[axis] >= 0.0 { 0.0 } else { a.min(b) };
        [least, a.max(b)]
    };
    let [x, y, z] = [squares(0), squares(1), squares(2)];
    let part = |z: f64, rest: f64| if z + rest > 0.0 { z / (z + rest) } else { 0.0 };
    let cosines = [part(z[0], x[1] + y[1]), part(z[1], x[0] + y[0])];
    let angular = over(hydrogen_angular, cosines, 1.0 / 3.0);
    let radial = over(hydrogen_radial, radius_range([low, high]), 6.0);
    quantized_range(angular[0] * radial[0], angular[1] * radial[1])
}

/// Least and greatest of a function that is monotone on either side of `turn`.
fn over(function: fn(f64) -> f64, [from, to]: [f64; 2], turn: f64) -> [f64; 2] {
    let (a, b) = (function(from), function(to));
    let c = if from < turn && turn < to { function(turn) } else { a };
    [a.min(b).min(c), a.max(b).max(c)]
}
