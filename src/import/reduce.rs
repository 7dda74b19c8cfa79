//! Sums of voxels, from which means are made: level 0 -> level 1 -> ... without a rounding between.
//!
//! A level keeps, beside its voxels, the sum of the level-0 voxels below each of them and, where NaN
//! can be left out, how many were summed; the next level adds these up. So a voxel of any level is
//! its level-0 mean to f64 accuracy (exact for integers as long as the sum is below 2^53).

use std::ops::{Add, AddAssign};

use crate::volume::Voxel;

/// How rows of a voxel type are summed.
pub trait Summed: Voxel {
    /// One component.
    type Part: bytemuck::Pod + Sync;
    /// Holds the sum of eight components exactly (f32: to f64 accuracy).
    type Sum: Copy + Default + AddAssign + Add<Output = Self::Sum> + Into<f64> + Send;
    /// Holds the sum of eight squares exactly (f32: to f64 accuracy).
    type Square: Copy + Default + AddAssign + Add<Output = Self::Square> + Into<f64>;
    /// Whether components can be NaN, so that their number has to be counted.
    const COUNTED: bool;
    /// A component as a sum; NaN is 0.
    fn sum(part: Self::Part) -> Self::Sum;
    /// A component squared; NaN is 0.
    fn square(part: Self::Part) -> Self::Square;
    /// 1, or 0 for NaN.
    fn count(part: Self::Part) -> f64;
}

macro_rules! summed_integer {
    ($voxel:ty, $part:ty, $square:ty) => {
        impl Summed for $voxel {
            type Part = $part;
            type Sum = i32;
            type Square = $square;
            const COUNTED: bool = false;

            fn sum(part: $part) -> i32 {
                i32::from(part)
            }

            fn square(part: $part) -> $square {
                <$square>::from(part) * <$square>::from(part)
            }

            fn count(_: $part) -> f64 {
                1.0
            }
        }
    };
}

summed_integer!(u8, u8, i32);
summed_integer!([u8; 4], u8, i32);
summed_integer!(u16, u16, f64);
summed_integer!(i16, i16, f64);

impl Summed for f32 {
    type Part = f32;
    type Sum = f64;
    type Square = f64;
    const COUNTED: bool = true;

    fn sum(part: f32) -> f64 {
        if part.is_nan() { 0.0 } else { f64::from(part) }
    }

    fn square(part: f32) -> f64 {
        let value = f32::sum(part);
        value * value
    }

    fn count(part: f32) -> f64 {
        if part.is_nan() { 0.0 } else { 1.0 }
    }
}

/// Adds up items of a row that share a coarse voxel: one or two neighbours, component by component.
pub fn fold_x<S: Copy + Add<Output = S>, T>(
    row: &[S],
    parts: usize,
    halved: bool,
    to: impl Fn(S) -> T,
    out: &mut [T],
) {
    if !halved {
        out.iter_mut().zip(row).for_each(|(out, &sum)| *out = to(sum));
        return;
    }
    if parts == 1 {
        // The common case apart, so that it is compiled without the inner loop.
        out.iter_mut()
            .zip(row.chunks_exact(2))
            .for_each(|(out, pair)| *out = to(pair[0] + pair[1]));
        if let ([.., out], [last]) = (out, row.chunks_exact(2).remainder()) {
            *out = to(*last);
        }
        return;
    }
    let pairs = row.chunks_exact(2 * parts);
    let rest = pairs.remainder();
    for (out, pair) in out.chunks_exact_mut(parts).zip(pairs) {
        for part in 0..parts {
            out[part] = to(pair[part] + pair[parts + part]);
        }
    }
    // An odd last voxel has no neighbour.
    let last = out.len() - rest.len();
    out[last..].iter_mut().zip(rest).for_each(|(out, &sum)| *out = to(sum));
}

/// One coarse row out of level-0 rows: sums per component and, if counted, counts.
pub fn sum_voxels<V: Summed>(rows: &[&[V]], halved_x: bool, sums: &mut [f64], counts: &mut [f64]) {
    let width = rows[0].len() * V::PARTS;
    let mut column_sums = vec![V::Sum::default(); width];
    for row in rows {
        let row: &[V::Part] = bytemuck::cast_slice(row);
        for (sum, &part) in column_sums.iter_mut().zip(row) {
            *sum += V::sum(part);
        }
    }
    fold_x(&column_sums, V::PARTS, halved_x, Into::into, sums);
    if V::COUNTED {
        let mut column_counts = vec![0.0; width];
        for row in rows {
            let row: &[V::Part] = bytemuck::cast_slice(row);
            for (count, &part) in column_counts.iter_mut().zip(row) {
                *count += V::count(part);
            }
        }
        fold_x(&column_counts, V::PARTS, halved_x, |count: f64| count, counts);
    }
}

/// One coarse row out of rows of sums (or of counts).
pub fn sum_sums(rows: &[&[f64]], parts: usize, halved_x: bool, out: &mut [f64]) {
    let mut columns = rows[0].to_vec();
    for row in &rows[1..] {
        columns.iter_mut().zip(*row).for_each(|(sum, &more)| *sum += more);
    }
    fold_x(&columns, parts, halved_x, |sum: f64| sum, out);
}

/// Voxels out of sums: divided by their counts, or by the covered volume where nothing is left out.
/// `covered_x` is how many level-0 voxels each voxel covers along x, `covered_yz` along both others.
pub fn means<V: Summed>(
    sums: &[f64],
    counts: &[f64],
    covered_x: &[f64],
    covered_yz: f64,
    out: &mut [V],
) {
    for (x, (out, sums)) in out.iter_mut().zip(sums.chunks_exact(V::PARTS)).enumerate() {
        let weight = if V::COUNTED { counts[x] } else { covered_x[x] * covered_yz };
        if V::COUNTED && weight == 0.0 {
            *out = V::ABSENT;
            continue;
        }
        let mut parts = [0.0; 4];
        for (part, sum) in parts.iter_mut().zip(sums) {
            *part = sum / weight;
        }
        *out = V::nearest(&parts[..V::PARTS]);
    }
}
