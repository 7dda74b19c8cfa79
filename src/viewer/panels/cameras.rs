//! Cameras and files: views that are kept, the path through them, distances, and what is written.

use std::path::PathBuf;

use egui::{DragValue, TextEdit, Ui};

use crate::scene::{CameraPath, Scene, names_files};
use crate::viewer::panels::{Command, Doing, FileNames};
use crate::viewer::{Along, Camera};

/// See the module.
pub struct Cameras {
    scene: String,
    picture: String,
    name: String,
}

impl Cameras {
    pub fn new(names: &FileNames) -> Cameras {
        let text = |path: &PathBuf| path.to_string_lossy().into_owned();
        Cameras { scene: text(&names.scene), picture: text(&names.picture), name: String::new() }
    }

    pub fn save(&self) -> Command {
        Command::Save(PathBuf::from(&self.scene))
    }

    pub fn export(&self) -> Command {
        Command::Export(PathBuf::from(&self.picture))
    }

    pub fn export_path(&self) -> Command {
        Command::ExportPath(PathBuf::from(&self.picture))
    }

    /// The name that was typed, if it may be one; else one that is free.
    pub fn free_name(&self, scene: &Scene) -> String {
        if names_files(&self.name) {
            return self.name.clone();
        }
        let is_free = |name: &String| scene.views.iter().all(|view| view.name != *name);
        let mut names = (1..).map(|number| format!("kept {number}"));
        names.find(is_free).unwrap_or_default()
    }

    pub fn show(&mut self, ui: &mut Ui, scene: &mut Scene, doing: &Doing<'_>) -> Vec<Command> {
        let mut commands = Vec::new();
        self.views(ui, scene, &mut commands);
        self.path(ui, scene, doing, &mut commands);
        ui.horizontal_wrapped(|ui| {
            if ui.small_button("home").clicked() {
                commands.push(Command::Home);
            }
            for (name, along) in Along::NAMED {
                if ui.small_button(name).clicked() {
                    commands.push(Command::Look(along));
                }
            }
        });
        let mut measures = doing.measures;
        if doing.one_screen
            && ui.checkbox(&mut measures, "measure from click to click (M)").changed()
        {
            commands.push(Command::Measure(measures));
        }
        for line in doing.distances.iter().rev().take(5) {
            ui.label(line);
        }
        of_camera(ui, doing.camera);
        ui.horizontal(|ui| {
            if ui.button("save scene").clicked() {
                commands.push(self.save());
            }
            ui.add(TextEdit::singleline(&mut self.scene).desired_width(170.0));
        });
        ui.horizontal(|ui| {
            let export = ui.button("picture").on_hover_text(
                "as .png or .exr, once every brick that it needs is there; else what is missing is told",
            );
            if export.clicked() {
                commands.push(self.export());
            }
            ui.add(TextEdit::singleline(&mut self.picture).desired_width(170.0));
        });
        commands
    }

    fn views(&mut self, ui: &mut Ui, scene: &mut Scene, commands: &mut Vec<Command>) {
        let mut gone = None;
        for (index, view) in scene.views.iter().enumerate() {
            ui.horizontal(|ui| {
                if ui.small_button("go").clicked() {
                    commands.push(Command::GoTo(index));
                }
                if scene.views.len() > 1 && ui.small_button("x").clicked() {
                    gone = Some(index);
                }
                ui.label(&view.name);
            });
        }
        if let Some(index) = gone {
            let view = scene.views.remove(index);
            if let Some(path) = &mut scene.path {
                path.through.retain(|name| *name != view.name);
            }
        }
        ui.horizontal(|ui| {
            if ui.button("keep (B)").on_hover_text("this view, under this name").clicked() {
                let name = self.free_name(scene);
                commands.push(Command::Keep(name));
            }
            ui.add(TextEdit::singleline(&mut self.name).desired_width(170.0));
        });
    }

    fn path(
        &mut self,
        ui: &mut Ui,
        scene: &mut Scene,
        doing: &Doing<'_>,
        commands: &mut Vec<Command>,
    ) {
        if scene.views.len() < 2 {
            ui.weak("keep two views, and there is a path");
            return;
        }
        let mut path = scene.path.clone().unwrap_or_else(CameraPath::through_all);
        ui.horizontal(|ui| {
            ui.label("path of");
            let frames = DragValue::new(&mut path.frames).clamp_range(2..=CameraPath::FRAMES_MAX);
            let changed = ui.add(frames).changed();
            ui.label("frames");
            if ui.checkbox(&mut path.closed, "closed").changed() | changed {
                scene.path = Some(path);
            }
        });
        ui.horizontal(|ui| match doing.along {
            Some([done, of]) => {
                if ui.button("stop (P)").clicked() {
                    commands.push(Command::Stop);
                }
                ui.label(format!("{done} of {of}"));
            }
            None => {
                if ui.button("play (P)").clicked() {
                    commands.push(Command::Play);
                }
                let export = ui.button("write frames").on_hover_text(
                    "each is written when every brick that it needs is there; names are the picture's with their numbers",
                );
                if export.clicked() {
                    commands.push(self.export_path());
                }
            }
        });
    }
}

fn of_camera(ui: &mut Ui, camera: &Camera) {
    let triple = |v: glam::DVec3| format!("[{:.4}, {:.4}, {:.4}]", v.x, v.y, v.z);
    let view = camera.view();
    // As a scene has it.
    let text = format!(
        "eye = {}\ntarget = {}\nup = {}",
        triple(view.eye),
        triple(camera.pivot()),
        triple(view.up)
    );
    ui.monospace(&text);
    if ui.small_button("copy").clicked() {
        ui.output_mut(|output| output.copied_text = text);
    }
}
