//! Progress on stderr: a bar with rate and time left where somebody watches, else nothing.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A bar of bytes done of bytes in all; silent where nobody watches.
pub fn bytes(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {bytes} of {total_bytes}, {binary_bytes_per_sec}, {eta} left")
}

/// A bar of bricks done of bricks in all; silent where nobody watches.
pub fn bricks(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {pos} of {len} bricks, {per_sec}, {eta} left")
}

/// A bar of settings measured of settings in all; silent where nobody watches.
pub fn settings(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {pos} of {len} settings, {per_sec}, {eta} left")
}

/// A bar of cases drawn of cases in all; silent where nobody watches.
pub fn cases(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {pos} of {len} cases, {elapsed}, {eta} left")
}

/// A bar of parts done; silent where nobody watches.
pub fn parts(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {percent}% in {elapsed}, {eta} left")
}

fn bar(what: &str, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(0).with_message(what.to_owned());
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Steps of the bar; progress is told as a part of 1.
const STEPS: u64 = 1000;

/// A bar that is gone when dropped.
pub struct Progress(ProgressBar);

impl Progress {
    /// Starts a bar named `what`.
    pub fn start(what: &str) -> Progress {
        let bar = bar(what, "{msg} {wide_bar} {percent}% in {elapsed}, {eta} left");
        bar.set_length(STEPS);
        bar.enable_steady_tick(Duration::from_millis(200));
        Progress(bar)
    }

    /// Tells what is done now.
    pub fn name(&self, what: &str) {
        self.0.set_message(what.to_owned());
    }

    /// Tells the finished part, 0 to 1.
    pub fn set(&self, part: f64) {
        self.0.set_position((part * STEPS as f64) as u64);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
