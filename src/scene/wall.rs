//! A wall of screens around one eye: which picture each of them shows.
//!
//! # Source
//! octreemizer-2002 section 5 for walls; the rectangle of a screen seen from an eye as the bounds of an
//! off-axis frustum is the usual generalised perspective projection. Screens that lie in one plane with one
//! pitch of pixels are parts of one picture ([`Part`]), so that they meet byte for byte.

use std::collections::HashSet;
use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::scene::{Part, Projection, View, names_files};

/// The screens of a wall, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Wall {
    /// Where the eye is, where lengths are the world's; else it is a view's.
    eye_world: Option<DVec3>,
    /// In the file's order; at least one.
    pub screens: Vec<Screen>,
}

/// One screen.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    /// Unique on the wall.
    pub name: String,
    /// Its own pixels, across and down.
    pub size: [u32; 2],
    /// Quarter turns, clockwise as it is seen, by which it hangs.
    pub quarter_turns: u8,
    /// Pixels along the left, right, top and bottom of what is seen that a neighbour shows too.
    pub overlap: [u32; 4],
    /// Where its window opens on the desktop, pixels.
    pub window: Option<[i32; 2]>,
    /// To the right, upwards, and towards the eye, in the wall's axes.
    axes: DMat3,
    /// Left, right, bottom and top at distance 1 of the picture that it is a part of.
    bounds: [f64; 4],
    part: Part,
}

