//! What the picture on the screen costs in error: single pixels of it, spread over all of it, compared with the
//! reference in the background, once the picture has converged.
//!
//! A grid of pixels in place of one tile: the same effort, and no corner of the picture counts more than another.
//! The thread also reads what the panels and the hand need of the volume ([`Overview`]).

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use crate::error::{Error, Result};
use crate::reference::Truth;
use crate::render::{Picture, SceneData};
use crate::scene::Scene;
use crate::study::error_metrics::picture_error;
use crate::viewer::overview::Overview;

/// See the module. Dropped, it ends after the pixel under way.
pub struct ErrorMeter {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What is known so far.
#[derive(Clone, Default)]
pub struct Measured {
    /// Of the volume; an error where it cannot be read.
    pub overview: Option<std::result::Result<Arc<Overview>, Error>>,
    /// Of a picture.
    pub error: Option<MeasuredError>,
    /// Why pictures are not measured.
    pub unmeasured: Option<String>,
    /// Counts changes of any of these.
    pub number: u64,
}

/// The error of one picture, as far as it was looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredError {
    /// Number of the picture, as [`crate::viewer::Shown`] counts them.
    pub picture: u64,
    /// Peak signal to noise ratio over the pixels looked at, dB; peak 1, linear rgb.
    pub psnr_db: f64,
    /// Greatest error of a component.
    pub max: f64,
    /// So many pixels.
    pub pixels: usize,
    /// Of so many.
    pub of_pixels: usize,
}

/// A picture that is to be measured: of the scene's first view.
struct Job {
    scene: Scene,
    picture: Arc<Picture>,
    number: u64,
}

#[derive(Default)]
struct State {
    job: Option<Job>,
    /// Number of the picture that is to be measured or has been.
    asked: Option<u64>,
    measured: Measured,
    ends: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

/// Pixels of the grid, across and down.
const GRID: u32 = 24;
/// The reference's own error, far below any picture's.
const TOLERANCE: f64 = 1e-7;
/// Pixels between two reports.
const REPORT_EVERY: usize = 16;

impl ErrorMeter {
    /// Begins with a thread that reads the overview of `data`'s volume, and then waits for pictures.
    ///
    /// # Errors
    /// Exit code 4 when the system has no thread left.
    pub fn new(data: SceneData) -> Result<ErrorMeter> {
        let shared = Arc::<Shared>::default();
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new()
            .name("error".to_owned())
            .spawn(move || of_thread.run(&data))
            .map_err(|why| Error::machine(format!("no thread for measuring: {why}")))?;
        Ok(ErrorMeter { shared, thread: Some(thread) })
    }

    /// Measures the picture of this number from now on, and no other: of the first view of the scene that `of` gives
    /// beside it, unless it is measured already.
    pub fn measure(&self, number: u64, of: impl FnOnce() -> (Scene, Arc<Picture>)) {
        let mut state = self.shared.lock();
        if state.asked.replace(number) != Some(number) {
            let (scene, picture) = of();
            state.job = Some(Job { scene, picture, number });
            self.shared.changed.notify_all();
        }
    }

    /// No picture is measured any more: another one is drawn.
    pub fn rest(&self) {
        let mut state = self.shared.lock();
        state.job = None;
        state.asked = None;
        state.measured.error = None;
    }

    /// What is known so far.
    pub fn measured(&self) -> Measured {
        self.shared.lock().measured.clone()
    }
}

impl Drop for ErrorMeter {
    fn drop(&mut self) {
        self.shared.lock().ends = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // Its panic was told where it happened.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(&self, change: impl FnOnce(&mut Measured)) {
        let mut state = self.lock();
        change(&mut state.measured);
        state.measured.number += 1;
    }

    fn run(&self, data: &SceneData) {
        let overview = Overview::new(&data.volumes[0]).map(Arc::new);
        self.tell(|measured| measured.overview = Some(overview));
        while let Some(job) = self.next_job() {
            let unmeasured = self.measure(data, &job).err().map(|why| why.to_string());
            self.tell(|measured| measured.unmeasured = unmeasured);
        }
    }

    fn next_job(&self) -> Option<Job> {
        let state = self.lock();
        let mut state = self
            .changed
            .wait_while(state, |state| state.job.is_none() && !state.ends)
            .unwrap_or_else(PoisonError::into_inner);
        if state.ends { None } else { state.job.take() }
    }

    /// Tells the error of a picture as far as it is known; false: nobody wants to know any more.
    fn tell_error(&self, error: MeasuredError) -> bool {
        let mut state = self.lock();
        let wanted = !state.ends && state.asked == Some(error.picture);
        if wanted && state.measured.error != Some(error) {
            state.measured.error = Some(error);
            state.measured.number += 1;
        }
        wanted
    }

    fn measure(&self, data: &SceneData, job: &Job) -> Result<()> {
        let size = job.picture.size;
        let pixels = grid(size);
        let of_pixels = pixels.len();
        let mut error = MeasuredError {
            picture: job.number,
            psnr_db: f64::INFINITY,
            max: 0.0,
            pixels: 0,
            of_pixels,
        };
        let data = data.again(job.scene.clone())?;
        let (volume, voxels) = data.volume()?;
        let (view, background) = (&data.scene.views[0], data.scene.picture.background);
        let truth = Truth::new(view, size, background, &[(volume, &voxels)], TOLERANCE);
        let (mut seen, mut should) = (Vec::new(), Vec::new());
        for [column, row] in pixels {
            if !self.tell_error(error) {
                return Ok(());
            }
            seen.push(job.picture.pixels[(row * size[0] + column) as usize]);
            should.push(truth.pixel(column, row));
            if seen.len().is_multiple_of(REPORT_EVERY) || seen.len() == of_pixels {
                let of_rgb = picture_error(&seen, &should).whole;
                error.psnr_db = of_rgb.psnr_db;
                error.max = of_rgb.max;
                error.pixels = seen.len();
            }
        }
        self.tell_error(error);
        Ok(())
    }
}

/// Pixels in the middles of equal rectangles of the picture, in an order in which any beginning is spread evenly.
fn grid([width, height]: [u32; 2]) -> Vec<[u32; 2]> {
    let [across, down] = [width.min(GRID), height.min(GRID)];
    let middle = |at: u32, of: u32, edge: u32| (2 * at + 1) * edge / (2 * of);
    let all = across * down;
    // Steps of the golden section, made coprime to the number, meet each pixel once.
    let mut step = ((f64::from(all) * 0.618_033_988_749_895) as u32).max(1);
    while greatest_common_divisor(step, all) != 1 {
        step += 1;
    }
    (0..all)
        .map(|number| (u64::from(number) * u64::from(step) % u64::from(all)) as u32)
        .map(|at| [middle(at % across, across, width), middle(at / across, down, height)])
        .collect()
}

fn greatest_common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_meets_each_of_its_pixels_once_and_evenly() {
        for size in [[1, 1], [3, 500], [640, 480], [24, 24], [2, 7]] {
            let pixels = grid(size);
            let mut distinct = pixels.clone();
            distinct.sort();
            distinct.dedup();
            assert_eq!(distinct.len(), pixels.len());
            assert_eq!(pixels.len() as u32, size[0].min(GRID) * size[1].min(GRID));
            assert!(pixels.iter().all(|[x, y]| *x < size[0] && *y < size[1]));
        }
        // Sixty-four of 576 pixels: all quarters of the picture have their share.
        let first = &grid([640, 480])[..64];
        let quarter = first.iter().filter(|[x, y]| *x < 320 && *y < 240).count();
        assert!((12..=20).contains(&quarter), "{quarter}");
    }
}
