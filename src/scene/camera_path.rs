//! A camera's way through views, frame by frame.

use glam::{DQuat, DVec3};

use crate::scene::{Projection, View};

/// `[path]`: which views a camera goes through, in how many frames.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CameraPath {
    /// Names of the scene's views in order; none: all of them.
    pub through: Vec<String>,
    /// Pictures along the whole way.
    pub frames: u32,
    /// From the last view back to the first.
    pub closed: bool,
}

impl CameraPath {
    /// Frames of a way that says nothing of them.
    pub const FRAMES_DEFAULT: u32 = 120;
    /// At most.
    pub const FRAMES_MAX: u32 = 100_000;

    /// Through all views, for a scene that says nothing of a path.
    pub fn through_all() -> CameraPath {
        CameraPath { frames: CameraPath::FRAMES_DEFAULT, ..CameraPath::default() }
    }

    /// The camera of every frame, named by its number. It goes through all `views` in equal times, without a
    /// jump of its velocity (a cubic through neighbours, Catmull-Rom), turned around points near `middle`,
    /// so that what stands there stays in the picture; distances grow by equal factors.
    ///
    /// # Errors
    /// Why there is no such way: one view, or views of unlike projections.
    pub fn frames(&self, views: &[View], middle: DVec3) -> Result<Vec<View>, String> {
        let named = |name: &String| {
            let found = views.iter().find(|view| view.name == *name);
            found.cloned().ok_or(format!("[path] goes through \"{name}\", which is no view"))
        };
        let views: Vec<View> = match &self.through[..] {
            [] => views.to_vec(),
            names => names.iter().map(named).collect::<Result<_, _>>()?,
        };
        let [first, _, ..] = &views[..] else {
            return Err("a path needs at least two views to go through".to_owned());
        };
        let kind = |view: &View| std::mem::discriminant(&view.projection);
        if let Some(other) = views.iter().find(|view| kind(view) != kind(first)) {
            return Err(format!(
                "a path cannot go from view \"{}\" to \"{}\": give all of them fov_degrees, or all of them height, or all of them frustum",
                first.name, other.name
            ));
        }
        let knots: Vec<Knot> = views.iter().map(|view| Knot::of(view, middle)).collect();
        let pieces = if self.closed { knots.len() } else { knots.len() - 1 };
        let digits = self.frames.saturating_sub(1).to_string().len().max(4);
        // The last frame of an open way is its last view; a closed one meets its first again one frame later.
        let steps = if self.closed { self.frames } else { self.frames.saturating_sub(1).max(1) };
        let frame = |number: u32| {
            let at = f64::from(number) / f64::from(steps) * pieces as f64;
            let piece = (at as usize).min(pieces - 1);
            Knot::between(&knots, piece, at - piece as f64, self.closed)
                .view(format!("{number:0digits$}"), first)
        };
        Ok((0..self.frames).map(frame).collect())
    }
}

/// A camera as numbers that may be interpolated.
#[derive(Clone, Copy)]
struct Knot {
    pivot: DVec3,
    log_distance: f64,
    turn: DQuat,
    /// Of the projection: half the picture's height at distance 1, logarithm; or left, right, bottom, top.
    extent: [f64; 4],
}

impl Knot {
    fn of(view: &View, middle: DVec3) -> Knot {
        let distance = view.distance_to(middle);
        let extent = match view.projection {
            Projection::Perspective { fov_degrees } => {
                [(fov_degrees.to_radians() / 2.0).tan().ln(), 0.0, 0.0, 0.0]
            }
            Projection::Orthographic { height } => [height.ln(), 0.0, 0.0, 0.0],
            Projection::Frustum { bounds } => bounds,
        };
        let axes = glam::DMat3::from_cols(view.right, view.up, -view.forward);
        Knot {
            pivot: view.eye + distance * view.forward,
            log_distance: distance.ln(),
            turn: DQuat::from_mat3(&axes).normalize(),
            extent,
        }
    }

    /// At `t` of the piece that begins at knot `piece`.
    fn between(knots: &[Knot], piece: usize, t: f64, closed: bool) -> Knot {
        let count = knots.len() as i64;
        let knot = |at: i64| match closed {
            true => knots[at.rem_euclid(count) as usize],
            false => knots[at.clamp(0, count - 1) as usize],
        };
        let at = piece as i64;
        let mut around = [knot(at - 1), knot(at), knot(at + 1), knot(at + 2)];
        for next in 1..4 {
            // The shorter way around.
            if around[next].turn.dot(around[next - 1].turn) < 0.0 {
                around[next].turn = -around[next].turn;
            }
        }
        let weights = catmull_rom(t);
        let sum = |of: &dyn Fn(&Knot) -> f64| -> f64 {
            around.iter().zip(weights).map(|(knot, weight)| weight * of(knot)).sum()
        };
        let axis = |axis: usize| sum(&|knot| knot.pivot[axis]);
        let turn = |part: usize| sum(&|knot| knot.turn.to_array()[part]);
        Knot {
            pivot: DVec3::new(axis(0), axis(1), axis(2)),
            log_distance: sum(&|knot| knot.log_distance),
            turn: DQuat::from_xyzw(turn(0), turn(1), turn(2), turn(3)).normalize(),
            extent: std::array::from_fn(|edge| sum(&|knot| knot.extent[edge])),
        }
    }

