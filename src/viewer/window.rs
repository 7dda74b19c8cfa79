//! The window's loop: input, panels, the newest picture, and sleep.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use egui_ash::event::{AppEvent, Event};
use egui_ash::winit::event::WindowEvent;
use egui_ash::{
    App, AppCreator, AshRenderState, CreationContext, ExitSignal, HandleRedraw, ImageRegistry,
    RunOption,
};

use crate::error::{Error, Result};
use crate::gpu::{EguiAllocator, Gpu, WindowSurface, Windows};
use crate::render::paging::{LADDER, Rung};
use crate::scene::Scene;
use crate::trace::Counter;
use crate::viewer::distances::Distances;
use crate::viewer::error_meter::{ErrorMeter, Measured};
use crate::viewer::painting::{FRAMES_KEPT, Work, paints};
use crate::viewer::panels::{Doing, FileNames, Panels, PanelsAtFirst, WIDTH};
use crate::viewer::path_walk::PathWalk;
use crate::viewer::report::percentiles;
use crate::viewer::request::{Files, Request};
use crate::viewer::screens::Screens;
use crate::viewer::side_windows::Side;
use crate::viewer::steering::{pressed, steer};
use crate::viewer::{Camera, Live, PICTURE_EDGE_MAX, Report, Shown, Wanted};

/// Longer than this without input, and the picture is drawn at its full size.
const REST: Duration = Duration::from_millis(150);
/// How long the loop sleeps when there is nothing to do: so long may input wait.
const NAP: Duration = Duration::from_millis(8);
/// And when there was nothing to do for a while.
const LONG_NAP: Duration = Duration::from_millis(24);
/// That is a while.
const WHILE: Duration = Duration::from_secs(2);
/// egui settles what an input changed within so many frames.
pub(super) const SETTLING_FRAMES: u32 = 3;

/// Shows the window until it is closed; says what it did.
///
/// # Errors
/// Exit code 4 when the machine has no display or the device shows no windows; those of drawing.
pub fn show(request: Request) -> Result<Report> {
    let begun = Instant::now();
    if cfg!(target_os = "linux")
        && ["DISPLAY", "WAYLAND_DISPLAY"].iter().all(|name| std::env::var_os(name).is_none())
    {
        return Err(Error::machine(
            "there is no display: neither DISPLAY nor WAYLAND_DISPLAY is set; use `ashfall render`",
        ));
    }
    let windows = Windows::new(&request.gpu)?;
    let render_state = Mutex::new(Some(windows.render_state()?));
    let [width, height] = request.size.map(|edge| edge as f32);
    let panels =
        if request.panels == PanelsAtFirst::None { 0.0 } else { WIDTH * request.panel_scale };
    let viewport = egui::ViewportBuilder::default()
        .with_title(request.title.clone())
        .with_app_id("ashfall")
        .with_inner_size([width + panels, height])
        .with_min_inner_size([panels + 64.0, 64.0]);
    let options = RunOption {
        viewport_builder: Some(viewport),
        follow_system_theme: false,
        default_theme: egui_ash::Theme::Dark,
        ..RunOption::default()
    };
    let outcome = Arc::<Mutex<Outcome>>::default();
    let creator = Creator {
        request: Mutex::new(Some((request, begun))),
        windows: Mutex::new(Some(windows)),
        render_state,
        outcome: outcome.clone(),
    };
    // The window system's own failures come as panics: they are told in the contract's words instead.
    let hook = std::panic::take_hook();
    let this = std::thread::current().id();
    std::panic::set_hook(Box::new(move |info| {
        if std::thread::current().id() != this {
            hook(info);
        }
    }));
    let ran = catch_unwind(AssertUnwindSafe(|| egui_ash::run("ashfall", creator, options)));
    drop(std::panic::take_hook());
    let mut outcome = lock(&outcome);
    match (outcome.error.take(), ran) {
        (Some(why), _) => Err(why),
        (None, Ok(_)) => Ok(std::mem::take(&mut outcome.report)),
        (None, Err(panic)) => {
            let words = panic.downcast_ref::<String>().cloned();
            let words = words.or(panic.downcast_ref::<&str>().map(|words| (*words).to_owned()));
            let words = words.unwrap_or_default();
            Err(Error::machine(format!("the window failed: {words}; `ashfall render` needs none")))
        }
    }
}

/// What the window leaves behind when it is closed.
#[derive(Default)]
pub(super) struct Outcome {
    report: Report,
    pub error: Option<Error>,
}

