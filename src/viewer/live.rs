//! The picture that follows what is wanted: a thread draws, round by round, and takes up what changed between
//! two rounds. When it has converged and nothing is wanted, it sleeps.

use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::RoundPicture;
use crate::render::{
    Picture, Plan, Renderer, SceneChange, SceneData, Settings, Statistics, srgb_bytes,
};
use crate::scene::Scene;

/// See the module.
pub struct Live {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What was drawn last.
#[derive(Clone, Default)]
pub struct Shown {
    /// Whole, but coarse where bricks are missing.
    pub picture: Option<Arc<Picture>>,
    /// The same as a window shows it, [`srgb_bytes`].
    pub bytes: Arc<Vec<u8>>,
    /// Counts pictures.
    pub number: u64,
    /// Number of the scene that it shows, as [`Live::want`] gave it.
    pub scene: u64,
    /// It is the finished picture of that scene.
    pub converged: bool,
    /// Milliseconds that its last round took on the wall.
    pub round_ms: f64,
    /// Bricks copied for the scene so far.
    pub bricks_uploaded: u64,
    /// Of the last finished picture.
    pub statistics: Option<Arc<Statistics>>,
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
    wanted: Option<(Scene, u64)>,
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
}

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
        let drawer = Drawer { gpu: gpu.clone(), compiler, data, settings, shared: shared.clone() };
        let thread = std::thread::Builder::new()
            .name("draw".to_owned())
            .spawn(move || drawer.run())
            .map_err(|why| Error::machine(format!("no thread for drawing: {why}")))?;
        Ok(Live { shared, thread: Some(thread) })
    }

    /// Wants another scene from now on, and gives its number. Of several that nobody has drawn yet the last
    /// counts.
    pub fn want(&self, scene: Scene) -> u64 {
        let mut state = self.shared.lock();
        state.wanted_count += 1;
        let number = state.wanted_count;
        state.wanted = Some((scene, number));
        state.shown.error = None;
        self.shared.changed.notify_all();
        number
    }

    /// What was drawn last.
    pub fn shown(&self) -> Shown {
        self.shared.lock().shown.clone()
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
    fn next_wanted(&self) -> Option<(Scene, u64)> {
        let state = self.lock();
        let mut state = self
            .changed
            .wait_while(state, |state| state.wanted.is_none() && !state.ends)
            .unwrap_or_else(PoisonError::into_inner);
        if state.ends { None } else { state.wanted.take() }
    }

    fn show(&self, scene: u64, picture: Picture, change: impl FnOnce(&mut Shown)) {
        let bytes = Arc::new(srgb_bytes(&picture));
        let mut state = self.lock();
        let shown = &mut state.shown;
        shown.picture = Some(Arc::new(picture));
        shown.bytes = bytes;
        shown.number += 1;
        shown.scene = scene;
        shown.converged = false;
        change(shown);
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
        (scene, mut number): (Scene, u64),
    ) -> Result<Option<(Scene, u64)>> {
        let data = self.data.again(scene)?;
        let mut plan = Plan::new(&self.gpu, &self.compiler, &data, &self.settings)?;
        let mut renderer = Renderer::new(&self.gpu, plan.clone(), &data)?;
        drop(data);
        let next_scene = renderer.next_scene();
        loop {
            let mut needs_another = None;
            // Taken up before the next round.
            let mut left = None;
            let mut begun = Instant::now();
            let drawn = renderer.draw_watched(0, &mut |round: RoundPicture| {
                let round_ms = begun.elapsed().as_secs_f64() * 1e3;
                number = left.take().unwrap_or(number);
                self.shared.show(number, round.picture, |shown| {
                    shown.round_ms = round_ms;
                    shown.bricks_uploaded = round.bricks_uploaded;
                });
                let (wanted, ends) = {
                    let mut state = self.shared.lock();
                    (state.wanted.take(), state.ends)
                };
                if let Some((scene, of_scene)) = wanted {
                    match self.change(&plan, scene.clone()) {
                        Ok(change) => {
                            plan = change.plan().clone();
                            left = Some(of_scene);
                            next_scene.leave(change);
                        }
                        Err(_) => needs_another = Some((scene, of_scene)),
                    }
                }
                begun = Instant::now();
                match ends || needs_another.is_some() {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            });
            let (picture, statistics) = drawn?;
            if needs_another.is_some() {
                return Ok(needs_another);
            }
            if let Some(of_scene) = left {
                // The round before was the last of its scene.
                number = of_scene;
                continue;
            }
            // A picture that could not be finished stays as it is, too: it says so.
            self.shared.show(number, picture, |shown| {
                shown.converged = true;
                shown.statistics = Some(Arc::new(statistics));
            });
            let Some((scene, of_scene)) = self.shared.next_wanted() else { return Ok(None) };
            match self.change(&plan, scene.clone()) {
                Ok(change) => {
                    plan = change.plan().clone();
                    number = of_scene;
                    renderer.change(change)?;
                }
                Err(_) => return Ok(Some((scene, of_scene))),
            }
        }
    }

    /// Whatever is wrong with a scene itself is told when a renderer is made for it.
    fn change(&self, plan: &Plan, scene: Scene) -> Result<SceneChange> {
        SceneChange::new(&self.gpu, &self.compiler, plan, self.data.again(scene)?)
    }
}
