//! Two eyes in the place of one: off-axis frusta that share a screen.
//!
//! # Source
//! octreemizer-2002 section 5 for stereo displays; the parallel-axis asymmetric frustum, since eyes that turn
//! towards each other shear what is above and below the middle.

use crate::scene::{Projection, View};

/// How two eyes look at one screen. Both lengths are in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stereo {
    /// From eye to eye.
    pub separation: f64,
    /// From the eyes to the plane that seems to lie in the screen.
    pub distance: f64,
}

/// From eye to eye, as a part of the way to the screen: comfortable for most.
const SEPARATION_OF_DISTANCE: f64 = 1.0 / 30.0;

impl Stereo {
    /// What is given, else what is comfortable: the screen where the middle is, `to_middle` from the eyes.
    pub fn or_comfortable(
        separation: Option<f64>,
        distance: Option<f64>,
        to_middle: f64,
    ) -> Stereo {
        let distance = distance.unwrap_or(to_middle);
        Stereo { separation: separation.unwrap_or(SEPARATION_OF_DISTANCE * distance), distance }
    }

    /// The left and the right eye of a view whose picture has `size` pixels: half the separation to either side,
    /// with one rectangle at the screen's distance. Nothing for parallel rays, which have no eye.
    pub fn eyes(&self, view: &View, size: [u32; 2]) -> Option<[View; 2]> {
        let [left, right, bottom, top] = view.bounds_at_1(size)?;
        let eye = |name: &str, side: f64| {
            let aside = 0.5 * side * self.separation;
            let shift = aside / self.distance;
            View {
                name: format!("{}-{name}", view.name),
                eye: view.eye + aside * view.right,
                projection: Projection::Frustum {
                    bounds: [left - shift, right - shift, bottom, top],
                },
                ..view.clone()
            }
        };
        Some([eye("left", -1.0), eye("right", 1.0)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// The ray of a pixel meets the screen's plane in the same point from either eye and from between them.
    #[test]
    fn all_eyes_see_the_screen_in_the_same_place() {
        let size = [320, 200];
        let stereo = Stereo { separation: 0.7, distance: 3.0 };
        for projection in [
            Projection::Perspective { fov_degrees: 50.0 },
            Projection::Frustum { bounds: [-0.9, 0.1, -0.3, 0.6] },
        ] {
            let eye = DVec3::new(1.0, -2.0, 0.5);
            let view = View::looking_at("v".into(), eye, DVec3::ZERO, DVec3::Z, projection);
            let view = view.expect("a view");
            let [left, right] = stereo.eyes(&view, size).expect("eyes");
            assert!((right.eye - left.eye - 0.7 * view.right).length() < 1e-12);
            let met = |of: &View, pixel: [f64; 2]| {
                let frame = of.ray_frame_world(size);
                let direction = frame.direction
                    + pixel[0] * frame.direction_column
                    + pixel[1] * frame.direction_row;
                frame.origin + direction * (3.0 / direction.dot(of.forward))
            };
            for pixel in [[0.5, 0.5], [160.0, 100.0], [319.5, 7.5]] {
                let between = met(&view, pixel);
                for eye in [&left, &right] {
                    assert!((met(eye, pixel) - between).length() < 1e-12, "{pixel:?}");
                }
            }
            assert_eq!([&*left.name, &*right.name], ["v-left", "v-right"]);
        }
        let flat = Projection::Orthographic { height: 1.0 };
        let flat = View::looking_at("v".into(), DVec3::X, DVec3::ZERO, DVec3::Z, flat);
        assert!(stereo.eyes(&flat.expect("a view"), size).is_none());
    }
}
