//! The panels beside the picture: channels, quality, cameras, and what the machine does. They change a scene of
//! their own and leave commands; the window takes both up.

mod cameras;
mod channels;
mod curve;
mod machine;
mod quality;

use std::path::PathBuf;

use egui::{Color32, Context, Key, RichText, Ui};

use crate::error::Result;
use crate::scene::{Scene, TransferFunction, TransferPoint};
use crate::trace::Trace;
use crate::viewer::error_meter::Measured;
use crate::viewer::panels::cameras::Cameras;
use crate::viewer::panels::channels::ChannelsPanel;
use crate::viewer::panels::machine::Machine;
use crate::viewer::steering::pressed;
use crate::viewer::{Along, Camera, Shown};

/// What somebody wants the window to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Save the scene as it is seen.
    Save(PathBuf),
    /// Write the picture once it has converged.
    Export(PathBuf),
    /// Write every picture of the path.
    ExportPath(PathBuf),
    /// Go along the path and write nothing.
    Play,
    /// Write no more of them.
    Stop,
    /// Write what happened lately.
    Trace(PathBuf),
    /// Go to this view.
    GoTo(usize),
    /// Keep where the camera is, under this name.
    Keep(String),
    /// Go back to where the camera began.
    Home,
    /// Look along an axis.
    Look(Along),
    /// Measure from one click to the next, or no longer.
    Measure(bool),
}

/// What the window does, for the panels to show.
pub struct Doing<'a> {
    /// What was drawn last.
    pub shown: &'a Shown,
    /// What is known of its error and of the volume.
    pub measured: &'a Measured,
    /// Where it was drawn from.
    pub camera: &'a Camera,
    /// What happened lately.
    pub trace: &'a Trace,
    /// Milliseconds that a round may take while something moves.
    pub frame_ms: f64,
    /// Frames of the path written or shown, and all of them, while it goes along.
    pub along: Option<[usize; 2]>,
    /// Clicks are distances.
    pub measures: bool,
    /// What was measured, a line each.
    pub distances: &'a [String],
    /// The window shows one picture of one view.
    pub one_screen: bool,
}

/// See the module.
pub struct Panels {
    /// As it was opened.
    original: Scene,
    /// What the panels say now.
    scene: Scene,
    /// Channels that are not shown.
    hidden: Vec<bool>,
    changed: bool,
    /// Whether panels are there at all.
    open: bool,
    /// Whether those that begin closed begin open.
    all: bool,
    channels: ChannelsPanel,
    cameras: Cameras,
    machine: Machine,
    commands: Vec<Command>,
    /// What came of the last command.
    told: Option<std::result::Result<String, String>>,
}

/// Told from green and blue in every common kind of colour blindness.
const WARNS: Color32 = Color32::from_rgb(255, 160, 60);
/// Of all panels, points.
pub const WIDTH: f32 = 300.0;

/// Which panels are there when the window opens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PanelsAtFirst {
    /// Those that are used most.
    Some,
    /// Every one, opened.
    All,
    /// None: a key brings them.
    None,
}

/// Where files go unless another name is typed.
#[derive(Clone, Debug)]
pub struct FileNames {
    /// Of the scene as it is seen.
    pub scene: PathBuf,
    /// Of a picture, and of a path's with their numbers.
    pub picture: PathBuf,
    /// Of what happened lately.
    pub trace: PathBuf,
}

impl Panels {
    /// Of a scene whose volume has so many levels.
    pub fn new(scene: &Scene, levels: u8, names: &FileNames, at_first: PanelsAtFirst) -> Panels {
        let count = scene.volumes[0].channels.len();
        Panels {
            original: scene.clone(),
            scene: scene.clone(),
            hidden: vec![false; count],
            changed: false,
            open: at_first != PanelsAtFirst::None,
            all: at_first == PanelsAtFirst::All,
            channels: ChannelsPanel::new(count, levels),
            cameras: Cameras::new(names),
            machine: Machine::new(names),
            commands: Vec::new(),
            told: None,
        }
    }

    /// What was asked for since the last time.
    pub fn take_commands(&mut self) -> Vec<Command> {
        std::mem::take(&mut self.commands)
    }

    /// What came of a command.
    pub fn tell(&mut self, told: Result<String>) {
        self.told = Some(told.map_err(|why| why.to_string()));
    }

