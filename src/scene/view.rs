//! Views: one camera each, and the rays of its pixels.

use glam::{DMat3, DVec3};

use crate::volume::WorldFromVoxel;

/// `[[view]]`: one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Unique in the scene.
    pub name: String,
    /// Where the camera is, world.
    pub eye: DVec3,
    /// Unit vector along the line of sight.
    pub forward: DVec3,
    /// Unit vector to the right in the picture.
    pub right: DVec3,
    /// Unit vector upwards in the picture.
    pub up: DVec3,
    /// How pixels map to rays.
    pub projection: Projection,
    /// Which pixels of that picture are drawn; nothing: all of the scene's picture.
    pub part: Option<Part>,
}

/// A rectangle of a larger picture's pixels: their rays, and so their bytes, are those of the larger one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Pixels of the larger picture, across and down.
    pub of: [u32; 2],
    /// The rectangle's first pixel in it.
    pub first: [u32; 2],
    /// Pixels of the rectangle.
    pub size: [u32; 2],
}

impl Part {
    /// The whole of a picture.
    pub fn whole(size: [u32; 2]) -> Part {
        Part { of: size, first: [0; 2], size }
    }
}

/// How pixels map to rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Rays leave the eye; the vertical angle between the picture's edges.
    Perspective {
        /// In degrees.
        fov_degrees: f64,
    },
    /// Parallel rays; the picture's height in world units.
    Orthographic {
        /// In world units.
        height: f64,
    },
    /// Rays leave the eye through a rectangle at distance 1: left, right, bottom, top.
    Frustum {
        /// Left, right, bottom and top, in world units at distance 1.
        bounds: [f64; 4],
    },
}

/// The rays of a picture, linear in the pixel (column from the left, row from the top).
///
/// The ray of a pixel starts at `origin + column * origin_column + row * origin_row` and runs along
/// `direction + column * direction_column + row * direction_row`, which is not normalised; column
/// and row are those of the pixel's centre (index + 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayFrame {
    /// Origin of the ray at the picture's top left corner.
    pub origin: DVec3,
    /// Change of the origin per column.
    pub origin_column: DVec3,
    /// Change of the origin per row.
    pub origin_row: DVec3,
    /// Direction of the ray at the picture's top left corner.
    pub direction: DVec3,
    /// Change of the direction per column.
    pub direction_column: DVec3,
    /// Change of the direction per row.
    pub direction_row: DVec3,
}

impl View {
    /// A camera at `eye` that looks at `target`; or the argument that forbids it, and why.
    pub fn looking_at(
        name: String,
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        projection: Projection,
    ) -> Result<View, (&'static str, &'static str)> {
        let forward =
            (target - eye).try_normalize().ok_or(("target", "eye and target must differ"))?;
        let up_unit = up.try_normalize().ok_or(("up", "up must not be zero"))?;
        let right = forward.cross(up_unit);
        if right.length() < 1e-9 {
            return Err(("up", "up must not be parallel to the line of sight"));
        }
        let right = right.normalize();
        Ok(View { name, eye, forward, right, up: right.cross(forward), projection, part: None })
    }

    /// From the eye to the point of the line of sight that is nearest to `middle`; where that lies behind the
    /// eye or beside it, as far as `middle` is.
    pub fn distance_to(&self, middle: DVec3) -> f64 {
        let along = (middle - self.eye).dot(self.forward);
        if along > 0.0 { along } else { (middle - self.eye).length().max(1.0) }
    }

    /// The pixels of this view in a scene whose pictures have `size`.
    pub fn pixels(&self, size: [u32; 2]) -> Part {
        self.part.unwrap_or(Part::whole(size))
    }

    /// The rectangle at distance 1 through which rays of a picture of `size` pixels leave the eye: left, right,
    /// bottom, top; of a part, those of all of its picture. Nothing where they are parallel.
    pub fn bounds_at_1(&self, size: [u32; 2]) -> Option<[f64; 4]> {
        let size = self.pixels(size).of;
        match self.projection {
            Projection::Perspective { fov_degrees } => {
                Some(around_middle((fov_degrees.to_radians() / 2.0).tan(), size))
            }
            Projection::Orthographic { .. } => None,
            Projection::Frustum { bounds } => Some(bounds),
        }
    }

    /// The camera turned by so many degrees around the axis through `middle` that points up in its picture.
    #[must_use]
    pub fn turned(&self, middle: DVec3, degrees: f64) -> View {
        let turn = DMat3::from_axis_angle(self.up, degrees.to_radians());
        View {
            eye: middle + turn * (self.eye - middle),
            forward: turn * self.forward,
            right: turn * self.right,
            up: turn * self.up,
            ..self.clone()
        }
    }

