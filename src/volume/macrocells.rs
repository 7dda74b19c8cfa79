//! Macrocells: small boxes of cells with the range of the voxels that their cells interpolate between.

use rayon::prelude::*;

use crate::volume::{Size3, ValueRange, Voxel, Voxels, with_voxel_type};

/// Cells of a macrocell along each axis.
pub const MACROCELL_CELLS: u32 = 4;

/// Macrocells of a volume, x fastest, then y, then z.
///
/// A cell lies between eight voxel centres; the first along an axis lies before voxel 0, whose value goes
/// on outside. Macrocell 0 begins with that cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Macrocells<T> {
    /// How many along each axis.
    pub size: Size3,
    /// One for each.
    pub of: Vec<T>,
}

impl<T> Macrocells<T> {
    /// How many a volume of `voxels` has.
    pub fn count(voxels: Size3) -> Size3 {
        // One cell more than voxels along each axis.
        let [x, y, z] = voxels.to_array().map(|edge| edge / MACROCELL_CELLS + 1);
        Size3::new(x, y, z)
    }
}

impl Macrocells<ValueRange> {
    /// Ranges of stored values, NaN left out (of RGBA: of alpha): whatever is interpolated within a
    /// macrocell lies within its range.
    pub fn ranges(voxels: &Voxels, size: Size3) -> Macrocells<ValueRange> {
        with_voxel_type!(voxels.format(), V => {
            ranges::<V>(V::of(voxels).expect("voxels of their own format"), size)
        })
    }
}

/// First and last voxel of a macrocell along an axis.
fn span(macrocell: u32, edge: u32) -> (u32, u32) {
    let first = (macrocell * MACROCELL_CELLS).saturating_sub(1);
    (first, (macrocell * MACROCELL_CELLS + MACROCELL_CELLS - 1).min(edge - 1))
}

fn ranges<V: Voxel>(voxels: &[V], size: Size3) -> Macrocells<ValueRange> {
    let count = Macrocells::<ValueRange>::count(size);
    let mut of = vec![ValueRange::EMPTY; count.x as usize * count.y as usize * count.z as usize];
    of.par_chunks_mut(count.x as usize).enumerate().for_each(|(row, ranges)| {
        let (first_y, last_y) = span(row as u32 % count.y, size.y);
        let (first_z, last_z) = span(row as u32 / count.y, size.z);
        for (z, y) in (first_z..=last_z).flat_map(|z| (first_y..=last_y).map(move |y| (z, y))) {
            let start = size.index(0, y, z);
            let line = &voxels[start..start + size.x as usize];
            for (x, range) in ranges.iter_mut().enumerate() {
                let (first, last) = span(x as u32, size.x);
                *range = range.union(V::range(&line[first as usize..=last as usize]));
            }
        }
    });
    Macrocells { size: count, of }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_macrocell_has_the_voxels_on_all_its_faces() {
        let size = Size3::new(9, 1, 2);
        let voxels: Vec<u8> = (0..18).collect();
        let ranges = Macrocells::ranges(&Voxels::U8(voxels), size);
        assert_eq!(ranges.size, Size3::new(3, 1, 1));
        let ends = |at: usize| (ranges.of[at].least, ranges.of[at].greatest);
        // Cells -1 to 2 lie between voxels 0 to 3, cells 3 to 6 between 3 and 7, 7 and 8 from 7 on.
        assert_eq!([ends(0), ends(1), ends(2)], [(0.0, 12.0), (3.0, 16.0), (7.0, 17.0)]);
    }

    #[test]
    fn nan_is_no_value() {
        let voxels = Voxels::F32(vec![f32::NAN, 2.0, f32::NAN, f32::NAN]);
        let ranges = Macrocells::ranges(&voxels, Size3::new(4, 1, 1));
        assert_eq!(ranges.of[0], ValueRange::of(2.0));
        assert!(ranges.of[1].is_empty());
    }
}
