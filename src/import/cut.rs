//! Cuts bricks with their aprons out of slices, and says what a coarser level loses of them.

use crate::import::reduce::{Summed, fold_x};
use crate::volume::{BRICK_APRON, BrickBox, BrickGrid, Size3};

/// Part of a level in memory: planes of rows, all with the same origin.
pub struct Window<'a, V> {
    /// One per stored plane of the bricks: clamped at the volume's faces.
    pub planes: Vec<&'a [V]>,
    /// Voxels from a row to the next.
    pub pitch: usize,
    /// Level voxel at the start of a plane.
    pub origin: [u32; 2],
}

impl<V: Copy> Window<'_, V> {
    /// Puts the stored voxels of a brick into `out`.
    pub fn cut(&self, grid: BrickGrid, payload: BrickBox, out: &mut Vec<V>) {
        out.clear();
        let [left, top] = [payload.start[0], payload.start[1]];
        let [right, bottom] = [payload.end[0], payload.end[1]];
        for plane in &self.planes {
            for y in -i64::from(BRICK_APRON)..i64::from(bottom - top + BRICK_APRON) {
                let y = (i64::from(top) + y).clamp(0, i64::from(grid.size.y) - 1) as u32;
                let row = (y - self.origin[1]) as usize * self.pitch;
                let at = |x: u32| row + (x - self.origin[0]) as usize;
                out.push(plane[at(left.saturating_sub(1))]);
                out.extend_from_slice(&plane[at(left)..at(left) + (right - left) as usize]);
                out.push(plane[at(right.min(grid.size.x - 1))]);
            }
        }
    }
}

/// Level voxels of the stored planes of bricks whose payload covers slices `start..end`.
pub fn stored_planes(start: u32, end: u32, size: u32) -> impl Iterator<Item = u32> {
    let first = i64::from(start) - i64::from(BRICK_APRON);
    let last = i64::from(end) + i64::from(BRICK_APRON);
    (first..last).map(move |z| z.clamp(0, i64::from(size) - 1) as u32)
}

/// The loss of docs/FORMAT.md. `stored` are the brick's voxels with apron, `halved` the axes that the
/// next level halves.
pub fn loss<V: Summed>(
    stored: &[V],
    payload: BrickBox,
    level_size: Size3,
    halved: [bool; 3],
) -> f32 {
    let payload_size = payload.size().to_array();
    let size = payload_size.map(|voxels| (voxels + 2 * BRICK_APRON) as usize);
    let level_size = level_size.to_array();
    // Per axis: where in the brick each coarse voxel that begins in the payload has its voxels.
    let cells: [Vec<(usize, usize)>; 3] = std::array::from_fn(|axis| {
        let factor = if halved[axis] { 2 } else { 1 };
        let first = payload.start[axis].next_multiple_of(factor);
        let of = |voxel: u32| {
            let start = (voxel - payload.start[axis] + BRICK_APRON) as usize;
            (start, (factor.min(level_size[axis] - voxel)) as usize)
        };
        (first..payload.end[axis]).step_by(factor as usize).map(of).collect()
    });
    let [xs, ys, zs] = &cells;
    let Some(&(first_x, _)) = xs.first() else { return 0.0 };
    let row_voxels: usize = xs.iter().map(|&(_, len)| len).sum();
    let (width, cells_x) = (row_voxels * V::PARTS, xs.len() * V::PARTS);

    let (mut sums, mut squares) =
        (vec![V::Sum::default(); width], vec![V::Square::default(); width]);
    let mut counts = vec![0.0; if V::COUNTED { width } else { 0 }];
    let (mut cell_sums, mut cell_squares) = (vec![0.0; cells_x], vec![0.0; cells_x]);
    let mut cell_counts = vec![0.0; cells_x];
    let (mut lost, mut counted) = (0.0, 0.0);
    for &(z, planes) in zs {
        for &(y, rows) in ys {
            sums.fill(V::Sum::default());
            squares.fill(V::Square::default());
            counts.fill(0.0);
            for k in z..z + planes {
                for j in y..y + rows {
                    let start = (k * size[1] + j) * size[0] + first_x;
                    let row: &[V::Part] = bytemuck::cast_slice(&stored[start..start + row_voxels]);
                    for ((sum, square), &part) in sums.iter_mut().zip(&mut squares).zip(row) {
                        *sum += V::sum(part);
                        *square += V::square(part);
                    }
                    for (count, &part) in counts.iter_mut().zip(row) {
                        *count += V::count(part);
                    }
                }
            }
            fold_x(&sums, V::PARTS, halved[0], Into::into, &mut cell_sums);
            fold_x(&squares, V::PARTS, halved[0], Into::into, &mut cell_squares);
            if V::COUNTED {
                fold_x(&counts, V::PARTS, halved[0], |count: f64| count, &mut cell_counts);
            } else {
                for (count, &(_, len)) in cell_counts.chunks_exact_mut(V::PARTS).zip(xs) {
                    count.fill((planes * rows * len) as f64);
                }
            }
            for ((&sum, &square), &count) in cell_sums.iter().zip(&cell_squares).zip(&cell_counts) {
                let sum: f64 = sum;
                let square: f64 = square;
                // Squared differences from the mean; 0 where everything is NaN.
                lost += (square - sum * sum / f64::max(count, 1.0)).max(0.0);
                counted += count;
            }
        }
    }
    if counted == 0.0 { 0.0 } else { f64::sqrt(lost / counted).min(f64::from(f32::MAX)) as f32 }
}
