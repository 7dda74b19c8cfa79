//! The pictures that follow what is wanted: a thread draws, round by round, and takes up what changed between
//! two rounds. When they have converged and nothing is wanted, it sleeps.
//!
//! Of several views each gets one round first, so that all of them show the same moment; then each is refined.

use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::{RoundCache, RoundPace, RoundPicture, Rung};
use crate::render::{
    Picture, Plan, Renderer, SceneChange, SceneData, Settings, Statistics, srgb_bytes,
};
use crate::scene::Scene;
use crate::trace::{Counter, Trace, TraceOptions};
use crate::viewer::screens::Screens;

/// See the module.
pub struct Live {
    shared: Arc<Shared>,
    trace: Arc<Trace>,
    thread: Option<JoinHandle<()>>,
}

/// A scene that is wanted, and what its views are put together as.
#[derive(Clone)]
pub struct Wanted {
    /// With a view for each picture.
    pub scene: Scene,
    /// What they are pictures of.
    pub screens: Screens,
    /// How coarse: its pixels and steps are so many times as wide and long as those at rest.
    pub rung: Rung,
}

/// The picture of a window beside the first.
#[derive(Clone, Debug)]
pub struct SidePicture {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// As the window shows them, [`srgb_bytes`].
    pub bytes: Arc<Vec<u8>>,
}

/// What was drawn last.
#[derive(Clone, Default)]
pub struct Shown {
    /// Of the first window. Whole, but coarse where bricks are missing.
    pub picture: Option<Arc<Picture>>,
    /// The same as a window shows it, [`srgb_bytes`].
    pub bytes: Arc<Vec<u8>>,
    /// Of the other windows.
    pub others: Vec<SidePicture>,
    /// Counts pictures.
    pub number: u64,
    /// Number of the scene that it shows, as [`Live::want`] gave it.
    pub scene: u64,
    /// How coarse it is.
    pub rung: Rung,
    /// How rounds keep to their target, where they have one.
    pub pace: Option<RoundPace>,
    /// It is the finished picture of that scene.
    pub converged: bool,
    /// Milliseconds that its last round took on the wall.
    pub round_ms: f64,
    /// Bricks copied for the view so far.
    pub bricks_uploaded: u64,
    /// How the cache stood after the last round.
    pub cache: Arc<RoundCache>,
    /// Of the last finished picture; of several views, the last of them.
    pub statistics: Option<Arc<Statistics>>,
    /// What finished pictures of the scene lack, in sentences.
    pub lacks: Vec<String>,
    /// Why nothing more is drawn.
    pub error: Option<Error>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    wanted: Option<(Wanted, u64)>,
    wanted_count: u64,
    shown: Shown,
    ends: bool,
}

/// What a thread draws with.
struct Drawer {
    gpu: Arc<Gpu>,
    compiler: ShaderCompiler,
    data: SceneData,
    settings: Settings,
    shared: Arc<Shared>,
    trace: Arc<Trace>,
}

/// Events of the flight recorder: some hundred rounds, 10 MiB.
const EVENTS_KEPT: usize = 100_000;

impl Live {
    /// Begins with a thread that waits for a scene. `data` says of which volume; scenes of it that have as
    /// many channels are taken up while it draws.
    ///
    /// # Errors
    /// Exit code 4 when the system has no thread left.
    pub fn new(
        gpu: &Arc<Gpu>,
        compiler: ShaderCompiler,
        data: SceneData,
        settings: Settings,
    ) -> Result<Live> {
        let shared = Arc::<Shared>::default();
        let options =
            TraceOptions { events_max: EVENTS_KEPT, keep_latest: true, ..TraceOptions::default() };
        let trace = Trace::new(gpu, options);
        let drawer = Drawer {
            gpu: gpu.clone(),
            compiler,
            data,
            settings,
            shared: shared.clone(),
            trace: trace.clone(),
        };
        let thread = std::thread::Builder::new()
            .name("draw".to_owned())
            .spawn(move || drawer.run())
            .map_err(|why| Error::machine(format!("no thread for drawing: {why}")))?;
        Ok(Live { shared, trace, thread: Some(thread) })
    }

    /// Wants another scene, of one picture, from now on, and gives its number. Of several that nobody has drawn
    /// yet the last counts.
    pub fn want(&self, scene: Scene) -> u64 {
        self.want_on(Wanted { scene, screens: Screens::One, rung: Rung::FINEST })
    }

    /// As [`Live::want`], on several screens.
    pub fn want_on(&self, wanted: Wanted) -> u64 {
        let mut state = self.shared.lock();
        state.wanted_count += 1;
        let number = state.wanted_count;
        state.wanted = Some((wanted, number));
        state.shown.error = None;
        self.shared.changed.notify_all();
        number
    }

    /// What was drawn last.
    pub fn shown(&self) -> Shown {
        self.shared.lock().shown.clone()
    }

    /// What happened lately, as far as it is kept.
    pub fn trace(&self) -> &Arc<Trace> {
        &self.trace
    }

    /// Waits until the finished picture of the scene last wanted is there, or drawing failed.
    pub fn converged(&self) -> Shown {
        let state = self.shared.lock();
        let waits = |state: &mut State| {
            let shown = &state.shown;
            shown.error.is_none() && !(shown.converged && shown.scene == state.wanted_count)
        };
        let state = self.shared.changed.wait_while(state, waits);
        state.unwrap_or_else(PoisonError::into_inner).shown.clone()
    }
}

impl Drop for Live {
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