    /// Where a point of the world is in a picture of `size` pixels: column and row as [`RayFrame`] counts them.
    /// Nothing behind the eye.
    pub fn pixel_of(&self, point: DVec3, size: [u32; 2]) -> Option<[f64; 2]> {
        let pixels = self.pixels(size);
        let to = point - self.eye;
        let (scale, [left, right, bottom, top]) = match (self.bounds_at_1(size), self.projection) {
            (Some(bounds), _) => (to.dot(self.forward), bounds),
            (None, Projection::Orthographic { height }) => {
                (1.0, around_middle(height / 2.0, pixels.of))
            }
            (None, _) => return None,
        };
        let across = (to.dot(self.right) / scale - left) / (right - left);
        let down = (top - to.dot(self.up) / scale) / (top - bottom);
        let [width, height] = pixels.of.map(f64::from);
        (scale > 0.0).then_some([across * width, down * height])
    }

    /// The rays, in world space, of a picture of `size` pixels (across, down). A part's pixels count from the
    /// larger picture's corner.
    pub fn ray_frame_world(&self, size: [u32; 2]) -> RayFrame {
        let size = self.pixels(size).of;
        let [width, height] = size.map(f64::from);
        let [left, right, bottom, top] = match (self.bounds_at_1(size), self.projection) {
            (Some(bounds), _) => bounds,
            (None, Projection::Orthographic { height: world }) => around_middle(world / 2.0, size),
            (None, _) => [0.0; 4],
        };
        let corner = self.right * left + self.up * top;
        let column = self.right * ((right - left) / width);
        let row = self.up * ((bottom - top) / height);
        match self.projection {
            Projection::Orthographic { .. } => RayFrame {
                origin: self.eye + corner,
                origin_column: column,
                origin_row: row,
                direction: self.forward,
                direction_column: DVec3::ZERO,
                direction_row: DVec3::ZERO,
            },
            Projection::Perspective { .. } | Projection::Frustum { .. } => RayFrame {
                origin: self.eye,
                origin_column: DVec3::ZERO,
                origin_row: DVec3::ZERO,
                direction: self.forward + corner,
                direction_column: column,
                direction_row: row,
            },
        }
    }
}

/// Left, right, bottom and top of a picture's rectangle whose middle is 0.
fn around_middle(top: f64, size: [u32; 2]) -> [f64; 4] {
    let [width, height] = size.map(f64::from);
    [-top * width / height, top * width / height, -top, top]
}

impl RayFrame {
    /// The same rays under an affine map, such as voxel from world.
    #[must_use]
    pub fn mapped(&self, map: &glam::DAffine3) -> RayFrame {
        RayFrame {
            origin: map.transform_point3(self.origin),
            origin_column: map.transform_vector3(self.origin_column),
            origin_row: map.transform_vector3(self.origin_row),
            direction: map.transform_vector3(self.direction),
            direction_column: map.transform_vector3(self.direction_column),
            direction_row: map.transform_vector3(self.direction_row),
        }
    }

    /// These rays, given in the world, in voxels (corner origin). The origin is taken relative to
    /// the volume's corner first, so that a volume far from the world's origin loses no digits.
    #[must_use]
    pub fn in_voxels(&self, world_from_voxel: &WorldFromVoxel) -> RayFrame {
        let corner_world = world_from_voxel.point(DVec3::ZERO);
        let mut linear = world_from_voxel.voxel_from_world();
        linear.translation = DVec3::ZERO;
        RayFrame { origin: self.origin - corner_world, ..*self }.mapped(&linear)
    }

    /// Origin and direction of the ray through the centre of pixel (column, row).
    pub fn ray(&self, column: u32, row: u32) -> (DVec3, DVec3) {
        let (column, row) = (f64::from(column) + 0.5, f64::from(row) + 0.5);
        (
            self.origin + self.origin_column * column + self.origin_row * row,
            self.direction + self.direction_column * column + self.direction_row * row,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_a_pixels_ray_is_in_that_pixel() {
        let size = [300, 200];
        for projection in [
            Projection::Perspective { fov_degrees: 50.0 },
            Projection::Orthographic { height: 3.0 },
            Projection::Frustum { bounds: [-0.9, 0.1, -0.3, 0.6] },
        ] {
            let eye = DVec3::new(1.0, -2.0, 0.5);
            let view = View::looking_at("v".into(), eye, DVec3::ZERO, DVec3::Z, projection);
            let view = view.expect("a view");
            for pixel in [[0, 0], [299, 0], [17, 133]] {
                let (origin, direction) = view.ray_frame_world(size).ray(pixel[0], pixel[1]);
                let [column, row] =
                    view.pixel_of(origin + 3.0 * direction, size).expect("in front");
                let off =
                    (column - f64::from(pixel[0]) - 0.5).hypot(row - f64::from(pixel[1]) - 0.5);
                assert!(off < 1e-9, "{projection:?} {pixel:?}: {off}");
            }
            if view.bounds_at_1(size).is_some() {
                assert!(view.pixel_of(eye - view.forward, size).is_none());
            }
        }
    }
}
