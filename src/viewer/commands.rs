//! What panels and keys ask the window to do: files, the path, kept views.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::scene::{CameraPath, Scene, View};
use crate::viewer::panels::Command;
use crate::viewer::path_walk::PathWalk;
use crate::viewer::window::{SETTLING_FRAMES, Viewer, lock};

/// The name under which a saved scene has the camera as it was.
const ON_SCREEN: &str = "screen";

impl Viewer {
    /// The scene as it is seen, and the views that were kept.
    fn saved(&self, size: [u32; 2]) -> Scene {
        let mut scene = self.panels.scene();
        scene.views.retain(|view| view.name != ON_SCREEN);
        if let Some(path) = scene.path.as_mut().filter(|path| path.through.is_empty()) {
            path.through = scene.views.iter().map(|view| view.name.clone()).collect();
        }
        let on_screen = View { name: ON_SCREEN.into(), ..self.camera.view().clone() };
        scene.views.insert(0, on_screen);
        scene.picture.size = size;
        scene
    }

    fn save(&self, path: &Path, size: [u32; 2]) -> Result<String> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let text = self.saved(size).to_toml(folder.unwrap_or(Path::new(".")));
        (self.files.text)(path, &text)?;
        Ok(format!("saved {}; its first view, \"{ON_SCREEN}\", is this one", path.display()))
    }

    /// Does what a panel asked for; whether the camera moved. `size`: of the picture, pixels.
    pub(super) fn obey(&mut self, command: Command, size: [u32; 2]) -> bool {
        let told = match command {
            Command::Save(path) => self.save(&path, size),
            Command::Trace(path) => match &self.live {
                Some(live) => (self.files.trace)(&path, live.trace())
                    .map(|()| format!("wrote {}, for Perfetto", path.display())),
                None => return false,
            },
            Command::Export(path) => {
                self.exports = Some(path);
                return false;
            }
            Command::Play => return self.go_along(None),
            Command::ExportPath(path) => return self.go_along(Some(path)),
            Command::Stop => {
                self.along = None;
                return false;
            }
            Command::Measure(on) => {
                self.distances.end();
                self.distances.on = on;
                return false;
            }
            Command::Keep(name) => {
                let view = View { name, ..self.camera.view().clone() };
                let told = format!("kept as \"{}\"", view.name);
                self.panels.keep(view);
                Ok(told)
            }
            Command::GoTo(index) => {
                let Some(view) = self.panels.scene().views.get(index).cloned() else {
                    return false;
                };
                self.camera.go_to(view, self.middle);
                return true;
            }
            Command::Home => {
                self.camera.go_home();
                return true;
            }
            Command::Look(along) => {
                self.camera.look_along(along);
                return true;
            }
        };
        self.panels.tell(told);
        self.settling = SETTLING_FRAMES;
        false
    }

    fn go_along(&mut self, writes: Option<PathBuf>) -> bool {
        let scene = self.panels.scene();
        let path = scene.path.clone().unwrap_or_else(CameraPath::through_all);
        match path.frames(&scene.views, self.middle) {
            Ok(frames) => {
                self.along = Some(PathWalk::new(frames, writes));
                true
            }
            Err(why) => {
                self.panels.tell(Err(Error::input(why)));
                false
            }
        }
    }

    /// Goes on along the path, where it is gone along; whether the camera moved.
    pub(super) fn follow_path(&mut self, context: &egui::Context) -> bool {
        let Some(mut along) = self.along.take() else { return false };
        if self.shown.error.is_some() {
            // It is told; nothing more is drawn of the path.
            return false;
        }
        context.request_repaint();
        let before = self.camera.view().clone();
        let asked = self.camera.view() == along.view();
        let goes_on = match along.writes.clone() {
            None => along.by_clock(),
            Some(path) if asked && self.is_finished() => {
                match self.write_frame(&path, &mut along) {
                    Ok(goes_on) => goes_on,
                    Err(why) => {
                        self.panels.tell(Err(why));
                        return false;
                    }
                }
            }
            // It is not there yet.
            Some(_) => true,
        };
        if goes_on || along.writes.is_none() {
            self.camera.go_to(along.view().clone(), self.middle);
        }
        if goes_on {
            self.along = Some(along);
        } else if along.writes.is_some() {
            let [_, frames] = along.progress();
            self.panels.tell(match along.lacks.first() {
                None => Ok(format!("wrote {frames} frames, each with every brick that it needs")),
                Some(first) => Err(Error::machine(format!(
                    "wrote {frames} frames; {} lack bricks, the first: {first}",
                    along.lacks.len()
                ))),
            });
        }
        *self.camera.view() != before
    }

    /// Writes the frame that is shown; whether there is another one.
    fn write_frame(&self, path: &Path, along: &mut PathWalk) -> Result<bool> {
        let name = along.view().name.clone();
        let Some(picture) = &self.shown.picture else { return Ok(true) };
        (self.files.picture)(&(self.files.of_frame)(path, &name), picture)?;
        let lacks = self.shown.lacks.first();
        along.lacks.extend(lacks.map(|what| format!("frame {name} {what}")));
        Ok(along.next())
    }

    /// Writes the picture that was asked for, where it is finished now.
    pub(super) fn export(&mut self) {
        let Some(picture) = self.shown.picture.clone().filter(|_| self.is_finished()) else {
            return;
        };
        let Some(path) = self.exports.take() else { return };
        let written = (self.files.picture)(&path, &picture);
        self.panels.tell(written.and_then(|()| match self.shown.lacks.first() {
            None => Ok(format!("wrote {}, with every brick that it needs", path.display())),
            Some(what) => Err(Error::machine(format!("wrote {}, which {what}", path.display()))),
        }));
        self.settling = SETTLING_FRAMES;
    }

    /// Of a window that ends in an error, the scene as it was is not lost.
    pub(super) fn rescue(&self) {
        let Some(why) = &mut lock(&self.outcome).error else { return };
        let size = self.wanted.as_ref().map_or([512; 2], |wanted| wanted.size);
        let mut name = self.names.scene.clone().into_os_string();
        name.push(".rescued.toml");
        let path = PathBuf::from(name);
        if self.save(&path, size).is_ok() {
            why.message =
                format!("{}; the scene as it was seen is in {}", why.message, path.display());
        }
    }
}
