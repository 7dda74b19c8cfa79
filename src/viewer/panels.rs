//! The panels beside the picture: channels, quality, and what the machine does.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use egui::{Color32, Context, DragValue, RichText, Slider, Ui};

use crate::error::Result;
use crate::scene::{Channel, ColorMap, Filter, Integrator, Scene, TransferFunction, TransferPoint};
use crate::viewer::{Camera, Shown};

/// See the module.
pub struct Panels {
    /// As it was opened.
    original: Scene,
    /// What the panels say now.
    scene: Scene,
    /// Channels that are not shown.
    hidden: Vec<bool>,
    changed: bool,
    open: bool,
    /// Milliseconds of the last rounds, the newest last.
    rounds_ms: VecDeque<f64>,
    /// The picture that the last of them is of.
    number: u64,
    /// Where the scene is saved to.
    save_as: String,
    saves: bool,
    /// What came of the last saving.
    saved: Option<Result<()>>,
}

/// Told from green and blue in every common kind of colour blindness.
const WARNS: Color32 = Color32::from_rgb(255, 160, 60);
/// Rounds that the graph shows.
const ROUNDS_SHOWN: usize = 120;
/// Of all panels, points.
pub const WIDTH: f32 = 290.0;

impl Panels {
    pub fn new(scene: &Scene, save_as: &Path) -> Panels {
        Panels {
            original: scene.clone(),
            scene: scene.clone(),
            hidden: vec![false; scene.volumes[0].channels.len()],
            changed: false,
            open: true,
            rounds_ms: VecDeque::new(),
            number: 0,
            save_as: save_as.to_string_lossy().into_owned(),
            saves: false,
            saved: None,
        }
    }

    /// Where the scene is to be saved to now, if it is.
    pub fn take_save(&mut self) -> Option<PathBuf> {
        std::mem::take(&mut self.saves).then(|| PathBuf::from(&self.save_as))
    }

    /// What came of it.
    pub fn tell_saved(&mut self, saved: Result<()>) {
        self.saved = Some(saved);
    }

    /// Writes into `scene` what the panels say, where it has changed since the last time; whether it has.
    pub fn take_changed(&mut self, scene: &mut Scene) -> bool {
        if !std::mem::take(&mut self.changed) {
            return false;
        }
        *scene = self.scene.clone();
        let channels = &mut scene.volumes[0].channels;
        for (channel, _) in channels.iter_mut().zip(&self.hidden).filter(|(_, hidden)| **hidden) {
            channel.transfer = with_extinction(&channel.transfer, |_| 0.0);
        }
        true
    }

    pub fn show(&mut self, context: &Context, shown: &Shown, camera: &Camera) {
        if shown.number != self.number && !shown.converged {
            self.number = shown.number;
            self.rounds_ms.push_back(shown.round_ms);
            if self.rounds_ms.len() > ROUNDS_SHOWN {
                self.rounds_ms.pop_front();
            }
        }
        let pressed = |key| context.input(|input| input.key_pressed(key));
        if pressed(egui::Key::Tab) {
            self.open = !self.open;
        }
        if pressed(egui::Key::S) && context.input(|input| input.modifiers.command) {
            self.saves = true;
        }
        egui::SidePanel::right("panels").exact_width(WIDTH).resizable(false).show_animated(
            context,
            self.open,
            |ui| {
                egui::ScrollArea::vertical().show(ui, |ui| {
                    if let Some(why) = &shown.error {
                        ui.colored_label(WARNS, why.to_string());
                        ui.separator();
                    }
                    section(ui, "Channels", true, |ui| self.channels(ui));
                    section(ui, "Quality", true, |ui| self.quality(ui));
                    section(ui, "Time and bricks", true, |ui| self.machine(ui, shown));
                    section(ui, "Scene", false, |ui| {
                        of_camera(ui, camera);
                        self.saving(ui);
                    });
                    section(ui, "Help", false, help);
                });
            },
        );
    }