    fn view(&self, name: String, like: &View) -> View {
        let axes = glam::DMat3::from_quat(self.turn);
        let [right, up, forward] = [axes.x_axis, axes.y_axis, -axes.z_axis];
        let projection = match like.projection {
            Projection::Perspective { .. } => Projection::Perspective {
                fov_degrees: 2.0 * self.extent[0].exp().atan().to_degrees(),
            },
            Projection::Orthographic { .. } => {
                Projection::Orthographic { height: self.extent[0].exp() }
            }
            Projection::Frustum { .. } => Projection::Frustum { bounds: self.extent },
        };
        let eye = self.pivot - self.log_distance.exp() * forward;
        View { name, eye, forward, right, up, projection, part: None }
    }
}

/// Weights of four neighbours at `t` between the second and the third.
fn catmull_rom(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(name: &str, eye: [f64; 3], fov_degrees: f64) -> View {
        let projection = Projection::Perspective { fov_degrees };
        View::looking_at(name.into(), eye.into(), DVec3::ZERO, DVec3::Z, projection)
            .expect("a view")
    }

    fn views() -> Vec<View> {
        vec![
            view("front", [0.0, -5.0, 0.5], 40.0),
            view("side", [4.0, 0.0, 1.0], 30.0),
            view("back", [0.0, 3.0, 0.0], 40.0),
            view("other", [-4.0, 0.0, -1.0], 50.0),
        ]
    }

    fn assert_alike(a: &View, b: &View) {
        let off = (a.eye - b.eye).length()
            + (a.forward - b.forward).length()
            + (a.up - b.up).length()
            + (a.right - b.right).length();
        assert!(off < 1e-12, "{off}");
        let bounds = [a, b].map(|view| view.bounds_at_1([300, 200]).expect("perspective"));
        assert!(bounds[0].iter().zip(bounds[1]).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn a_way_meets_its_views() {
        let views = views();
        let path = CameraPath { frames: 10, ..CameraPath::default() };
        let frames = path.frames(&views, DVec3::ZERO).expect("a way");
        assert_eq!((frames.len(), &*frames[3].name), (10, "0003"));
        for (number, view) in views.iter().enumerate() {
            assert_alike(&frames[3 * number], view);
        }
        let path = CameraPath { frames: 40, closed: true, ..CameraPath::default() };
        let frames = path.frames(&views, DVec3::ZERO).expect("a way");
        for (number, view) in views.iter().enumerate() {
            assert_alike(&frames[10 * number], view);
        }
    }

    /// Steps of a way of so many frames shrink with their number, and so do the changes from step to step: no
    /// jump, and no jump of velocity, also where a closed way ends. The middle stays in the middle.
    #[test]
    fn a_way_is_smooth_and_keeps_its_middle() {
        let views = views();
        for frames in [400, 4000] {
            let path = CameraPath { frames, closed: true, ..CameraPath::default() };
            let all = path.frames(&views, DVec3::ZERO).expect("a way");
            let eye = |at: usize| all[at % all.len()].eye;
            for (at, view) in all.iter().enumerate() {
                let step = eye(at + 1) - eye(at);
                let next = eye(at + 2) - eye(at + 1);
                assert!(step.length() < 60.0 / f64::from(frames));
                assert!((next - step).length() < 2e3 / f64::from(frames).powi(2), "{at}");
                let aside = (-view.eye).normalize().cross(view.forward).length();
                assert!(aside < 1e-9);
            }
        }
    }

    #[test]
    fn what_is_no_way_is_refused() {
        let mut views = views();
        let path = CameraPath { frames: 10, ..CameraPath::default() };
        assert!(path.frames(&views[..1], DVec3::ZERO).expect_err("one").contains("two views"));
        let through = CameraPath { through: vec!["gone".into(), "side".into()], ..path.clone() };
        assert!(through.frames(&views, DVec3::ZERO).expect_err("none").contains("\"gone\""));
        views[2].projection = Projection::Orthographic { height: 1.0 };
        assert!(path.frames(&views, DVec3::ZERO).expect_err("mixed").contains("\"back\""));
    }
}
