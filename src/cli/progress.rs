//! A line on stderr with rate and time left, where someone is looking.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// Bytes done of bytes in all; silent when stderr is no terminal.
pub fn bytes(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {bytes} of {total_bytes}, {binary_bytes_per_sec}, {eta} left")
}

/// Bricks done of bricks in all; silent when stderr is no terminal.
pub fn bricks(verb: &'static str) -> ProgressBar {
    bar(verb, "{msg} {wide_bar} {pos} of {len} bricks, {per_sec}, {eta} left")
}

fn bar(verb: &'static str, template: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(template).expect("the template is ours");
    ProgressBar::new(0).with_style(style).with_message(verb)
}