/// Most screens of a wall.
const SCREENS_MAX: usize = 64;
/// Pixels along one side of a screen.
const SCREEN_EDGE_MAX: u32 = 32_768;
/// Lengths and places beyond have no picture.
const PLACE_MAX: f64 = 1e12;
/// How far corners may be from a right angle, as a cosine.
const SQUARE_WITHIN: f64 = 1e-6;
/// How far pixels of two screens may be from one grid, pixels.
const GRID_WITHIN: f64 = 1e-3;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WallFile {
    format: i64,
    units: Option<String>,
    eye: [f64; 3],
    #[serde(default)]
    screen: Vec<ScreenFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScreenFile {
    name: Option<String>,
    size: [i64; 2],
    corners: [[f64; 3]; 3],
    rotation: Option<i64>,
    overlap: Option<[i64; 4]>,
    window: Option<[i32; 2]>,
}

impl Wall {
    /// Reads and checks a wall's file.
    ///
    /// # Errors
    /// Exit code 3, one sentence that names file and screen.
    pub fn load(path: &Path) -> Result<Wall> {
        let text = std::fs::read_to_string(path)
            .map_err(|why| Error::input(format!("{}: cannot be read: {why}", path.display())))?;
        Wall::from_toml(&text).map_err(|why| Error::input(format!("{}: {why}", path.display())))
    }

    fn from_toml(text: &str) -> std::result::Result<Wall, String> {
        let file: WallFile = toml::from_str(text).map_err(|why| {
            let line = why.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            format!("line {line}: {}", why.message().trim().replace('\n', ", "))
        })?;
        if file.format != 1 {
            return Err(format!(
                "format {} is not known: this program reads format 1",
                file.format
            ));
        }
        let world = match file.units.as_deref() {
            None | Some("world") => true,
            Some("metres") => false,
            Some(other) => {
                return Err(format!("units must be \"world\" or \"metres\", got \"{other}\""));
            }
        };
        let eye = place(file.eye).ok_or("eye must be finite and within 1e12")?;
        if file.screen.is_empty() || file.screen.len() > SCREENS_MAX {
            return Err(format!(
                "a wall has 1 to {SCREENS_MAX} [[screen]], got {}",
                file.screen.len()
            ));
        }
        let mut names = HashSet::new();
        let mut screens = Vec::new();
        for (index, of_file) in file.screen.iter().enumerate() {
            let screen = Screen::checked(index, of_file, eye)?;
            if !names.insert(screen.name.clone()) {
                return Err(format!("two screens are named \"{}\"", screen.name));
            }
            screens.push(screen);
        }
        join(&mut screens);
        Ok(Wall { eye_world: world.then_some(eye), screens })
    }

    /// Where the wall stands: its eye and axes as a view's. A wall in metres stands around the eye of `view`,
    /// x to its right, y up, z backwards; one in world units where its corners are.
    pub fn base(&self, view: &View) -> View {
        match self.eye_world {
            None => view.clone(),
            Some(eye) => {
                let [right, up, forward] = [DVec3::X, DVec3::Y, DVec3::NEG_Z];
                View { eye, right, up, forward, ..view.clone() }
            }
        }
    }

    /// The same wall with pixels so many times as wide: what is drawn while something moves. Where that does not
    /// divide a screen, its picture is off by less than one of these pixels.
    #[must_use]
    pub fn coarser(&self, wider: u32) -> Wall {
        let mut wall = self.clone();
        if wider > 1 {
            wall.screens.iter_mut().for_each(|screen| {
                let less = |edges: [u32; 2]| edges.map(|edge| edge.div_ceil(wider));
                let Part { of, first, size } = screen.part;
                let first = first.map(|at| at / wider);
                screen.part = Part { of: less(of), first, size: less(size) };
                screen.size = less(screen.size);
                screen.overlap = screen.overlap.map(|edge| edge / wider);
            });
        }
        wall
    }

    /// What each screen shows from `base`, as [`Wall::base`] gave it or moved from there.
    pub fn views(&self, base: &View) -> Vec<View> {
        let world_from_wall = DMat3::from_cols(base.right, base.up, -base.forward);
        let of_screen = |screen: &Screen| {
            let axes = world_from_wall * screen.axes;
            View {
                name: screen.name.clone(),
                eye: base.eye,
                right: axes.x_axis,
                up: axes.y_axis,
                forward: -axes.z_axis,
                projection: Projection::Frustum { bounds: screen.bounds },
                part: Some(screen.part),
            }
        };
        self.screens.iter().map(of_screen).collect()
    }
}

impl Screen {
    fn checked(index: usize, file: &ScreenFile, eye: DVec3) -> std::result::Result<Screen, String> {
        let name = file.name.clone().unwrap_or_else(|| format!("screen{index}"));
        if !names_files(&name) {
            let name = name.escape_debug();
            return Err(format!(
                "screen \"{name}\": a name is made of letters, digits, blanks, - and _"
            ));
        }
        let refuse = |why: String| format!("screen \"{name}\": {why}");
        let pixels =
            |edge: i64| u32::try_from(edge).ok().filter(|e| (1..=SCREEN_EDGE_MAX).contains(e));
        let [Some(across), Some(down)] = file.size.map(pixels) else {
            return Err(refuse(format!(
                "size must be 1 to {SCREEN_EDGE_MAX} pixels across and down, got {:?}",
                file.size
            )));
        };
        let quarter_turns = match file.rotation.unwrap_or(0) {
            degrees @ (0 | 90 | 180 | 270) => (degrees / 90) as u8,
            other => {
                return Err(refuse(format!("rotation must be 0, 90, 180 or 270, got {other}")));
            }
        };
        let own = [across, down];
        let size = turned(own, quarter_turns);
        let overlap = file.overlap.unwrap_or([0; 4]);
        let [left, right, top, bottom] =
            overlap.map(|pixels| u32::try_from(pixels).unwrap_or(u32::MAX));
        if left.saturating_add(right) > size[0] || top.saturating_add(bottom) > size[1] {
            return Err(refuse(format!(
                "overlap must be [left, right, top, bottom] in pixels, together within the screen's {size:?}, got {overlap:?}"
            )));
        }
        let [Some(top_left), Some(top_right), Some(bottom_left)] = file.corners.map(place) else {
            return Err(refuse("corners must be finite and within 1e12".to_owned()));
        };
        let across = (top_right - top_left).try_normalize();
        let upwards = (top_left - bottom_left).try_normalize();
        let (Some(across), Some(upwards)) = (across, upwards) else {
            return Err(refuse(
                "corners must be top left, top right and bottom left, three different places"
                    .to_owned(),
            ));
        };
        if across.dot(upwards).abs() > SQUARE_WITHIN {
            return Err(refuse(
                "corners must make a right angle at the top left: give top left, top right, bottom left"
                    .to_owned(),
            ));
        }
        let normal = across.cross(upwards).normalize();
        // At a right angle to the last digit.
        let upwards = normal.cross(across);
        let from_eye = top_left - eye;
        let distance = -from_eye.dot(normal);
        if distance <= 1e-9 * from_eye.length() {
            return Err(refuse(
                "the eye must be in front of it: seen from there, its corners are top left, top right, bottom left"
                    .to_owned(),
            ));
        }
        let along = |corner: DVec3, axis: DVec3| (corner - eye).dot(axis) / distance;
        let bounds = [
            along(top_left, across),
            along(top_right, across),
            along(bottom_left, upwards),
            along(top_left, upwards),
        ];
        let axes = DMat3::from_cols(across, upwards, normal);
        let part = Part::whole(size);
        let overlap = [left, right, top, bottom];
        let window = file.window;
        Ok(Screen { name, size: own, quarter_turns, overlap, window, axes, bounds, part })
    }
}

/// Pixels across and down of what was `size` before it was turned.
fn turned([width, height]: [u32; 2], quarter_turns: u8) -> [u32; 2] {
    if quarter_turns.is_multiple_of(2) { [width, height] } else { [height, width] }
}

fn place(of: [f64; 3]) -> Option<DVec3> {
    let of = DVec3::from_array(of);
    (of.is_finite() && of.abs().max_element() <= PLACE_MAX).then_some(of)
}

/// Makes screens of one plane and one grid of pixels parts of one picture.
fn join(screens: &mut [Screen]) {
    // As each is seen alone.
    let seen = screens.to_vec();
    let mut joined = vec![false; seen.len()];
    for first in 0..seen.len() {
        if std::mem::replace(&mut joined[first], true) {
            continue;
        }
        // Offsets in pixels, to the right and down, of all that lie on the grid of this one.
        let mut group = vec![(first, [0i64; 2])];
        for next in first + 1..seen.len() {
            if let Some(offset) = seen[first].offset_of(&seen[next]).filter(|_| !joined[next]) {
                joined[next] = true;
                group.push((next, offset));
            }
        }
        let least = |axis: usize| group.iter().map(|(_, offset)| offset[axis]).min().unwrap_or(0);
        let least = [least(0), least(1)];
        let end = |axis: usize| {
            let ends = group.iter().map(|(at, o)| o[axis] + i64::from(seen[*at].part.size[axis]));
            ends.max().unwrap_or(1)
        };
        let of = [0, 1].map(|axis: usize| (end(axis) - least[axis]) as u32);
        let edges = group.iter().map(|(at, _)| seen[*at].bounds);
        let bounds =
            edges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])]);
        for (at, offset) in group {
            screens[at].axes = seen[first].axes;
            screens[at].bounds = bounds.unwrap_or(seen[at].bounds);
            screens[at].part = Part {
                of,
                first: [0, 1].map(|axis: usize| (offset[axis] - least[axis]) as u32),
                size: seen[at].part.size,
            };
        }
    }
}

