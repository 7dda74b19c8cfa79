//! How many voxels there are along each axis.

use std::fmt;

/// Voxels (or bricks) along x, y and z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size3 {
    /// Along x, the fastest axis in memory.
    pub x: u32,
    /// Along y.
    pub y: u32,
    /// Along z.
    pub z: u32,
}

impl Size3 {
    /// A size from its three extents.
    pub const fn new(x: u32, y: u32, z: u32) -> Size3 {
        Size3 { x, y, z }
    }

    /// The same extent along every axis.
    pub const fn cube(edge: u32) -> Size3 {
        Size3::new(edge, edge, edge)
    }

    /// x, y, z as an array.
    pub const fn to_array(self) -> [u32; 3] {
        [self.x, self.y, self.z]
    }

    /// From x, y, z.
    pub const fn from_array([x, y, z]: [u32; 3]) -> Size3 {
        Size3::new(x, y, z)
    }

    /// How many voxels there are in all; cannot overflow.
    pub fn voxel_count(self) -> u128 {
        u128::from(self.x) * u128::from(self.y) * u128::from(self.z)
    }

    /// The voxel count as a length in memory, or nothing where no memory is that large.
    pub fn len(self) -> Option<usize> {
        usize::try_from(self.voxel_count()).ok().filter(|&len| len <= isize::MAX as usize)
    }

    /// Whether some axis has no voxel.
    pub fn is_empty(self) -> bool {
        self.x == 0 || self.y == 0 || self.z == 0
    }

    /// Position of voxel (x, y, z) in memory, x fastest.
    pub fn index(self, x: u32, y: u32, z: u32) -> usize {
        debug_assert!(x < self.x && y < self.y && z < self.z);
        (z as usize * self.y as usize + y as usize) * self.x as usize + x as usize
    }
}

impl fmt::Display for Size3 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {} x {}", self.x, self.y, self.z)
    }
}
