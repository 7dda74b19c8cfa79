//! The window's loop: input, panels, the newest picture, and sleep.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use egui_ash::event::{AppEvent, Event};
use egui_ash::winit::event::WindowEvent;
use egui_ash::{
    App, AppCreator, AshRenderState, CreationContext, ExitSignal, HandleRedraw, RunOption,
};

use crate::error::{Error, Result};
use crate::gpu::{EguiAllocator, Gpu, WindowSurface, Windows};
use crate::scene::Scene;
use crate::viewer::panels::{Panels, WIDTH};
use crate::viewer::steering::steer;
use crate::viewer::{Camera, Live, PICTURE_EDGE_MAX, Report, Shown};

/// What a window is opened for.
pub struct Request {
    /// Its title.
    pub title: String,
    /// The scene whose first view it begins with.
    pub scene: Scene,
    /// The middle of the volume, world: the camera turns around it.
    pub middle: glam::DVec3,
    /// Opened to present.
    pub gpu: Arc<Gpu>,
    /// Draws the scene's volume.
    pub live: Live,
    /// Where the scene is saved to, unless another file is typed.
    pub save_as: PathBuf,
    /// Pixels of its picture at first.
    pub size: [u32; 2],
}

/// Longer than this without input, and the picture is drawn at its full size.
const REST: Duration = Duration::from_millis(150);
/// A picture that takes longer is drawn smaller while something moves.
const MOVING_MS: f64 = 120.0;
/// Pixels of a smaller picture are so many times as wide, at most.
const PIXELS_WIDER_MAX: u32 = 8;
/// How long the loop sleeps when there is nothing to do: so long may input wait.
const NAP: Duration = Duration::from_millis(8);
/// egui settles what an input changed within so many frames.
const SETTLING_FRAMES: u32 = 3;

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
    let viewport = egui::ViewportBuilder::default()
        .with_title(request.title.clone())
        .with_app_id("ashfall")
        .with_inner_size([width + WIDTH, height])
        .with_min_inner_size([WIDTH + 64.0, 64.0]);
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
struct Outcome {
    report: Report,
    error: Option<Error>,
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
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
        let surface =
            WindowSurface::new(&windows, context.main_window, context.image_registry.clone());
        let surface = match surface {
            Ok(surface) => Some(Arc::new(Mutex::new(surface))),
            Err(why) => {
                lock(&self.outcome).error = Some(why);
                context.exit_signal.send(ExitCode::FAILURE);
                None
            }
        };
        close_on_signals(&context.exit_signal);
        let camera = Camera::new(request.scene.views[0].clone(), request.middle);
        let viewer = Viewer {
            live: Some(request.live),
            surface,
            work: Arc::default(),
            outcome: self.outcome.clone(),
            exit: context.exit_signal,
            panels: Panels::new(&request.scene, &request.save_as),
            scene: request.scene,
            camera,
            shown: Shown::default(),
            texture: None,
            wanted: None,
            moved: begun - REST,
            asked: None,
            settling: SETTLING_FRAMES,
            begun,
            last_paint: (begun, 0),
            gpu: request.gpu,
            windows,
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

/// What the frame under way is to do once egui has said what it draws.
#[derive(Default)]
struct Work {
    paints: bool,
    /// A picture that the window does not show yet.
    picture: Option<Arc<Vec<u8>>>,
    /// Frames painted so far.
    frames: u64,
}

struct Viewer {
    // Dropped in this order: the thread that draws, the surface, and at last the device.
    live: Option<Live>,
    surface: Option<Arc<Mutex<WindowSurface>>>,
    work: Arc<Mutex<Work>>,
    outcome: Arc<Mutex<Outcome>>,
    exit: ExitSignal,
    panels: Panels,
    scene: Scene,
    camera: Camera,
    shown: Shown,
    texture: Option<egui::TextureId>,
    wanted: Option<Wanted>,
    /// When something last moved.
    moved: Instant,
    /// An input whose picture has not come yet: the scene's number, and when.
    asked: Option<(u64, Instant)>,
    /// Frames that are painted though nothing new has come.
    settling: u32,
    begun: Instant,
    /// When, and the device's submits by then.
    last_paint: (Instant, u64),
    windows: Arc<Windows>,
    gpu: Arc<Gpu>,
}

/// The scene that was asked for last.
struct Wanted {
    number: u64,
    /// Pixels of the window's part that shows it.
    size: [u32; 2],
    /// So many of them, across, to a pixel of the picture.
    wider: u32,
}

impl Viewer {
    fn fails(&mut self, why: Error) {
        lock(&self.outcome).error.get_or_insert(why);
        self.exit.send(ExitCode::FAILURE);
    }

    /// Asks for the scene as it is now.
    fn want(&mut self, size: [u32; 2], wider: u32) {
        let Some(live) = &self.live else { return };
        let number = live.want(self.seen(size.map(|edge| edge.div_ceil(wider).max(1))));
        self.wanted = Some(Wanted { number, size, wider });
        lock(&self.outcome).report.scenes += 1;
    }

    /// The scene as the camera sees it.
    fn seen(&self, size: [u32; 2]) -> Scene {
        let mut scene = self.scene.clone();
        scene.views = vec![self.camera.view().clone()];
        scene.picture.size = size;
        scene
    }

    /// Whole under its name, or not at all.
    fn save(&self, path: &Path, size: [u32; 2]) -> Result<()> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let text = self.seen(size).to_toml(folder.unwrap_or(Path::new(".")));
        let mut partial = path.as_os_str().to_owned();
        partial.push(format!(".partial-{}", std::process::id()));
        std::fs::write(&partial, text).and_then(|()| std::fs::rename(&partial, path)).map_err(
            |why| {
                // What is left of it is of no use.
                let _ = std::fs::remove_file(&partial);
                Error::machine(format!("{}: cannot be written: {why}", path.display()))
            },
        )
    }

    /// How much wider a pixel must be so that a picture keeps to its time while something moves.
    fn wider_for(&self, size: [u32; 2]) -> u32 {
        let Some(picture) = &self.shown.picture else { return 2 };
        let pixels = |size: [u32; 2]| f64::from(size[0]) * f64::from(size[1]);
        let ms = self.shown.round_ms * pixels(size) / pixels(picture.size).max(1.0);
        let mut wider = 1;
        while wider < PIXELS_WIDER_MAX && ms / f64::from(wider * wider) > MOVING_MS {
            wider *= 2;
        }
        wider
    }

    /// The part of the window that shows the picture.
    fn picture(&mut self, context: &egui::Context, ui: &mut egui::Ui) -> Result<()> {
        let area = ui.available_rect_before_wrap();
        let per_point = context.pixels_per_point();
        let size = (area.size() * per_point).floor();
        let size = [size.x, size.y].map(|edge| (edge as u32).clamp(1, PICTURE_EDGE_MAX));
        let response = ui.allocate_rect(area, egui::Sense::click_and_drag());
        let moved = steer(context, &response, &mut self.camera, size[1] as f32 / per_point);
        let now = Instant::now();
        let resized = self.wanted.as_ref().is_none_or(|wanted| wanted.size != size);
        if moved || self.panels.take_changed(&mut self.scene) || resized {
            self.moved = now;
            let wider = self.wider_for(size);
            self.want(size, wider);
            let number = self.wanted.as_ref().map_or(0, |wanted| wanted.number);
            self.asked.get_or_insert((number, now));
        } else if self.wanted.as_ref().is_some_and(|wanted| wanted.wider > 1)
            && now - self.moved > REST
        {
            self.want(size, 1);
        }
        if let Some(path) = self.panels.take_save() {
            let saved = self.save(&path, size);
            self.panels.tell_saved(saved);
        }
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
        let at = egui::Rect::from_min_size(area.min, drawn);
        ui.painter().image(texture, at, whole, egui::Color32::WHITE);
        let mut outcome = lock(&self.outcome);
        outcome.report.picture_size = size;
        let origin = area.min.to_vec2() * per_point;
        outcome.report.picture_origin = [origin.x, origin.y].map(|edge| edge.round() as u32);
        Ok(())
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
        }
        let error_is_new = shown.error.is_some() != self.shown.error.is_some();
        self.shown = shown;
        is_new || error_is_new
    }
}