    fn channels(&mut self, ui: &mut Ui) {
        let volume = &mut self.scene.volumes[0];
        let originals = &self.original.volumes[0].channels;
        for (at, (channel, original)) in volume.channels.iter_mut().zip(originals).enumerate() {
            ui.push_id(at, |ui| {
                ui.horizontal(|ui| {
                    let mut visible = !self.hidden[at];
                    let name = format!("channel {}", channel.index);
                    if ui.checkbox(&mut visible, RichText::new(name).strong()).changed() {
                        self.hidden[at] = !visible;
                        self.changed = true;
                    }
                    if ui.small_button("reset").clicked() {
                        *channel = original.clone();
                        self.hidden[at] = false;
                        self.changed = true;
                    }
                    ui.menu_button("colours", |ui| {
                        for map in ColorMap::ALL {
                            if ui.button(map.name()).clicked() {
                                channel.transfer = map.over(&channel.transfer);
                                self.changed = true;
                                ui.close_menu();
                            }
                        }
                    });
                });
                self.changed |= window(ui, channel, original);
                self.changed |= transfer(ui, channel);
                ui.add_space(6.0);
            });
        }
    }

    fn quality(&mut self, ui: &mut Ui) {
        let quality = &mut self.scene.quality;
        egui::ComboBox::from_label("integrator").selected_text(quality.integrator.name()).show_ui(
            ui,
            |ui| {
                for integrator in Integrator::ALL.iter().filter(|of| !of.has_tolerance()) {
                    let value = &mut quality.integrator;
                    let picked = ui.selectable_value(value, *integrator, integrator.name());
                    self.changed |= picked.changed();
                }
            },
        );
        let step =
            Slider::new(&mut quality.step, 0.05..=4.0).logarithmic(true).text("step, voxels");
        self.changed |= ui.add(step).changed();
        let stop = Slider::new(&mut quality.early_stop, 0.0..=0.1)
            .logarithmic(true)
            .smallest_positive(1e-5)
            .text("early stop");
        self.changed |= ui.add(stop).changed();
        let mut exact = quality.filter == Filter::Exact;
        if ui.checkbox(&mut exact, "exact filter").changed() {
            quality.filter = if exact { Filter::Exact } else { Filter::Hardware };
            self.changed = true;
        }
        if ui.small_button("reset").clicked() {
            self.scene.quality = self.original.quality.clone();
            self.changed = true;
        }
    }

    fn saving(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            self.saves |= ui.button("save").clicked();
            ui.add(egui::TextEdit::singleline(&mut self.save_as).desired_width(200.0));
        });
        match &self.saved {
            Some(Ok(())) => _ = ui.label("saved"),
            Some(Err(why)) => _ = ui.colored_label(WARNS, why.to_string()),
            None => {}
        }
    }

    fn machine(&self, ui: &mut Ui, shown: &Shown) {
        let state = if shown.converged { "converged" } else { "drawing" };
        ui.label(format!("{state}, {} bricks copied for this scene", shown.bricks_uploaded));
        let mut sorted: Vec<f64> = self.rounds_ms.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        if let (Some(last), Some(worst)) = (self.rounds_ms.back(), sorted.last()) {
            let p95 = sorted[(sorted.len() - 1) * 95 / 100];
            ui.label(format!("round {last:.0} ms, p95 {p95:.0} ms, worst {worst:.0} ms"));
            graph(ui, &self.rounds_ms, *worst);
        }
        let Some(statistics) = &shown.statistics else { return };
        ui.label(format!(
            "last finished: {} rounds, {:.0} ms, {} M samples",
            statistics.rounds,
            statistics.wall_ms,
            statistics.samples / 1_000_000
        ));
        ui.label(format!("device memory {} MiB", statistics.device_bytes >> 20));
        if statistics.bricks_failed > 0 {
            let why = statistics.first_failure.clone().unwrap_or_default();
            let failed = format!("{} bricks failed, the first: {why}", statistics.bricks_failed);
            ui.colored_label(WARNS, failed);
        }
        if let Some(unfinished) = &statistics.unfinished {
            ui.colored_label(WARNS, unfinished.to_string());
        }
        let on_device: f64 = statistics.gpu_ms.iter().map(|time| time.ms).sum();
        ui.label(format!("of that by the device's clock {on_device:.0} ms:"));
        egui::Grid::new("passes").striped(true).show(ui, |ui| {
            for time in &statistics.gpu_ms {
                ui.label(&time.pass);
                ui.label(format!("{:.1} ms", time.ms));
                ui.end_row();
            }
        });
    }
}

