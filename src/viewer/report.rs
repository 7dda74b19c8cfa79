//! What a window did, for whoever measures it.

use serde::Serialize;

/// As `ashfall view --report` writes it when the window closes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Milliseconds from the window's making to its first picture of the volume.
    pub first_picture_ms: Option<f64>,
    /// Frames that were painted into the window.
    pub frames: u64,
    /// What they took, milliseconds, from the turn at the queue to its end: the middle one, the 95th and the 99th of
    /// 100, and the worst, of the last 10,000.
    pub frame_ms: [f32; 4],
    /// What a round of drawing may take while something moves.
    pub frame_target_ms: f64,
    /// What such rounds took, as `frame_ms`.
    pub moving_ms: [f32; 4],
    /// The part of them that took longer.
    pub moving_over_target: f64,
    /// Of them, those with a new picture of the volume.
    pub pictures: u64,
    /// Scenes that were asked for: what moved or was set.
    pub scenes: u64,
    /// Size of the last picture in the window, pixels.
    pub picture_size: [u32; 2],
    /// Where it lies in the window, pixels from the left and the top.
    pub picture_origin: [u32; 2],
    /// The camera at the end, as a scene's view has it.
    pub eye: [f64; 3],
    /// What it turned around.
    pub target: [f64; 3],
    /// Upwards in the picture.
    pub up: [f64; 3],
    /// Peak signal to noise ratio of the last picture against the reference, dB, as far as it was compared; the
    /// greatest number where they are equal.
    pub error_db: Option<f64>,
    /// Whether the last scene's picture was finished.
    pub converged: bool,
    /// Seconds between the last painted frame and the end.
    pub idle_s: f64,
    /// Submits of all queues in those seconds.
    pub idle_submits: u64,
    /// Times between an input and the first picture that follows it.
    pub input_ms: Vec<f64>,
    /// Messages of the validation layers.
    pub validation_messages: u64,
}

/// The middle one of some milliseconds, the 95th and the 99th of 100, and the worst; 0 where there are none.
pub fn percentiles(ms: impl Iterator<Item = f32>) -> [f32; 4] {
    let mut sorted: Vec<f32> = ms.collect();
    sorted.sort_by(f32::total_cmp);
    let last = sorted.len().saturating_sub(1);
    [50, 95, 99, 100].map(|part| sorted.get(last * part / 100).copied().unwrap_or(0.0))
}