impl Screen {
    /// Edges of a pixel at distance 1, of a screen that is seen alone.
    fn pitch(&self) -> [f64; 2] {
        let ([left, right, bottom, top], size) = (self.bounds, self.part.size);
        [(right - left) / f64::from(size[0]), (top - bottom) / f64::from(size[1])]
    }

    /// Pixels to the right and down at which `other` begins, if both lie in one plane on one grid.
    fn offset_of(&self, other: &Screen) -> Option<[i64; 2]> {
        let turned = (self.axes - other.axes).to_cols_array().iter().any(|part| part.abs() > 1e-9);
        let pitch = self.pitch();
        let begins = [
            (other.bounds[0] - self.bounds[0]) / pitch[0],
            (self.bounds[3] - other.bounds[3]) / pitch[1],
        ];
        let ends = [
            (other.bounds[1] - self.bounds[0]) / pitch[0],
            (self.bounds[3] - other.bounds[2]) / pitch[1],
        ];
        let on_grid = |at: f64| (at - at.round()).abs() < GRID_WITHIN && at.abs() < 1e6;
        let fits = (0..2).all(|axis| {
            let size = ends[axis].round() - begins[axis].round();
            on_grid(begins[axis]) && on_grid(ends[axis]) && size == f64::from(other.part.size[axis])
        });
        (!turned && fits).then(|| begins.map(|at| at.round() as i64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base() -> View {
        let eye = DVec3::new(3.0, 1.0, 2.0);
        let projection = Projection::Perspective { fov_degrees: 40.0 };
        View::looking_at("v".into(), eye, DVec3::ZERO, DVec3::Z, projection).expect("a view")
    }

    /// One screen: what is seen of it, its own pixels, and how it hangs.
    fn screen(name: &str, corners: [[f64; 3]; 3], size: [u32; 2], more: &str) -> String {
        format!("[[screen]]\nname = \"{name}\"\nsize = {size:?}\ncorners = {corners:?}\n{more}\n")
    }

    fn wall(screens: &[String]) -> std::result::Result<Wall, String> {
        Wall::from_toml(&format!(
            "format = 1\nunits = \"metres\"\neye = [0.25, 0.5, 2.0]\n{}",
            screens.concat()
        ))
    }

    const LEFT: [[f64; 3]; 3] = [[-1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [-1.0, -1.0, 0.0]];
    const RIGHT: [[f64; 3]; 3] = [[0.0, 1.0, 0.0], [1.5, 1.0, 0.0], [0.0, -1.0, 0.0]];
    /// Towards the eye, from the right screen's edge.
    const SIDE: [[f64; 3]; 3] = [[1.5, 1.0, 0.0], [1.5, 1.0, 2.0], [1.5, -1.0, 0.0]];

    /// Every pixel's ray goes through the pixel's place on its screen.
    #[test]
    fn rays_go_through_the_screens() {
        let screens = [
            screen("left", LEFT, [100, 200], ""),
            screen("right", RIGHT, [200, 150], "rotation = 90"),
            screen("side", SIDE, [90, 120], "rotation = 180"),
        ];
        let wall = wall(&screens).expect("a wall");
        let base = base();
        let world = |at: DVec3| {
            base.eye
                + (at - DVec3::new(0.25, 0.5, 2.0)).dot(DVec3::X) * base.right
                + (at - DVec3::new(0.25, 0.5, 2.0)).dot(DVec3::Y) * base.up
                - (at - DVec3::new(0.25, 0.5, 2.0)).dot(DVec3::Z) * base.forward
        };
        let views = wall.views(&wall.base(&base));
        for ((view, corners), seen) in
            views.iter().zip([LEFT, RIGHT, SIDE]).zip([[100, 200], [150, 200], [90, 120]])
        {
            let part = view.pixels([1, 1]);
            assert_eq!(part.size, seen);
            let frame = view.ray_frame_world([1, 1]);
            let [a, b, c] = corners.map(DVec3::from_array);
            for [column, row] in [[0, 0], [seen[0] - 1, 0], [7, seen[1] - 1]] {
                let (origin, direction) = frame.ray(part.first[0] + column, part.first[1] + row);
                let x = (f64::from(column) + 0.5) / f64::from(seen[0]);
                let y = (f64::from(row) + 0.5) / f64::from(seen[1]);
                let through = world(a + x * (b - a) + y * (c - a)) - origin;
                let off = through.normalize().cross(direction.normalize()).length();
                assert!(off < 1e-12, "{}: {off}", view.name);
            }
        }
        // Left and right have one grid; the side has its own.
        let parts: Vec<Part> = wall.screens.iter().map(|screen| screen.part).collect();
        assert_eq!(parts[0], Part { of: [250, 200], first: [0, 0], size: [100, 200] });
        assert_eq!(parts[1], Part { of: [250, 200], first: [100, 0], size: [150, 200] });
        assert_eq!(parts[2], Part::whole([90, 120]));
    }

    #[test]
    fn a_wall_in_the_world_stands_where_its_corners_are() {
        let text =
            format!("format = 1\neye = [0.0, 0.0, 2.0]\n{}", screen("only", LEFT, [100, 200], ""));
        let wall = Wall::from_toml(&text).expect("a wall");
        let [view] = &wall.views(&wall.base(&base()))[..] else { panic!("one screen") };
        assert_eq!((view.eye, view.forward), (DVec3::new(0.0, 0.0, 2.0), -DVec3::Z));
        assert_eq!(view.bounds_at_1([1, 1]), Some([-0.5, 0.0, -0.5, 0.5]));
    }

    #[test]
    fn another_pitch_or_half_a_pixel_is_another_picture() {
        let shifted = RIGHT.map(|[x, y, z]| [x + 0.005, y, z]);
        for (corners, size) in [(RIGHT, [149, 200]), (shifted, [150, 200])] {
            let screens = [screen("a", LEFT, [100, 200], ""), screen("b", corners, size, "")];
            let wall = wall(&screens).expect("a wall");
            assert_eq!(wall.screens[1].part, Part::whole(size));
        }
    }

    #[test]
    fn what_cannot_be_a_wall_is_refused_in_a_sentence() {
        let behind = [LEFT[1], LEFT[0], [0.0, -1.0, 0.0]];
        let sheared = [LEFT[0], LEFT[1], [-0.9, -1.0, 0.0]];
        for (screens, words) in [
            (vec![], "1 to 64"),
            (vec![screen("a", behind, [9, 9], "")], "in front of it"),
            (vec![screen("a", sheared, [9, 9], "")], "right angle"),
            (vec![screen("a", [LEFT[0]; 3], [9, 9], "")], "three different"),
            (vec![screen("a", LEFT, [0, 9], "")], "size must be"),
            (vec![screen("a", LEFT, [9, 9], "rotation = 45")], "rotation must be"),
            (vec![screen("a", LEFT, [9, 9], "overlap = [5, 5, 0, 0]")], "overlap must be"),
            (vec![screen("a", LEFT, [9, 9], "overlap = [-1, 0, 0, 0]")], "overlap must be"),
            (vec![screen("a", LEFT, [9, 9], "gap = 1")], "line 8: unknown field"),
            (vec![screen("a/b", LEFT, [9, 9], "")], "letters, digits"),
            (vec![screen("a", LEFT, [9, 9], ""), screen("a", RIGHT, [9, 9], "")], "two screens"),
        ] {
            let why = wall(&screens).expect_err(words);
            assert!(why.contains(words) && !why.contains('\n'), "{why}");
        }
    }
}