    /// Sleeps until something is wanted; nothing: the end.
    fn next_wanted(&self) -> Option<(Wanted, u64)> {
        let state = self.lock();
        let mut state = self
            .changed
            .wait_while(state, |state| state.wanted.is_none() && !state.ends)
            .unwrap_or_else(PoisonError::into_inner);
        if state.ends { None } else { state.wanted.take() }
    }

    /// Whether what is drawn is not what is wanted any more.
    fn is_past(&self) -> bool {
        let state = self.lock();
        state.ends || state.wanted.is_some()
    }

    fn show(&self, change: impl FnOnce(&mut Shown)) {
        let mut state = self.lock();
        change(&mut state.shown);
        state.shown.number += 1;
        self.changed.notify_all();
    }
}

impl Drawer {
    fn run(self) {
        let mut next = self.shared.next_wanted();
        while let Some(wanted) = next {
            next = match self.draw_with_one_renderer(wanted) {
                Ok(next) => next,
                Err(why) => {
                    let mut state = self.shared.lock();
                    // Nobody waits for one that another has taken the place of.
                    if state.wanted.is_none() {
                        state.shown.error = Some(why);
                    }
                    drop(state);
                    self.shared.changed.notify_all();
                    // Another scene may be one that can be drawn.
                    self.shared.next_wanted()
                }
            };
        }
    }

    /// Draws what is wanted as long as one renderer can; gives what needs another one, or nothing at the end.
    fn draw_with_one_renderer(
        &self,
        (mut wanted, mut number): (Wanted, u64),
    ) -> Result<Option<(Wanted, u64)>> {
        let data = self.data.again(wanted.scene.clone())?;
        let plan = Plan::new(&self.gpu, &self.compiler, &data, &self.settings)?;
        let mut renderer = Renderer::traced(&self.gpu, plan, &data, Some(&self.trace))?;
        drop(data);
        loop {
            renderer.draw_at(wanted.rung);
            self.draw_views(&mut renderer, &wanted, number)?;
            let Some(next) = self.shared.next_wanted() else { return Ok(None) };
            renderer.begin_frame();
            let plan = renderer.plan();
            let change = self
                .data
                .again(next.0.scene.clone())
                .and_then(|data| SceneChange::new(&self.gpu, &self.compiler, plan, data));
            match change {
                Ok(change) => renderer.change(change)?,
                // Whatever is wrong with a scene itself is told when a renderer is made for it.
                Err(_) => return Ok(Some(next)),
            }
            (wanted, number) = next;
        }
    }

    /// Draws all views until they have converged, or something else is wanted.
    fn draw_views(&self, renderer: &mut Renderer, wanted: &Wanted, number: u64) -> Result<()> {
        let views = renderer.plan().views.len();
        let mut drawn = DrawnViews { pictures: vec![None; views], wanted, number, drawer: self };
        for view in 0..views - 1 {
            let begun = Instant::now();
            renderer.draw_watched(view, &mut |round| {
                drawn.take_round(view, round, begun);
                ControlFlow::Break(())
            })?;
        }
        // The last one's first round makes the set whole.
        for view in (0..views).rev() {
            let mut begun = Instant::now();
            let whole = renderer.draw_watched(view, &mut |round| {
                drawn.take_round(view, round, begun);
                begun = Instant::now();
                match self.shared.is_past() {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            })?;
            // A picture that could not be finished stays as it is, too: it says so.
            let Some((picture, statistics)) = whole else { return Ok(()) };
            drawn.finish(view, picture, statistics);
        }
        Ok(())
    }
}

/// The pictures of one scene's views as far as they have come.
struct DrawnViews<'a> {
    pictures: Vec<Option<Arc<Picture>>>,
    wanted: &'a Wanted,
    number: u64,
    drawer: &'a Drawer,
}

impl DrawnViews<'_> {
    fn take_round(&mut self, view: usize, round: RoundPicture, begun: Instant) {
        let round_ms = begun.elapsed().as_secs_f64() * 1e3;
        self.drawer.trace.count(Counter::FrameTime, (round_ms * 1e3) as u64);
        // Views are finished from the last one on.
        let is_first = round.round == 1 && view + 1 == self.pictures.len();
        self.pictures[view] = Some(Arc::new(round.picture));
        let (cache, bricks_uploaded) = (Arc::new(round.cache), round.bricks_uploaded);
        let pace = round.pace;
        self.show(|shown| {
            shown.converged = false;
            if is_first {
                shown.lacks.clear();
            }
            shown.round_ms = round_ms;
            shown.bricks_uploaded = bricks_uploaded;
            shown.cache = cache;
            shown.pace = pace;
        });
    }

    fn finish(&mut self, view: usize, picture: Picture, statistics: Statistics) {
        self.pictures[view] = Some(Arc::new(picture));
        self.show(|shown| {
            // The first view is refined last.
            shown.converged = view == 0;
            shown.lacks.extend(statistics.lacks());
            shown.statistics = Some(Arc::new(statistics));
        });
    }

    /// Once there is a picture of every view.
    fn show(&self, change: impl FnOnce(&mut Shown)) {
        let pictures: Option<Vec<Arc<Picture>>> = self.pictures.iter().cloned().collect();
        let Some(pictures) = pictures else { return };
        let (picture, others) = self.wanted.screens.of_windows(&pictures, self.wanted.rung.wider);
        let bytes = Arc::new(srgb_bytes(&picture));
        let side =
            |of: &Arc<Picture>| SidePicture { size: of.size, bytes: Arc::new(srgb_bytes(of)) };
        let others = others.iter().map(side).collect();
        self.drawer.shared.show(|shown| {
            shown.picture = Some(picture);
            shown.bytes = bytes;
            shown.others = others;
            shown.scene = self.number;
            shown.rung = self.wanted.rung;
            change(shown);
        });
    }
}
