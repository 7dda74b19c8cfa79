//! One frame of a window: painted once egui has said what it draws.

use std::collections::VecDeque;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use egui_ash::{ExitSignal, HandleRedraw};

use crate::gpu::{Turn, WindowSurface};
use crate::viewer::window::{Outcome, lock};

/// What the frame under way is to do once egui has said what it draws.
#[derive(Default)]
pub struct Work {
    pub paints: bool,
    /// A picture that the window does not show yet.
    pub picture: Option<Arc<Vec<u8>>>,
    /// Frames painted so far.
    pub frames: u64,
    /// Milliseconds that the last of them took: egui's part, and ours.
    pub frames_ms: VecDeque<f32>,
}

/// Frames whose times are kept.
pub const FRAMES_KEPT: usize = 10_000;

/// Paints a window's next frame, if its work says so. Whoever waits for the device meanwhile has its turn.
pub fn paints(
    turn: Turn,
    (surface, work): (Option<Arc<Mutex<WindowSurface>>>, Arc<Mutex<Work>>),
    outcome: Arc<Mutex<Outcome>>,
    exit: ExitSignal,
) -> HandleRedraw {
    let begun = Instant::now();
    HandleRedraw::Handle(Box::new(move |size, egui| {
        let mut work = lock(&work);
        let Some(surface) = surface.filter(|_| work.paints) else { return };
        let picture = work.picture.take();
        let bytes = picture.as_ref().map(|bytes| &bytes[..]);
        match lock(&surface).paint([size.width, size.height], egui, bytes) {
            Ok(true) => {
                work.frames += 1;
                work.frames_ms.truncate(FRAMES_KEPT - 1);
                work.frames_ms.push_front(begun.elapsed().as_secs_f32() * 1e3);
            }
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
