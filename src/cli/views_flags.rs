//! What becomes of a scene's views before they are drawn: a path through them, the screens of a wall, two eyes.

use std::path::PathBuf;

use clap::Args;

use crate::cli::stereo_flags::StereoFlags;
use crate::error::{Error, Result};
use crate::render::{Picture, SceneData, StereoLayout};
use crate::scene::{CameraPath, Screen, Wall};

/// Which pictures are drawn of the scene's views.
#[derive(Args)]
pub struct ViewsFlags {
    /// Draw the pictures of a movie: frames along the scene's [path], or through all its views; numbered files.
    #[arg(long, help_heading = "Movie", conflicts_with = "wall")]
    path: bool,
    /// So many pictures along the path; default: as [path] says, else 120.
    #[arg(long, value_name = "N", requires = "path", help_heading = "Movie")]
    frames: Option<u32>,
    /// Draw the screens of a wall (.toml, see docs/VIEWER.md) from the first view: a picture each, named by its
    /// screen. All share the atlas: what two screens see is loaded once.
    #[arg(long, value_name = "FILE", conflicts_with = "stereo", help_heading = "Wall")]
    wall: Option<PathBuf>,
    #[command(flatten)]
    stereo: StereoFlags,
}

/// The pictures that a scene's views, as [`ViewsFlags::apply`] left them, are drawn for.
pub struct Pictures {
    /// Of the pictures, in order.
    pub names: Vec<String>,
    made_as: Become,
}

enum Become {
    /// As they are drawn.
    Pictures,
    /// Two at a time, one picture.
    Joined(StereoLayout),
    /// What each screen is given.
    Screens(Vec<Screen>),
}

impl ViewsFlags {
    /// Puts what is asked for in the place of the scene's views. `size`: as `--size` asks for it.
    ///
    /// # Errors
    /// One sentence, exit code 2 or 3.
    pub fn apply(&self, data: &mut SceneData, size: Option<[u32; 2]>) -> Result<Pictures> {
        let names =
            |data: &SceneData| data.scene.views.iter().map(|view| view.name.clone()).collect();
        if self.path {
            self.apply_path(data)?;
        }
        if let Some(file) = &self.wall {
            if size.is_some() {
                return Err(Error::arguments(
                    "--size: screens of a wall have their own: leave it out",
                ));
            }
            let wall = Wall::load(file)?;
            data.scene.views = wall.views(&wall.base(&data.scene.views[0]));
            return Ok(Pictures { names: names(data), made_as: Become::Screens(wall.screens) });
        }
        let of_pictures = names(data);
        Ok(match self.stereo.apply(data)? {
            Some(layout) => Pictures { names: of_pictures, made_as: Become::Joined(layout) },
            None => Pictures { names: names(data), made_as: Become::Pictures },
        })
    }

    fn apply_path(&self, data: &mut SceneData) -> Result<()> {
        let frames_max = CameraPath::FRAMES_MAX;
        if let Some(frames) = self.frames.filter(|frames| !(1..=frames_max).contains(frames)) {
            return Err(Error::arguments(format!(
                "--frames: must be 1 to {frames_max}, got {frames}"
            )));
        }
        let mut path = data.scene.path.clone().unwrap_or_else(CameraPath::through_all);
        path.frames = self.frames.unwrap_or(path.frames);
        let frames = path.frames(&data.scene.views, data.middle_world(0));
        data.scene.views = frames.map_err(|why| Error::input(format!("--path: {why}")))?;
        Ok(())
    }
}

impl Pictures {
    /// Views that one picture is made of.
    pub fn views_each(&self) -> usize {
        if matches!(self.made_as, Become::Joined(_)) { 2 } else { 1 }
    }

    /// Whether pictures are those of the views, pixel by pixel.
    pub fn are_plain(&self) -> bool {
        matches!(self.made_as, Become::Pictures)
    }

    /// Picture `index`, made of the view's that was drawn, or of two eyes'.
    pub fn made(&self, index: usize, drawn: Picture, right_eye: Option<&Picture>) -> Picture {
        match (&self.made_as, right_eye) {
            (Become::Joined(layout), Some(right)) => layout.joined(&drawn, right),
            (Become::Screens(screens), _) => drawn.on_screen(&screens[index]),
            _ => drawn,
        }
    }
}
