//! The windows beside the first: the right eye's, or a wall's screens. Each shows one picture and takes a hand's
//! input as the first does.

use std::sync::{Arc, Mutex};

use egui::{Context, TextureId, ViewportBuilder, ViewportId};
use egui_ash::ImageRegistry;
use egui_ash::raw_window_handle::{HasRawDisplayHandle, HasRawWindowHandle};

use crate::error::Result;
use crate::gpu::{WindowSurface, Windows};
use crate::viewer::painting::Work;
use crate::viewer::screens::{Screens, SideWindow};
use crate::viewer::steering::{pressed, steer};
use crate::viewer::window::{SETTLING_FRAMES, lock};
use crate::viewer::{Camera, Shown};

/// One of them.
pub struct Side {
    /// egui's name of it.
    pub id: ViewportId,
    window: SideWindow,
    hand: Arc<Mutex<Hand>>,
    /// Once the window is there.
    pub surface: Option<Arc<Mutex<WindowSurface>>>,
    /// What its next frame is to do.
    pub work: Arc<Mutex<Work>>,
    /// The picture that it shows or will show with the next frame.
    number: u64,
}

/// What its thread of the user interface shares with the first window's.
struct Hand {
    texture: Option<TextureId>,
    camera: Camera,
    moved: bool,
    /// It may not be steered now.
    held: bool,
    closes: bool,
    settling: u32,
    /// Pixels of the window.
    size: [u32; 2],
}

impl Side {
    /// Those that `screens` need beside a first window with a picture of `size`.
    pub fn all(screens: &Screens, size: [u32; 2], camera: &Camera) -> Vec<Side> {
        let side = |(index, window)| Side {
            id: ViewportId::from_hash_of(("side", index)),
            window,
            hand: Arc::new(Mutex::new(Hand {
                texture: None,
                camera: camera.clone(),
                moved: false,
                held: false,
                closes: false,
                settling: SETTLING_FRAMES,
                size: [0; 2],
            })),
            surface: None,
            work: Arc::default(),
            number: 0,
        };
        screens.windows(size).into_iter().enumerate().map(side).collect()
    }

    /// The window has been made.
    ///
    /// # Errors
    /// Exit code 4 when the device cannot present to it.
    pub fn made(
        &mut self,
        windows: &Arc<Windows>,
        window: &(impl HasRawDisplayHandle + HasRawWindowHandle),
        registry: ImageRegistry,
    ) -> Result<()> {
        let surface = WindowSurface::new(windows, window, registry)?;
        self.surface = Some(Arc::new(Mutex::new(surface)));
        Ok(())
    }

    /// Something happened to it: it is painted again.
    pub fn settle(&self) {
        lock(&self.hand).settling = SETTLING_FRAMES;
    }

    /// Whether the next frame is to be painted.
    pub fn paints(&self) -> bool {
        let mut hand = lock(&self.hand);
        let paints = hand.settling > 0;
        hand.settling = hand.settling.saturating_sub(1);
        paints
    }

    /// Keeps the window open and its picture up to date; gives the camera where a hand has moved it there.
    /// `index`: among the others of `shown`. The first window's frame must be under way.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory.
    pub fn show(
        &mut self,
        context: &Context,
        (shown, index): (&Shown, usize),
        camera: &Camera,
        held: bool,
    ) -> Result<SideDid> {
        if let (Some(surface), Some(picture)) = (&self.surface, shown.others.get(index))
            && shown.number != self.number
        {
            self.number = shown.number;
            let smooth = lock(&self.hand).size != picture.size;
            let texture = lock(surface).texture(picture.size, smooth)?;
            lock(&self.work).picture = Some(picture.bytes.clone());
            let mut hand = lock(&self.hand);
            hand.texture = Some(texture);
            hand.settling = SETTLING_FRAMES;
        }
        let mut hand = lock(&self.hand);
        hand.held = held;
        let moved = std::mem::take(&mut hand.moved);
        let did = SideDid { camera: moved.then(|| hand.camera.clone()), closes: hand.closes };
        if !moved {
            hand.camera = camera.clone();
        }
        drop(hand);
        // egui counts in points, of which panels' scale makes other pixels.
        let per_point = context.pixels_per_point();
        let [width, height] = self.window.size.map(|edge| edge as f32 / per_point);
        let mut builder = ViewportBuilder::default()
            .with_title(self.window.title.clone())
            .with_inner_size([width, height]);
        if let Some([x, y]) = self.window.place {
            builder = builder
                .with_position([x, y].map(|edge| edge as f32 / per_point))
                .with_decorations(false);
        }
        let hand = self.hand.clone();
        context.show_viewport_deferred(self.id, builder, move |context, _| {
            lock(&hand).picture(context);
        });
        Ok(did)
    }
}

/// What hands did to a window since the last time.
pub struct SideDid {
    /// Where they moved the camera.
    pub camera: Option<Camera>,
    /// They closed it.
    pub closes: bool,
}

impl Hand {
    fn picture(&mut self, context: &Context) {
        let (happens, closes) =
            context.input(|input| (!input.events.is_empty(), input.viewport().close_requested()));
        let closes = closes || pressed(context).contains(&(egui::Key::Q, true));
        if happens {
            self.settling = SETTLING_FRAMES;
        }
        self.closes |= closes;
        let frame = egui::Frame::none().fill(egui::Color32::BLACK);
        egui::CentralPanel::default().frame(frame).show(context, |ui| {
            let area = ui.available_rect_before_wrap();
            let pixels = area.size() * context.pixels_per_point();
            self.size = [pixels.x, pixels.y].map(|edge| edge.round() as u32);
            let response = ui.allocate_rect(area, egui::Sense::click_and_drag());
            if !self.held {
                self.moved |= steer(context, &response, &mut self.camera, area.height());
            }
            if let Some(texture) = self.texture {
                let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                ui.painter().image(texture, area, whole, egui::Color32::WHITE);
            }
        });
    }
}
