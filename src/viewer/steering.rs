//! What hands do to the camera.
//!
//! | input | camera |
//! |---|---|
//! | drag | turns around the pivot |
//! | right or middle drag, Shift and drag | moves along the picture |
//! | Ctrl and drag | looks around from where it is |
//! | wheel, + and - | nearer, farther |
//! | W A S D, E Q | flies forward, left, back, right, up, down |
//! | arrows | turn around the pivot |
//! | 1 to 6 | front, back, left, right, top, bottom |
//! | Home, R | back to where it began |

use egui::{Context, Event, Key, PointerButton, Response};

use crate::viewer::{Along, Camera};

/// Radians of a drag over a picture's height.
const TURN_OF_HEIGHT: f64 = std::f64::consts::PI;
/// Nearer by a point of the wheel.
const NEARER_PER_POINT: f64 = 1.002;
/// In a second: radians, powers of e, ways to the pivot.
const PER_SECOND: f64 = 1.0;

/// Axes by key.
const ALONG: [(Key, Along); 6] = [
    (Key::Num1, Along::Front),
    (Key::Num2, Along::Back),
    (Key::Num3, Along::Left),
    (Key::Num4, Along::Right),
    (Key::Num5, Along::Top),
    (Key::Num6, Along::Bottom),
];

/// Moves the camera; says whether it moved. `height`: of the picture, in points.
pub fn steer(context: &Context, response: &Response, camera: &mut Camera, height: f32) -> bool {
    let before = camera.clone();
    let drag = response.drag_delta();
    let [right, down] = [drag.x, drag.y].map(|points| f64::from(points / height.max(1.0)));
    let modifiers = context.input(|input| input.modifiers);
    let moves = response.dragged_by(PointerButton::Secondary)
        || response.dragged_by(PointerButton::Middle)
        || (response.dragged_by(PointerButton::Primary) && modifiers.shift);
    if drag != egui::Vec2::ZERO {
        match () {
            () if moves => camera.pan(right, down),
            () if modifiers.command => camera.look(-TURN_OF_HEIGHT * right, -TURN_OF_HEIGHT * down),
            () => camera.orbit(TURN_OF_HEIGHT * right, TURN_OF_HEIGHT * down),
        }
    }
    if response.hovered() {
        let (wheel, pinch) =
            context.input(|input| (input.scroll_delta.y, f64::from(input.zoom_delta())));
        let nearer = NEARER_PER_POINT.powf(f64::from(wheel)) * pinch;
        if nearer != 1.0 {
            camera.zoom(nearer);
        }
    }
    if !context.wants_keyboard_input() {
        by_keys(context, camera);
    }
    *camera != before
}

/// Keys that were pressed since the last frame, and whether Ctrl was held as each was: a slow frame may see it let go
/// again.
pub fn pressed(context: &Context) -> Vec<(Key, bool)> {
    let key = |event: &Event| match event {
        Event::Key { key, pressed: true, repeat: false, modifiers, .. } => {
            Some((*key, modifiers.command))
        }
        _ => None,
    };
    context.input(|input| input.events.iter().filter_map(key).collect())
}

fn by_keys(context: &Context, camera: &mut Camera) {
    let pressed: Vec<Key> = pressed(context).into_iter().map(|(key, _)| key).collect();
    let (seconds, down) =
        context.input(|input| (f64::from(input.stable_dt.min(0.1)), input.keys_down.clone()));
    for (key, along) in ALONG {
        if pressed.contains(&key) {
            camera.look_along(along);
        }
    }
    if pressed.contains(&Key::Home) || pressed.contains(&Key::R) {
        camera.go_home();
    }
    let step = PER_SECOND * seconds;
    let between = |plus: Key, minus: Key| {
        step * (f64::from(down.contains(&plus)) - f64::from(down.contains(&minus)))
    };
    // Letters with Ctrl are commands.
    let commands = context.input(|input| input.modifiers.command);
    let fly = [between(Key::W, Key::S), between(Key::D, Key::A), between(Key::E, Key::Q)];
    let turn = [between(Key::ArrowRight, Key::ArrowLeft), between(Key::ArrowDown, Key::ArrowUp)];
    // Plus without Shift, on many keyboards.
    let nearer = between(Key::Plus, Key::Minus).max(between(Key::Equals, Key::Minus));
    if fly != [0.0; 3] && !commands {
        camera.fly(fly[0], fly[1], fly[2]);
    }
    if turn != [0.0; 2] {
        camera.orbit(turn[0], turn[1]);
    }
    if nearer != 0.0 {
        camera.zoom(nearer.exp());
    }
    if !down.is_empty() {
        // A key that is held goes on.
        context.request_repaint();
    }
}
