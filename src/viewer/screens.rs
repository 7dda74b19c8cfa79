//! What a camera shows on which screens: one picture, two eyes, or a wall; and how the pictures of its views
//! come together as one for the windows.

use std::sync::Arc;

use crate::render::{Picture, StereoLayout};
use crate::scene::{Screen, Stereo, View, Wall};

/// Which pictures a camera's view becomes.
#[derive(Clone, Debug, PartialEq)]
pub enum Screens {
    /// One.
    One,
    /// Two eyes.
    Eyes {
        /// How they share a window.
        layout: EyesLayout,
        /// From eye to eye, and to the plane that seems to lie in the screen; nothing: as is comfortable for
        /// what lies at the pivot.
        separation: Option<f64>,
        /// See `separation`.
        distance: Option<f64>,
    },
    /// A window for each screen of a wall.
    Wall(Wall),
}

/// How two eyes share windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EyesLayout {
    /// In one window.
    Joined(StereoLayout),
    /// Each in its own; the left eye's is the first.
    TwoWindows,
}

/// A window beside the first.
#[derive(Clone, Debug, PartialEq)]
pub struct SideWindow {
    /// Its title.
    pub title: String,
    /// Pixels of its picture.
    pub size: [u32; 2],
    /// Where it opens on the desktop; nothing: where the desktop puts it.
    pub place: Option<[i32; 2]>,
}

impl Screens {
    /// The views of a camera `distance` from its pivot, in a window's part of `size` pixels, each pixel `wider`
    /// times as wide. Nothing where parallel rays have no eyes.
    pub fn views(
        &self,
        camera: &View,
        distance: f64,
        size: [u32; 2],
        wider: u32,
    ) -> Option<Vec<View>> {
        match self {
            Screens::One => Some(vec![camera.clone()]),
            Screens::Eyes { separation, distance: screen, .. } => {
                let stereo = Stereo::or_comfortable(*separation, *screen, distance);
                stereo.eyes(camera, self.picture_size(size, wider)).map(Vec::from)
            }
            Screens::Wall(wall) => Some(wall.coarser(wider).views(camera)),
        }
    }

    /// Pixels of one view's picture, where screens do not say their own.
    pub fn picture_size(&self, [width, height]: [u32; 2], wider: u32) -> [u32; 2] {
        let size = match self {
            Screens::Eyes { layout: EyesLayout::Joined(StereoLayout::SideBySide), .. } => {
                [width / 2, height]
            }
            Screens::Eyes { layout: EyesLayout::Joined(StereoLayout::TopBottom), .. } => {
                [width, height / 2]
            }
            _ => [width, height],
        };
        size.map(|edge| edge.div_ceil(wider).max(1))
    }

    /// The picture of the first window, and those of the others, made of those of all views. Of a wall the first
    /// window shows all screens, one above the other.
    pub fn of_windows(
        &self,
        pictures: &[Arc<Picture>],
        wider: u32,
    ) -> (Arc<Picture>, Vec<Arc<Picture>>) {
        match (self, pictures) {
            (Screens::Eyes { layout: EyesLayout::Joined(layout), .. }, [left, right]) => {
                (Arc::new(layout.joined(left, right)), Vec::new())
            }
            (Screens::Eyes { layout: EyesLayout::TwoWindows, .. }, [left, right]) => {
                (left.clone(), vec![right.clone()])
            }
            (Screens::Wall(wall), _) => {
                let wall = wall.coarser(wider);
                let given = wall.screens.iter().zip(pictures);
                let own =
                    given.map(|(screen, seen)| Arc::new(Picture::clone(seen).on_screen(screen)));
                let own: Vec<Arc<Picture>> = own.collect();
                (Arc::new(stacked(&own)), own)
            }
            (_, [only, ..]) => (only.clone(), Vec::new()),
            (_, []) => unreachable!("a picture of every view"),
        }
    }

    /// The windows beside the first, whose picture has `size` pixels.
    pub fn windows(&self, size: [u32; 2]) -> Vec<SideWindow> {
        match self {
            Screens::Eyes { layout: EyesLayout::TwoWindows, .. } => {
                vec![SideWindow { title: "right eye".to_owned(), size, place: None }]
            }
            Screens::Wall(wall) => {
                let screen = |of: &Screen| SideWindow {
                    title: of.name.clone(),
                    size: of.size,
                    place: of.window,
                };
                wall.screens.iter().map(screen).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Pictures, one above the other.
fn stacked(pictures: &[Arc<Picture>]) -> Picture {
    let width = pictures.iter().map(|picture| picture.size[0]).max().unwrap_or(1);
    let mut pixels = Vec::new();
    for picture in pictures {
        for row in picture.pixels.chunks_exact(picture.size[0] as usize) {
            pixels.extend_from_slice(row);
            pixels.resize(pixels.len().next_multiple_of(width as usize), [0.0; 4]);
        }
    }
    let height = pixels.len() as u32 / width;
    Picture { size: [width, height], pixels }
}
