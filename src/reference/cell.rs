//! Trilinear cells: the eight voxels around a stretch of a ray, and the value along it as a cubic.

use glam::DVec3;

use crate::reference::cubic::Cubic;
use crate::volume::{Size3, Voxels};

/// How voxels lie in space and memory.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Voxels along each axis.
    pub size: [i32; 3],
    /// Where the volume ends, in voxels: at most `size`, since the outermost voxels of a coarse level
    /// may reach beyond it.
    pub extent: [f64; 3],
    strides: [usize; 3],
}

/// Positions in memory of a cell's corners: x changes fastest, then y, then z.
pub type Corners = [usize; 8];

impl Grid {
    /// The grid of a volume, or of a level of it.
    pub fn new(size: Size3, extent: [f64; 3]) -> Grid {
        let edges = size.to_array();
        Grid {
            size: edges.map(|edge| edge as i32),
            extent,
            strides: [1, edges[0] as usize, edges[0] as usize * edges[1] as usize],
        }
    }

    /// The corners of a cell, which spans the centres of voxels `cell` and `cell + 1`, -1 to
    /// size - 1: beyond the outermost centres the outermost voxel is repeated.
    #[inline]
    pub fn corners(&self, cell: [i32; 3]) -> Corners {
        let offset = |axis: usize, index: i32| {
            index.clamp(0, self.size[axis] - 1) as usize * self.strides[axis]
        };
        let (x, x_next) = (offset(0, cell[0]), offset(0, cell[0] + 1));
        let (y, y_next) = (offset(1, cell[1]), offset(1, cell[1] + 1));
        let (z, z_next) = (offset(2, cell[2]), offset(2, cell[2] + 1));
        let [a, b, c, d] = [y + z, y_next + z, y + z_next, y_next + z_next];
        [x + a, x_next + a, x + b, x_next + b, x + c, x_next + c, x + d, x_next + d]
    }
}

/// The stored values at the corners (of RGBA voxels: alpha).
#[inline]
pub fn stored(voxels: &Voxels, corners: &Corners) -> [f32; 8] {
    // Plain loops: this is the innermost read of every ray, and array::map is not always inlined.
    let mut values = [0.0; 8];
    let places = values.iter_mut().zip(corners);
    match voxels {
        Voxels::U8(v) => places.for_each(|(value, &i)| *value = f32::from(v[i])),
        Voxels::U16(v) => places.for_each(|(value, &i)| *value = f32::from(v[i])),
        Voxels::I16(v) => places.for_each(|(value, &i)| *value = f32::from(v[i])),
        Voxels::F32(v) => places.for_each(|(value, &i)| *value = v[i]),
        Voxels::Rgba8(v) => places.for_each(|(value, &i)| *value = f32::from(v[i][3])),
    }
    values
}

/// Red, green and blue, 0 to 1, at the corners, when the voxels have any.
pub fn stored_rgb(voxels: &Voxels, corners: &Corners) -> Option<[[f64; 8]; 3]> {
    match voxels {
        Voxels::Rgba8(v) => {
            let component = |c: usize| corners.map(|i| f64::from(v[i][c]) / 255.0);
            Some([component(0), component(1), component(2)])
        }
        _ => None,
    }
}

/// The trilinear value along a straight line through a cell, from fraction `from` to fraction `to`
/// (both 0 to 1 along each axis), as a cubic in the part of the way done.
#[inline]
pub fn along(values: &[f64; 8], from: DVec3, to: DVec3) -> Cubic {
    let change = to - from;
    // One axis after the other; each multiplies by (from + change * way).
    let edge = |i: usize| {
        let difference = values[i + 1] - values[i];
        [values[i] + difference * from.x, difference * change.x]
    };
    let face = |i: usize| {
        let (p, q) = (edge(i), edge(i + 2));
        let difference = [q[0] - p[0], q[1] - p[1]];
        [
            p[0] + difference[0] * from.y,
            p[1] + difference[1] * from.y + difference[0] * change.y,
            difference[1] * change.y,
        ]
    };
    let (p, q) = (face(0), face(4));
    let difference = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    Cubic([
        p[0] + difference[0] * from.z,
        p[1] + difference[1] * from.z + difference[0] * change.z,
        p[2] + difference[2] * from.z + difference[1] * change.z,
        difference[2] * change.z,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cubic_is_the_trilinear_value() {
        let values = [0.3, 1.2, -0.7, 2.0, 0.1, -1.5, 0.9, 0.4];
        let (from, to) = (DVec3::new(0.1, 0.9, 0.0), DVec3::new(0.8, 0.2, 1.0));
        let cubic = along(&values, from, to);
        for way in [0.0, 0.25, 0.6, 1.0] {
            let f = from.lerp(to, way);
            let mut expected = 0.0;
            for (i, value) in values.iter().enumerate() {
                let weight = |bit: usize, f: f64| if i >> bit & 1 == 1 { f } else { 1.0 - f };
                expected += value * weight(0, f.x) * weight(1, f.y) * weight(2, f.z);
            }
            assert!((cubic.at(way) - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn corners_repeat_the_outermost_voxels() {
        let grid = Grid::new(Size3::new(2, 3, 4), [2.0, 3.0, 4.0]);
        assert_eq!(grid.corners([0, 0, 0]), [0, 1, 2, 3, 6, 7, 8, 9]);
        assert_eq!(grid.corners([-1, 2, 3]), [22, 22, 22, 22, 22, 22, 22, 22]);
    }
}
