//! A camera that people steer: around a pivot, along the picture, nearer and farther, or through the volume.
//!
//! # Units
//! World; turns in radians; shifts in heights of the picture.

use glam::{DQuat, DVec3};

use crate::scene::{Projection, View};

/// See the module.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    view: View,
    /// From the eye to the point that it turns around.
    distance: f64,
    home: (View, f64),
}

/// A direction to look along, with what is up then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Along {
    /// From the front: along +y, z up.
    Front,
    /// Along -y.
    Back,
    /// Along +x.
    Left,
    /// Along -x.
    Right,
    /// Along -z, y up.
    Top,
    /// Along +z.
    Bottom,
}

impl Along {
    /// As buttons call them.
    pub const NAMED: [(&'static str, Along); 6] = [
        ("front", Along::Front),
        ("back", Along::Back),
        ("left", Along::Left),
        ("right", Along::Right),
        ("top", Along::Top),
        ("bottom", Along::Bottom),
    ];
}

/// Nearer than this part of where it began it does not come.
const NEAREST: f64 = 1e-4;
/// Nor farther.
const FARTHEST: f64 = 1e4;

impl Camera {
    /// Begins at a view, and turns around the point of its line of sight that is nearest to `middle`.
    pub fn new(view: View, middle: DVec3) -> Camera {
        let distance = view.distance_to(middle);
        Camera { home: (view.clone(), distance), view, distance }
    }

    /// Where it is.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// From the eye to what it turns around.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Goes to another view, and turns around the point of its line of sight that is nearest to `middle`. Home
    /// stays where it is.
    pub fn go_to(&mut self, view: View, middle: DVec3) {
        self.distance = view.distance_to(middle);
        self.view = view;
    }

    /// What it turns around.
    pub fn pivot(&self) -> DVec3 {
        self.view.eye + self.distance * self.view.forward
    }

    /// Back to where it began.
    pub fn go_home(&mut self) {
        (self.view, self.distance) = self.home.clone();
    }

    /// Turns around the pivot: the picture's content follows a hand that goes right and down.
    pub fn orbit(&mut self, right: f64, down: f64) {
        let pivot = self.pivot();
        let turn = DQuat::from_axis_angle(self.view.up, -right)
            * DQuat::from_axis_angle(self.view.right, -down);
        self.turn(turn);
        self.view.eye = pivot - self.distance * self.view.forward;
    }

    /// Turns on the spot: looks to the right and downwards.
    pub fn look(&mut self, right: f64, down: f64) {
        let turn = DQuat::from_axis_angle(self.view.up, -right)
            * DQuat::from_axis_angle(self.view.right, -down);
        self.turn(turn);
    }

    /// Turns the picture around the line of sight.
    pub fn roll(&mut self, angle: f64) {
        self.turn(DQuat::from_axis_angle(self.view.forward, angle));
    }

    /// Moves along the picture, so that what is at the pivot goes right and down by such parts of the
    /// picture's height.
    pub fn pan(&mut self, right: f64, down: f64) {
        let height = self.height_at_pivot();
        self.view.eye += height * (down * self.view.up - right * self.view.right);
    }

    /// Goes nearer to the pivot by this factor; below 1: farther.
    pub fn zoom(&mut self, nearer: f64) {
        let (_, home) = self.home;
        match &mut self.view.projection {
            Projection::Orthographic { height } => {
                let Projection::Orthographic { height: at_home } = self.home.0.projection else {
                    return;
                };
                *height = (*height / nearer).clamp(at_home * NEAREST, at_home * FARTHEST);
            }
            Projection::Perspective { .. } | Projection::Frustum { .. } => {
                let pivot = self.pivot();
                self.distance = (self.distance / nearer).clamp(home * NEAREST, home * FARTHEST);
                self.view.eye = pivot - self.distance * self.view.forward;
            }
        }
    }

    /// Flies forward, to the right and upwards, by parts of the way to the pivot at home; the pivot comes too.
    pub fn fly(&mut self, forward: f64, right: f64, up: f64) {
        let View { forward: ahead, right: aside, up: above, .. } = self.view;
        self.view.eye += self.home.1 * (forward * ahead + right * aside + up * above);
    }

    /// Looks at the pivot along an axis of the world.
    pub fn look_along(&mut self, along: Along) {
        let pivot = self.pivot();
        let (forward, up) = match along {
            Along::Front => (DVec3::Y, DVec3::Z),
            Along::Back => (-DVec3::Y, DVec3::Z),
            Along::Left => (DVec3::X, DVec3::Z),
            Along::Right => (-DVec3::X, DVec3::Z),
            Along::Top => (-DVec3::Z, DVec3::Y),
            Along::Bottom => (DVec3::Z, DVec3::Y),
        };
        self.view.forward = forward;
        self.view.up = up;
        self.view.right = forward.cross(up);
        self.view.eye = pivot - self.distance * forward;
    }

