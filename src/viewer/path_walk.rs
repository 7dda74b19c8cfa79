//! Going along the path: shown by the clock, or written frame by frame, each once it is finished.

use std::path::PathBuf;
use std::time::Instant;

use crate::scene::View;

/// Frames of the path that are shown in a second.
const FRAMES_PER_SECOND: f64 = 30.0;

/// See the module.
pub struct PathWalk {
    frames: Vec<View>,
    /// That is shown or drawn now.
    at: usize,
    begun: Instant,
    /// Where pictures go; nothing: they are shown alone.
    pub writes: Option<PathBuf>,
    /// What written frames lack.
    pub lacks: Vec<String>,
}

impl PathWalk {
    /// From the first frame on.
    pub fn new(frames: Vec<View>, writes: Option<PathBuf>) -> PathWalk {
        PathWalk { frames, at: 0, begun: Instant::now(), writes, lacks: Vec::new() }
    }

    /// The frame of now.
    pub fn view(&self) -> &View {
        &self.frames[self.at]
    }

    /// Frames done, and all of them.
    pub fn progress(&self) -> [usize; 2] {
        [self.at, self.frames.len()]
    }

    /// Goes to the next frame; false: there is none.
    pub fn next(&mut self) -> bool {
        self.at += 1;
        self.is_on()
    }

    /// Goes to where the clock is; false: beyond the last frame.
    pub fn by_clock(&mut self) -> bool {
        self.at = (self.begun.elapsed().as_secs_f64() * FRAMES_PER_SECOND) as usize;
        self.is_on()
    }

    fn is_on(&mut self) -> bool {
        let last = self.frames.len().saturating_sub(1);
        let is_on = self.at <= last;
        self.at = self.at.min(last);
        is_on
    }
}
