//! Flags of pictures for two eyes.

use clap::Args;

use crate::error::{Error, Result};
use crate::render::{SceneData, StereoLayout};
use crate::scene::{Stereo, View};
#[cfg(feature = "viewer")]
use crate::viewer::{EyesLayout, Screens};

/// Two eyes.
#[derive(Args)]
pub struct StereoFlags {
    /// Draw each view for two eyes: side-by-side, top-bottom, anaglyph (for glasses of red and cyan), pair (two
    /// files). Both eyes share the atlas: a brick that both see is loaded once.
    #[arg(long, value_name = "HOW", value_parser = how, help_heading = "Stereo")]
    stereo: Option<How>,
    /// From eye to eye, world units; default: a thirtieth of --screen-distance.
    #[arg(long, value_name = "LENGTH", requires = "stereo", help_heading = "Stereo")]
    eye_separation: Option<f64>,
    /// From the eyes to the plane that seems to lie in the screen, world units; default: to the volume's middle.
    #[arg(long, value_name = "LENGTH", requires = "stereo", help_heading = "Stereo")]
    screen_distance: Option<f64>,
}

/// Both pictures as one, or each for itself.
#[derive(Clone, Copy)]
struct How(Option<StereoLayout>);

impl StereoFlags {
    /// Both lengths, checked.
    fn lengths(&self) -> Result<[Option<f64>; 2]> {
        let length = |flag: &str, given: Option<f64>| match given {
            Some(length) if !(length > 0.0 && length.is_finite()) => {
                Err(Error::arguments(format!("--{flag}: must be a length above 0, got {length}")))
            }
            given => Ok(given),
        };
        Ok([
            length("eye-separation", self.eye_separation)?,
            length("screen-distance", self.screen_distance)?,
        ])
    }

    /// Puts two eyes in the place of every view of the scene. Says how their pictures are joined, if they are.
    pub fn apply(&self, data: &mut SceneData) -> Result<Option<StereoLayout>> {
        let Some(How(layout)) = self.stereo else { return Ok(None) };
        let [separation, distance] = self.lengths()?;
        let middle = data.middle_world(0);
        let size = data.scene.picture.size;
        let mut eyes = Vec::new();
        for view in &data.scene.views {
            let stereo = Stereo::or_comfortable(separation, distance, view.distance_to(middle));
            let pair = stereo.eyes(view, size);
            eyes.extend(pair.ok_or_else(|| no_eyes(view))?);
        }
        data.scene.views = eyes;
        Ok(layout)
    }

    /// The screens of a window, if it is to show two eyes; `pair` is a window for each.
    #[cfg(feature = "viewer")]
    pub fn screens(&self, first: &View) -> Result<Option<Screens>> {
        let Some(How(layout)) = self.stereo else { return Ok(None) };
        let [separation, distance] = self.lengths()?;
        if first.bounds_at_1([1; 2]).is_none() {
            return Err(no_eyes(first));
        }
        let layout = layout.map_or(EyesLayout::TwoWindows, EyesLayout::Joined);
        Ok(Some(Screens::Eyes { layout, separation, distance }))
    }
}

fn no_eyes(view: &View) -> Error {
    Error::arguments(format!(
        "--stereo: view \"{}\" has parallel rays, and no eye: give it fov_degrees",
        view.name
    ))
}

fn how(text: &str) -> std::result::Result<How, String> {
    match text {
        "side-by-side" => Ok(How(Some(StereoLayout::SideBySide))),
        "top-bottom" => Ok(How(Some(StereoLayout::TopBottom))),
        "anaglyph" => Ok(How(Some(StereoLayout::Anaglyph))),
        "pair" => Ok(How(None)),
        _ => Err("expected side-by-side, top-bottom, anaglyph or pair".to_owned()),
    }
}