    /// The picture's height, in the world, at the pivot.
    fn height_at_pivot(&self) -> f64 {
        match self.view.projection {
            Projection::Orthographic { height } => height,
            Projection::Perspective { fov_degrees } => {
                2.0 * self.distance * (fov_degrees.to_radians() / 2.0).tan()
            }
            Projection::Frustum { bounds: [_, _, bottom, top] } => self.distance * (top - bottom),
        }
    }

    /// Rounding of many small turns never shears the picture.
    fn turn(&mut self, turn: DQuat) {
        let view = &mut self.view;
        view.forward = (turn * view.forward).normalize();
        let right = turn * view.right;
        view.right = (right - right.dot(view.forward) * view.forward).normalize();
        view.up = view.right.cross(view.forward);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        let eye = DVec3::new(3.0, -4.0, 2.0);
        let view =
            View::looking_at("made".into(), eye, DVec3::ONE, DVec3::Z, projection).expect("a view");
        Camera::new(view, DVec3::ONE)
    }

    const PERSPECTIVE: Projection = Projection::Perspective { fov_degrees: 40.0 };

    /// Where a point is in the picture, to the right and up, in heights of the picture.
    fn seen(camera: &Camera, point: DVec3) -> [f64; 2] {
        let view = camera.view();
        let to = point - view.eye;
        let height = match view.projection {
            Projection::Orthographic { height } => height,
            Projection::Perspective { fov_degrees } => {
                2.0 * to.dot(view.forward) * (fov_degrees.to_radians() / 2.0).tan()
            }
            Projection::Frustum { .. } => unreachable!("not here"),
        };
        [to.dot(view.right) / height, to.dot(view.up) / height]
    }

    fn assert_upright(camera: &Camera) {
        let View { forward, right, up, .. } = *camera.view();
        for (a, b, dot) in [(forward, right, 0.0), (forward, up, 0.0), (right, up, 0.0)] {
            assert!((a.dot(b) - dot).abs() < 1e-12);
        }
        assert!(
            (forward.length() - 1.0).abs() < 1e-12 && (right.cross(forward) - up).length() < 1e-12
        );
    }

    #[test]
    fn orbiting_keeps_the_pivot_in_the_middle_and_follows_the_hand() {
        for projection in [PERSPECTIVE, Projection::Orthographic { height: 3.0 }] {
            let mut camera = camera(projection);
            let nearer = camera.pivot() - 0.5 * camera.view().forward;
            for turn in 0..10_000 {
                camera.orbit(0.01 * f64::from(turn % 7), 0.003);
            }
            assert_upright(&camera);
            assert!((camera.pivot() - DVec3::ONE).length() < 1e-9);
            camera.go_home();
            camera.orbit(0.1, 0.05);
            let [right, up] = seen(&camera, nearer);
            assert!(right > 0.0 && up < 0.0, "what is in front goes with the hand: {right} {up}");
        }
    }

    #[test]
    fn panning_moves_the_picture_by_so_many_heights() {
        for projection in [PERSPECTIVE, Projection::Orthographic { height: 3.0 }] {
            let mut camera = camera(projection);
            camera.pan(0.25, 0.1);
            let [right, up] = seen(&camera, DVec3::ONE);
            assert!((right - 0.25).abs() < 1e-12 && (up + 0.1).abs() < 1e-12);
        }
    }

    #[test]
    fn zooming_twice_as_near_shows_twice_as_large_and_has_an_end() {
        for projection in [PERSPECTIVE, Projection::Orthographic { height: 3.0 }] {
            let mut camera = camera(projection);
            let aside = camera.pivot() + 0.1 * camera.view().right;
            let [before, _] = seen(&camera, aside);
            camera.zoom(2.0);
            let [after, _] = seen(&camera, aside);
            assert!((after / before - 2.0).abs() < 1e-9);
            (0..1000).for_each(|_| camera.zoom(2.0));
            assert!(camera.view().eye.is_finite() && camera.pivot().is_finite());
            (0..5000).for_each(|_| camera.zoom(0.5));
            assert!(camera.view().eye.is_finite());
        }
    }

    #[test]
    fn axes_and_home() {
        let mut camera = camera(PERSPECTIVE);
        let home = camera.clone();
        for along in
            [Along::Front, Along::Back, Along::Left, Along::Right, Along::Top, Along::Bottom]
        {
            camera.look_along(along);
            assert_upright(&camera);
            assert!((camera.pivot() - DVec3::ONE).length() < 1e-9, "{along:?}");
        }
        camera.fly(0.5, 0.1, 0.2);
        camera.look(0.3, 0.1);
        camera.roll(0.2);
        assert_upright(&camera);
        camera.go_home();
        assert_eq!(camera, home);
    }

    #[test]
    fn a_pivot_is_in_front_even_of_a_camera_that_looks_away() {
        let eye = DVec3::new(0.0, 0.0, 5.0);
        let view = View::looking_at("made".into(), eye, DVec3::Z * 9.0, DVec3::Y, PERSPECTIVE);
        let camera = Camera::new(view.expect("a view"), DVec3::ZERO);
        assert!((camera.pivot() - eye).dot(camera.view().forward) > 0.0);
    }
}