pub fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// egui-ash asks for the application once, and by reference.
struct Creator {
    request: Mutex<Option<(Request, Instant)>>,
    windows: Mutex<Option<Arc<Windows>>>,
    render_state: Mutex<Option<AshRenderState<EguiAllocator>>>,
    outcome: Arc<Mutex<Outcome>>,
}

impl AppCreator<EguiAllocator> for Creator {
    type App = Viewer;

    fn create(&self, context: CreationContext) -> (Viewer, AshRenderState<EguiAllocator>) {
        let request = lock(&self.request).take();
        let (windows, state) = (lock(&self.windows).take(), lock(&self.render_state).take());
        let (Some((request, begun)), Some(windows), Some(state)) = (request, windows, state) else {
            unreachable!("asked once");
        };
        let registry = context.image_registry;
        let surface = WindowSurface::new(&windows, context.main_window, registry.clone());
        let surface = match surface {
            Ok(surface) => Some(Arc::new(Mutex::new(surface))),
            Err(why) => {
                lock(&self.outcome).error = Some(why);
                context.exit_signal.send(ExitCode::FAILURE);
                None
            }
        };
        close_on_signals(&context.exit_signal);
        request.live.trace().count(Counter::FrameTarget, (request.frame_ms * 1e3) as u64);
        context.context.set_zoom_factor(request.panel_scale);
        let begin = request.scene.views[0].clone();
        let begin = match &request.screens {
            Screens::Wall(wall) => wall.base(&begin),
            Screens::One | Screens::Eyes { .. } => begin,
        };
        let camera = Camera::new(begin, request.middle);
        let Request { scene, levels, names, panels, .. } = &request;
        let panels = Panels::new(scene, *levels, names, *panels);
        let viewer = Viewer {
            live: Some(request.live),
            meter: Some(request.meter),
            surface,
            sides: Side::all(&request.screens, request.size, &camera),
            registry,
            work: Arc::default(),
            outcome: self.outcome.clone(),
            exit: context.exit_signal,
            panels,
            scene: request.scene,
            screens: request.screens,
            middle: request.middle,
            names: request.names,
            files: request.files,
            camera,
            along: None,
            exports: None,
            distances: Distances::default(),
            shown: Shown::default(),
            measured: Measured::default(),
            texture: None,
            wanted: None,
            moved: begun - REST,
            asked: None,
            settling: SETTLING_FRAMES,
            begun,
            last_paint: (begun, 0),
            gpu: request.gpu,
            windows,
            frame_ms: request.frame_ms,
            moving_ms: VecDeque::new(),
        };
        (viewer, state)
    }
}

/// Whoever interrupts or ends the program closes its window.
fn close_on_signals(exit: &ExitSignal) {
    let signals = [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];
    // Without them the window closes by its own means.
    let Ok(mut signals) = signal_hook::iterator::Signals::new(signals) else { return };
    let exit = exit.clone();
    let wait = move || {
        if signals.forever().next().is_some() {
            exit.send(ExitCode::SUCCESS);
        }
    };
    _ = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
}

pub(super) struct Viewer {
    // Dropped in this order: the threads, the surfaces, and at last the device.
    pub(super) live: Option<Live>,
    pub(super) meter: Option<ErrorMeter>,
    pub(super) surface: Option<Arc<Mutex<WindowSurface>>>,
    pub(super) sides: Vec<Side>,
    pub(super) registry: ImageRegistry,
    pub(super) work: Arc<Mutex<Work>>,
    pub(super) outcome: Arc<Mutex<Outcome>>,
    pub(super) exit: ExitSignal,
    pub(super) panels: Panels,
    pub(super) scene: Scene,
    pub(super) screens: Screens,
    pub(super) middle: glam::DVec3,
    pub(super) names: FileNames,
    pub(super) files: Files,
    pub(super) camera: Camera,
    pub(super) along: Option<PathWalk>,
    /// A picture that is to be written when it is finished.
    pub(super) exports: Option<PathBuf>,
    pub(super) distances: Distances,
    pub(super) shown: Shown,
    pub(super) measured: Measured,
    pub(super) texture: Option<egui::TextureId>,
    pub(super) wanted: Option<Asked>,
    /// When something last moved.
    pub(super) moved: Instant,
    /// An input whose picture has not come yet: the scene's number, and when.
    pub(super) asked: Option<(u64, Instant)>,
    /// Frames that are painted though nothing new has come.
    pub(super) settling: u32,
    pub(super) begun: Instant,
    /// When, and the device's submits by then.
    pub(super) last_paint: (Instant, u64),
    pub(super) windows: Arc<Windows>,
    pub(super) gpu: Arc<Gpu>,
    /// What a round may take while something moves.
    pub(super) frame_ms: f64,
    /// What the last rounds took while something moved, the newest first.
    pub(super) moving_ms: VecDeque<f32>,
}

