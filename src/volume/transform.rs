//! From voxel positions to the world.

use glam::{DAffine3, DMat3, DVec3};

use crate::error::{Error, Result};

/// Affine map from voxel space (corner origin: voxel i covers [i, i + 1)) to world units, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldFromVoxel {
    affine: DAffine3,
}

impl WorldFromVoxel {
    /// From the rows of a 3 x 4 matrix.
    ///
    /// # Errors
    /// When an entry is not finite or the matrix has no inverse that f64 can hold.
    pub fn from_rows(rows: [[f64; 4]; 3]) -> Result<WorldFromVoxel> {
        if rows.iter().flatten().any(|entry| !entry.is_finite()) {
            return Err(Error::input("transform must be finite in every entry"));
        }
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        let affine = DAffine3::from_cols(column(0), column(1), column(2), column(3));
        let map = WorldFromVoxel { affine };
        // Rows and columns are scaled away first, so that tiny or huge units do not look singular.
        let spacing = map.spacing();
        if spacing.min_element() <= 0.0 {
            return Err(Error::input("transform must not be singular: an axis has length 0"));
        }
        let unit = DMat3::from_cols(
            affine.matrix3.x_axis / spacing.x,
            affine.matrix3.y_axis / spacing.y,
            affine.matrix3.z_axis / spacing.z,
        );
        // Volume of the parallelepiped of unit axes: 0 when they lie in a plane.
        if unit.determinant().abs() < 1e-13 || !map.voxel_from_world().is_finite() {
            return Err(Error::input(
                "transform must not be singular: its axes lie in one plane (or nearly)",
            ));
        }
        Ok(map)
    }

    /// From the rows of a map of voxel *centres* (NIfTI, NRRD): the origin moves by half a voxel.
    ///
    /// # Errors
    /// As [`WorldFromVoxel::from_rows`].
    pub fn from_centre_rows(mut rows: [[f64; 4]; 3]) -> Result<WorldFromVoxel> {
        for row in &mut rows {
            row[3] -= 0.5 * (row[0] + row[1] + row[2]);
        }
        WorldFromVoxel::from_rows(rows)
    }

    /// Axis-aligned: world = voxel position * spacing.
    ///
    /// # Errors
    /// When a spacing is not positive and finite.
    pub fn from_spacing(spacing: [f64; 3]) -> Result<WorldFromVoxel> {
        if let Some(bad) = spacing.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
            return Err(Error::input(format!("spacing must be positive and finite, got {bad}")));
        }
        let [x, y, z] = spacing;
        WorldFromVoxel::from_rows([[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]])
    }

    /// The rows of the 3 x 4 matrix.
    pub fn rows(&self) -> [[f64; 4]; 3] {
        let m = self.affine.matrix3;
        let t = self.affine.translation;
        let row = |r: usize| [m.x_axis[r], m.y_axis[r], m.z_axis[r], t[r]];
        [row(0), row(1), row(2)]
    }

    /// World length of one voxel along each voxel axis.
    pub fn spacing(&self) -> DVec3 {
        let m = self.affine.matrix3;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }

    /// World length of the shortest voxel edge.
    pub fn smallest_edge(&self) -> f64 {
        self.spacing().min_element()
    }

    /// A voxel position in the world.
    pub fn point(&self, position_voxel: DVec3) -> DVec3 {
        self.affine.transform_point3(position_voxel)
    }

    /// A voxel-space vector in the world.
    pub fn vector(&self, vector_voxel: DVec3) -> DVec3 {
        self.affine.transform_vector3(vector_voxel)
    }

    /// The inverse map.
    pub fn voxel_from_world(&self) -> DAffine3 {
        self.affine.inverse()
    }

    /// Most voxels that one world unit in any direction may cross along one axis.
    pub fn voxels_per_world_max(&self) -> f64 {
        let rows = self.voxel_from_world().matrix3.transpose();
        rows.x_axis.length().max(rows.y_axis.length()).max(rows.z_axis.length())
    }
}