    /// The scene as the panels have it; its views are those that were kept.
    pub fn scene(&self) -> Scene {
        let mut scene = self.scene.clone();
        let channels = &mut scene.volumes[0].channels;
        for (channel, _) in channels.iter_mut().zip(&self.hidden).filter(|(_, hidden)| **hidden) {
            channel.transfer = without_extinction(&channel.transfer);
        }
        scene
    }

    /// Whether the picture is another one since the last time.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Keeps a view; of one name the last.
    pub fn keep(&mut self, view: crate::scene::View) {
        self.scene.views.retain(|kept| kept.name != view.name);
        self.scene.views.push(view);
    }

    pub fn show(&mut self, context: &Context, doing: &Doing<'_>) {
        self.machine.follow(doing);
        self.keys(context, doing);
        egui::SidePanel::right("panels").exact_width(WIDTH).resizable(false).show_animated(
            context,
            self.open,
            |ui| {
                egui::ScrollArea::vertical().show(ui, |ui| {
                    if let Some(why) = &doing.shown.error {
                        ui.colored_label(WARNS, why.to_string());
                        ui.separator();
                    }
                    match &self.told {
                        Some(Ok(what)) => _ = ui.label(what),
                        Some(Err(why)) => _ = ui.colored_label(WARNS, why),
                        None => {}
                    }
                    self.sections(ui, doing);
                });
            },
        );
    }

    fn sections(&mut self, ui: &mut Ui, doing: &Doing<'_>) {
        let Panels { original, scene, hidden, channels, cameras, machine, commands, all, .. } =
            self;
        let mut changed = false;
        section(ui, "Channels", true, |ui| {
            let of_volume = (&mut scene.volumes[0].channels[..], &original.volumes[0].channels[..]);
            changed |= channels.show(ui, of_volume, hidden, doing.measured);
        });
        section(ui, "Quality", true, |ui| {
            changed |= quality::show(ui, &mut scene.quality, &original.quality, doing);
        });
        section(ui, "Memory", true, |ui| machine.memory(ui, doing.shown));
        section(ui, "Time", true, |ui| commands.extend(machine.time(ui, doing)));
        section(ui, "Cameras and files", *all, |ui| {
            commands.extend(cameras.show(ui, scene, doing));
        });
        section(ui, "Help", *all, help);
        self.changed |= changed;
    }

    fn keys(&mut self, context: &Context, doing: &Doing<'_>) {
        if context.wants_keyboard_input() {
            return;
        }
        let pressed = pressed(context);
        self.open ^= pressed.iter().any(|(key, _)| *key == Key::Tab);
        let goes = doing.along.is_some();
        for (key, control) in pressed {
            self.commands.push(match (key, control) {
                (Key::S, true) => self.cameras.save(),
                (Key::E, true) => self.cameras.export(),
                (Key::T, true) => self.machine.save(),
                (Key::B, false) => Command::Keep(self.cameras.free_name(&self.scene)),
                (Key::M, false) => Command::Measure(!doing.measures),
                (Key::P, _) if goes => Command::Stop,
                (Key::P, false) => Command::Play,
                (Key::P, true) => self.cameras.export_path(),
                _ => continue,
            });
        }
    }
}

fn section(ui: &mut Ui, title: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).heading()).default_open(open).show(ui, add);
    ui.add_space(4.0);
}

fn without_extinction(of: &TransferFunction) -> TransferFunction {
    let points = of.points().iter();
    let points = points.map(|point| TransferPoint { extinction: 0.0, ..*point });
    TransferFunction::new(points.collect()).unwrap_or_else(|_| of.clone())
}

fn help(ui: &mut Ui) {
    egui::Grid::new("help").striped(true).show(ui, |ui| {
        for (input, what) in [
            ("drag", "turn around the middle"),
            ("right or Shift drag", "move along the picture"),
            ("Ctrl + drag", "look around"),
            ("wheel, + and -", "nearer, farther"),
            ("W A S D, E Q", "fly"),
            ("arrows", "turn"),
            ("1 to 6", "front, back, left, right, ..."),
            ("Home, R", "back to the beginning"),
            ("B", "keep this view"),
            ("P", "go along the path, stop"),
            ("M", "measure: two clicks"),
            ("Tab", "panels away, and back"),
            ("Ctrl + S", "save the scene as seen"),
            ("Ctrl + E", "write the picture"),
            ("Ctrl + P", "write the path's pictures"),
            ("Ctrl + T", "write a trace"),
            ("Ctrl + Q", "close"),
        ] {
            ui.label(input);
            ui.label(what);
            ui.end_row();
        }
    });
}