/// The scene that was asked for last.
pub(super) struct Asked {
    pub number: u64,
    /// Pixels of the window's part that shows it.
    pub size: [u32; 2],
    /// So many of them, across, to a pixel of the picture.
    pub rung: Rung,
}

impl Viewer {
    fn fails(&mut self, why: Error) {
        lock(&self.outcome).error.get_or_insert(why);
        self.exit.send(ExitCode::FAILURE);
    }

    /// Asks for the scene as it is now.
    fn want(&mut self, size: [u32; 2], rung: Rung) {
        let wanted = self.seen(size, rung);
        let (Some(live), Some(meter)) = (&self.live, &self.meter) else { return };
        meter.rest();
        self.measured.error = None;
        let number = live.want_on(wanted);
        self.wanted = Some(Asked { number, size, rung });
        lock(&self.outcome).report.scenes += 1;
    }

    /// The scene as the camera sees it.
    fn seen(&self, size: [u32; 2], rung: Rung) -> Wanted {
        let (camera, distance) = (self.camera.view(), self.camera.distance());
        let (screens, views) = match self.screens.views(camera, distance, size, rung.wider) {
            Some(views) => (self.screens.clone(), views),
            // Parallel rays have no eyes: one picture of them.
            None => (Screens::One, vec![camera.clone()]),
        };
        let mut scene = self.scene.clone();
        scene.views = views;
        scene.picture.size = screens.picture_size(size, rung.wider);
        scene.quality.step *= f64::from(rung.longer);
        Wanted { scene, screens, rung }
    }

    /// How coarse a picture must be so that it keeps to its time while something moves.
    fn rung_for_moving(&self) -> Rung {
        self.shown.pace.as_ref().map_or(LADDER[2], |pace| pace.rung)
    }

    /// Whether the picture that is shown is the finished one of what was asked for, at full size.
    pub(super) fn is_finished(&self) -> bool {
        self.wanted.as_ref().is_some_and(|wanted| {
            wanted.rung == Rung::FINEST && self.shown.converged && self.shown.scene == wanted.number
        })
    }

    /// Has the error of a picture at rest measured; only of one that is one view's.
    fn measure(&mut self) {
        let Some(meter) = &self.meter else { return };
        let Some(picture) = self.shown.picture.clone().filter(|_| self.is_finished()) else {
            return;
        };
        if self.screens == Screens::One {
            let size = picture.size;
            meter.measure(self.shown.number, || (self.seen(size, Rung::FINEST).scene, picture));
        }
        let measured = meter.measured();
        if measured.number != self.measured.number {
            self.settling = SETTLING_FRAMES;
        }
        self.measured = measured;
    }

    /// The part of the window that shows the picture.
    fn picture(&mut self, context: &egui::Context, ui: &mut egui::Ui) -> Result<()> {
        let area = ui.available_rect_before_wrap();
        let per_point = context.pixels_per_point();
        let size = (area.size() * per_point).floor();
        let size = [size.x, size.y].map(|edge| (edge as u32).clamp(1, PICTURE_EDGE_MAX));
        let response = ui.allocate_rect(area, egui::Sense::click_and_drag());
        let mut moved = false;
        if self.along.is_none() {
            moved |= steer(context, &response, &mut self.camera, size[1] as f32 / per_point);
        }
        for command in self.panels.take_commands() {
            moved |= self.obey(command, size);
        }
        moved |= self.follow_path(context) | self.show_sides(context)?;
        if self.panels.take_changed() {
            self.scene = self.panels.scene();
            moved = true;
        }
        self.ask(size, moved);
        self.export();
        self.measure();
        let (Some(surface), Some(picture)) = (&self.surface, &self.shown.picture) else {
            return Ok(());
        };
        let smooth = picture.size != size;
        let texture = lock(surface).texture(picture.size, smooth)?;
        if self.texture.replace(texture) != Some(texture) {
            lock(&self.work).picture = Some(self.shown.bytes.clone());
        }
        let drawn = egui::vec2(size[0] as f32, size[1] as f32) / per_point;
        let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
        let mut at = egui::Rect::from_min_size(area.min, drawn);
        if matches!(self.screens, Screens::Wall(_)) {
            // All screens, as large as they fit.
            let [width, height] = picture.size.map(|edge| edge as f32);
            let fits = (drawn.x / width).min(drawn.y / height);
            at = egui::Rect::from_min_size(area.min, egui::vec2(width, height) * fits);
        }
        ui.painter().image(texture, at, whole, egui::Color32::WHITE);
        self.clicks(&response, ui, at, size);
        let mut outcome = lock(&self.outcome);
        outcome.report.picture_size = size;
        let origin = area.min.to_vec2() * per_point;
        outcome.report.picture_origin = [origin.x, origin.y].map(|edge| edge.round() as u32);
        Ok(())
    }