impl App for Viewer {
    fn ui(&mut self, context: &egui::Context) {
        let is_new = self.take_picture();
        let (events, quits) = context.input(|input| {
            let quits = input.modifiers.command && input.key_pressed(egui::Key::Q);
            (!input.events.is_empty(), quits)
        });
        if quits {
            self.exit.send(ExitCode::SUCCESS);
        }
        self.panels.show(context, &self.shown, &self.camera);
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
                let frames = lock(&self.work).frames;
                let mut outcome = lock(&self.outcome);
                if outcome.report.frames != frames {
                    outcome.report.frames = frames;
                    self.last_paint = (Instant::now(), self.gpu.submits());
                } else {
                    drop(outcome);
                    std::thread::sleep(NAP);
                }
            }
            Event::AppEvent { event: AppEvent::LoopExiting } => {
                {
                    let mut outcome = lock(&self.outcome);
                    let report = &mut outcome.report;
                    let (at, submits) = self.last_paint;
                    report.idle_s = at.elapsed().as_secs_f64();
                    report.idle_submits = self.gpu.submits() - submits;
                    let number = self.wanted.as_ref().map(|wanted| wanted.number);
                    report.converged = self.shown.converged && Some(self.shown.scene) == number;
                    let view = self.camera.view();
                    let target = self.camera.pivot();
                    [report.eye, report.target, report.up] =
                        [view.eye, target, view.up].map(|of| of.to_array());
                }
                // Before egui's objects go, and the window: nobody may submit any more.
                self.live = None;
                self.surface = None;
                lock(&self.outcome).report.validation_messages = self.gpu.messages().len() as u64;
            }
            // egui-ash asks for these itself, again and again.
            Event::ViewportEvent { event: WindowEvent::RedrawRequested, .. } => {}
            Event::ViewportEvent { .. } => self.settling = SETTLING_FRAMES,
            _ => {}
        }
    }

    fn request_redraw(&mut self, _viewport: egui::ViewportId) -> HandleRedraw {
        // Until the frame is painted: egui-ash copies textures and waits for the device in between.
        let turn = self.windows.turn();
        let (surface, work) = (self.surface.clone(), self.work.clone());
        let (outcome, exit) = (self.outcome.clone(), self.exit.clone());
        HandleRedraw::Handle(Box::new(move |size, egui| {
            let mut work = lock(&work);
            let Some(surface) = surface.filter(|_| work.paints) else { return };
            let picture = work.picture.take();
            let bytes = picture.as_ref().map(|bytes| &bytes[..]);
            match lock(&surface).paint([size.width, size.height], egui, bytes) {
                Ok(true) => work.frames += 1,
                // Nothing to paint into: what is new stays so.
                Ok(false) => work.picture = picture,
                Err(why) => {
                    lock(&outcome).error.get_or_insert(why);
                    exit.send(ExitCode::FAILURE);
                }
            }
            drop(turn);
        }))
    }
}