fn section(ui: &mut Ui, title: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).heading()).default_open(open).show(ui, add);
    ui.add_space(4.0);
}

/// The window of a channel, within twice what it was opened with.
fn window(ui: &mut Ui, channel: &mut Channel, original: &Channel) -> bool {
    let [lo, hi] = original.window;
    let speed = (hi - lo) / 500.0;
    let [low, high] = &mut channel.window;
    let mut changed = false;
    ui.horizontal(|ui| {
        ui.label("window");
        let least = (*high - *low).abs().max(speed) * 1e-3;
        changed |= ui
            .add(DragValue::new(low).speed(speed).clamp_range(f64::MIN..=*high - least))
            .changed();
        changed |= ui
            .add(DragValue::new(high).speed(speed).clamp_range(*low + least..=f64::MAX))
            .changed();
    });
    changed
}

/// Points of the transfer function: where, colour, extinction.
fn transfer(ui: &mut Ui, channel: &mut Channel) -> bool {
    let mut points: Vec<TransferPoint> = channel.transfer.points().to_vec();
    let mut changed = false;
    for at in 0..points.len() {
        let (before, after) = (
            at.checked_sub(1).map_or(0.0, |at| points[at].at),
            points.get(at + 1).map_or(1.0, |point| point.at),
        );
        let point = &mut points[at];
        ui.horizontal(|ui| {
            let place = DragValue::new(&mut point.at).speed(0.005).clamp_range(before..=after);
            changed |= ui.add(place.max_decimals(3)).changed();
            let mut color = point.color.map(|part| part as f32);
            if ui.color_edit_button_rgb(&mut color).changed() {
                point.color = color.map(f64::from);
                changed = true;
            }
            let speed = 0.02 * point.extinction.max(0.01);
            let extinction = DragValue::new(&mut point.extinction).speed(speed);
            changed |= ui.add(extinction.clamp_range(0.0..=f64::from(f32::MAX))).changed();
            ui.label("extinction");
        });
    }
    if changed && let Ok(transfer) = TransferFunction::new(points) {
        channel.transfer = transfer;
        return true;
    }
    false
}

fn with_extinction(of: &TransferFunction, extinction: impl Fn(f64) -> f64) -> TransferFunction {
    let points = of.points().iter();
    let points =
        points.map(|point| TransferPoint { extinction: extinction(point.extinction), ..*point });
    TransferFunction::new(points.collect()).unwrap_or_else(|_| of.clone())
}

/// A column for each round, the newest on the right.
fn graph(ui: &mut Ui, rounds_ms: &VecDeque<f64>, worst: f64) {
    let (response, painter) =
        ui.allocate_painter(egui::vec2(WIDTH - 30.0, 60.0), egui::Sense::hover());
    let area = response.rect;
    painter.rect_filled(area, 2.0, Color32::from_gray(20));
    let width = area.width() / ROUNDS_SHOWN as f32;
    for (at, ms) in rounds_ms.iter().rev().enumerate() {
        let right = area.right() - at as f32 * width;
        let top = area.bottom() - area.height() * (ms / worst.max(1e-3)) as f32;
        let column = egui::Rect::from_min_max(
            egui::pos2(right - width * 0.8, top),
            egui::pos2(right, area.bottom()),
        );
        painter.rect_filled(column, 0.0, Color32::from_rgb(90, 170, 230));
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

fn help(ui: &mut Ui) {
    egui::Grid::new("help").striped(true).show(ui, |ui| {
        for (input, what) in [
            ("drag", "turn around the middle"),
            ("right drag, Shift + drag", "move along the picture"),
            ("Ctrl + drag", "look around"),
            ("wheel, + and -", "nearer, farther"),
            ("W A S D, E Q", "fly"),
            ("arrows", "turn"),
            ("1 to 6", "front, back, left, right, top, bottom"),
            ("Home, R", "back to the beginning"),
            ("Tab", "panels away, and back"),
            ("Ctrl + S", "save the scene as it is seen"),
            ("Ctrl + Q", "close"),
        ] {
            ui.label(input);
            ui.label(what);
            ui.end_row();
        }
    });
}