    /// Asks for another scene where something moved or the picture is not what it should be at rest.
    fn ask(&mut self, size: [u32; 2], moved: bool) {
        let now = Instant::now();
        let resized = self.wanted.as_ref().is_none_or(|wanted| wanted.size != size);
        // Frames that are written are whole at once.
        let writes = self.along.as_ref().is_some_and(|along| along.writes.is_some());
        if moved || resized {
            self.moved = now;
            let rung = if writes { Rung::FINEST } else { self.rung_for_moving() };
            self.want(size, rung);
            let number = self.wanted.as_ref().map_or(0, |wanted| wanted.number);
            self.asked.get_or_insert((number, now));
        } else if self.wanted.as_ref().is_some_and(|wanted| wanted.rung != Rung::FINEST)
            && (writes || now - self.moved > REST)
        {
            self.want(size, Rung::FINEST);
        }
    }

    /// Keeps the other windows going; whether a hand moved the camera in one of them.
    fn show_sides(&mut self, context: &egui::Context) -> Result<bool> {
        let mut moved = false;
        let held = self.along.is_some();
        for (index, side) in self.sides.iter_mut().enumerate() {
            let did = side.show(context, (&self.shown, index), &self.camera, held)?;
            if let Some(camera) = did.camera {
                self.camera = camera;
                moved = true;
            }
            if did.closes {
                self.exit.send(ExitCode::SUCCESS);
            }
        }
        Ok(moved)
    }

    /// Clicks are ends of distances, where that is on.
    fn clicks(&mut self, response: &egui::Response, ui: &egui::Ui, at: egui::Rect, size: [u32; 2]) {
        if !self.distances.on || self.screens != Screens::One {
            return;
        }
        if response.clicked()
            && let Some(Ok(overview)) = &self.measured.overview
            && let Some(pointer) = response.interact_pointer_pos()
        {
            let part = (pointer - at.min) / at.size();
            let pixel = [part.x, part.y].map(f64::from);
            let pixel = [0, 1].map(|axis: usize| {
                (pixel[axis] * f64::from(size[axis])).clamp(0.0, f64::from(size[axis] - 1)) as u32
            });
            let channels = &self.scene.volumes[0].channels;
            self.distances.take(overview.meets(channels, self.camera.view(), size, pixel));
        }
        self.distances.draw(ui.painter(), at, self.camera.view(), size);
    }

    /// Takes what was drawn since the last frame.
    fn take_picture(&mut self) -> bool {
        let Some(live) = &self.live else { return false };
        let shown = live.shown();
        let is_new = shown.number != self.shown.number;
        if is_new {
            let mut outcome = lock(&self.outcome);
            let report = &mut outcome.report;
            report.pictures += 1;
            report.first_picture_ms.get_or_insert(self.begun.elapsed().as_secs_f64() * 1e3);
            if let Some((_, asked)) = self.asked.take_if(|(number, _)| shown.scene >= *number) {
                report.input_ms.push(asked.elapsed().as_secs_f64() * 1e3);
            }
            lock(&self.work).picture = Some(shown.bytes.clone());
            if !shown.converged && self.moved.elapsed() < REST {
                self.moving_ms.truncate(FRAMES_KEPT - 1);
                self.moving_ms.push_front(shown.round_ms as f32);
            }
        }
        let error_is_new = shown.error.is_some() != self.shown.error.is_some();
        self.shown = shown;
        is_new || error_is_new
    }

    /// Writes down what the window did.
    fn report(&self) {
        let mut outcome = lock(&self.outcome);
        let report = &mut outcome.report;
        let (at, submits) = self.last_paint;
        report.idle_s = at.elapsed().as_secs_f64();
        report.idle_submits = self.gpu.submits() - submits;
        let number = self.wanted.as_ref().map(|wanted| wanted.number);
        report.converged = self.shown.converged && Some(self.shown.scene) == number;
        report.frame_ms = percentiles(lock(&self.work).frames_ms.iter().copied());
        report.frame_target_ms = self.frame_ms;
        report.moving_ms = percentiles(self.moving_ms.iter().copied());
        let over = self.moving_ms.iter().filter(|ms| f64::from(**ms) > self.frame_ms).count();
        report.moving_over_target = over as f64 / self.moving_ms.len().max(1) as f64;
        report.error_db = self.measured.error.map(|error| error.psnr_db);
        let view = self.camera.view();
        let target = self.camera.pivot();
        [report.eye, report.target, report.up] =
            [view.eye, target, view.up].map(|of| of.to_array());
    }
}

impl App for Viewer {
    fn ui(&mut self, context: &egui::Context) {
        let is_new = self.take_picture();
        let events = context.input(|input| !input.events.is_empty());
        let quits = pressed(context).contains(&(egui::Key::Q, true));
        if quits {
            self.exit.send(ExitCode::SUCCESS);
        }
        if let Some(live) = &self.live {
            let doing = Doing {
                shown: &self.shown,
                measured: &self.measured,
                camera: &self.camera,
                trace: live.trace(),
                along: self.along.as_ref().map(PathWalk::progress),
                frame_ms: self.frame_ms,
                measures: self.distances.on,
                distances: &self.distances.lines,
                one_screen: self.screens == Screens::One,
            };
            self.panels.show(context, &doing);
        }
        let frame = egui::Frame::none().fill(egui::Color32::BLACK);
        let drawn = egui::CentralPanel::default()
            .frame(frame)
            .show(context, |ui| self.picture(context, ui))
            .inner;
        if let Err(why) = drawn {
            self.fails(why);
        }
        if is_new || events || context.has_requested_repaint() {
            self.settling = SETTLING_FRAMES;
        }
        lock(&self.work).paints = self.settling > 0;
        self.settling = self.settling.saturating_sub(1);
    }

    fn handle_event(&mut self, event: Event) {
        match event {
            Event::AppEvent { event: AppEvent::AboutToWait } => {
                let of_sides = self.sides.iter().map(|side| lock(&side.work).frames);
                let frames = lock(&self.work).frames + of_sides.sum::<u64>();
                let mut outcome = lock(&self.outcome);
                if outcome.report.frames != frames {
                    outcome.report.frames = frames;
                    self.last_paint = (Instant::now(), self.gpu.submits());
                } else {
                    drop(outcome);
                    let rested = self.last_paint.0.elapsed() > WHILE;
                    std::thread::sleep(if rested { LONG_NAP } else { NAP });
                }
            }
            Event::AppEvent { event: AppEvent::LoopExiting } => {
                self.report();
                self.rescue();
                // Before egui's objects go, and the windows: nobody may submit any more.
                self.live = None;
                self.meter = None;
                self.surface = None;
                self.sides.clear();
                lock(&self.outcome).report.validation_messages = self.gpu.messages().len() as u64;
            }
            Event::DeferredViewportCreated { viewport_id, window } => {
                let side = self.sides.iter_mut().find(|side| side.id == viewport_id);
                let made = side.map(|side| side.made(&self.windows, window, self.registry.clone()));
                if let Some(Err(why)) = made {
                    self.fails(why);
                }
            }
            // egui-ash asks for these itself, again and again.
            Event::ViewportEvent { event: WindowEvent::RedrawRequested, .. } => {}
            Event::ViewportEvent { viewport_id, .. } => {
                self.settling = SETTLING_FRAMES;
                self.sides.iter().filter(|side| side.id == viewport_id).for_each(Side::settle);
            }
            _ => {}
        }
    }

    fn request_redraw(&mut self, viewport: egui::ViewportId) -> HandleRedraw {
        // Until the frame is painted: egui-ash copies textures and waits for the device in between.
        let turn = self.windows.turn();
        let (surface, work) = match self.sides.iter().find(|side| side.id == viewport) {
            None => (self.surface.clone(), self.work.clone()),
            Some(side) => {
                lock(&side.work).paints = side.paints();
                (side.surface.clone(), side.work.clone())
            }
        };
        paints(turn, (surface, work), self.outcome.clone(), self.exit.clone())
    }
}
