//! One renderer's life: made, drawn with, dropped; and what its drawings must say.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use ashfall::render::{Picture, Plan, Renderer, Settings, Statistics, Unfinished};
use ashfall::source::faulty::Faulty;

use crate::chance::Chance;
use crate::common::drawing::Device;
use crate::scenes::{Shared, Trouble, VIEWS, World, settings};

/// Drawings that ended so.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub renderers: u64,
    pub drawings: u64,
    /// Lacked nothing and had the bytes of the first one.
    pub same: u64,
    pub starved: u64,
    pub full: u64,
    pub failed: u64,
}

/// Patience with sources that stall: short, since it is waited for.
const SHORT: Duration = Duration::from_millis(200);
/// Patience with all others: only a failure takes so long.
const LONG: Duration = Duration::from_secs(60);

/// A renderer and what it is held to.
pub struct Use<'a> {
    wanted: &'a [Picture],
    source: Arc<Faulty<Shared, Trouble>>,
    exact: bool,
    /// Nothing while it is dropped.
    renderer: Option<Renderer>,
    what: String,
}

impl<'a> Use<'a> {
    pub fn new(
        device: &Device,
        world: &World,
        wanted: &'a [Picture],
        chance: &mut Chance,
    ) -> Use<'a> {
        let source = world.source(Trouble::random(chance));
        let stalls = matches!(source.fault, Trouble::Stalling(_));
        let settings = settings(chance, if stalls { SHORT } else { LONG });
        let exact = !chance.once_in(4);
        let what = format!("{}, exact {exact}, {}, {settings:?}", world.what, source.fault.name());
        let renderer = Some(renderer(device, world, &source, exact, &settings, &what));
        Use { wanted, source, exact, renderer, what }
    }

    /// In words, for a failure.
    pub fn what(&self) -> &str {
        &self.what
    }

    /// Draws some view and looks at what came.
    pub fn draw(&mut self, chance: &mut Chance, counts: &mut Counts) {
        let view = chance.below(VIEWS);
        let bumps: Vec<u64> = match self.source.fault {
            Trouble::Bumps => (0..chance.between(1, 8)).map(|_| chance.below(4) as u64).collect(),
            _ => Vec::new(),
        };
        let renderer = self.renderer.as_mut().expect("not dropped");
        let epoch = renderer.epoch();
        let drawn = std::thread::scope(|scope| {
            scope.spawn(move || {
                for pause in bumps {
                    std::thread::sleep(Duration::from_millis(pause));
                    epoch.fetch_add(1, Ordering::SeqCst);
                }
            });
            renderer.draw(view, &mut |_| {})
        });
        let (picture, statistics) =
            drawn.unwrap_or_else(|why| panic!("view {view}, {}: {why}", self.what));
        counts.drawings += 1;
        self.check(view, &picture, &statistics, counts);
        if let Trouble::Stalling(stalling) = &self.source.fault
            && chance.once_in(2)
        {
            stalling.go_on();
        }
    }

    fn check(&self, view: usize, picture: &Picture, statistics: &Statistics, counts: &mut Counts) {
        let what = || format!("view {view}, {}: {statistics:?}", self.what);
        let fault = &self.source.fault;
        match statistics.unfinished {
            Some(Unfinished::Starved { .. }) => {
                assert!(matches!(fault, Trouble::Stalling(_)), "starved: {}", what());
                counts.starved += 1;
                return;
            }
            Some(Unfinished::Full { .. }) => {
                assert!(!self.exact, "full: {}", what());
                counts.full += 1;
                return;
            }
            Some(unfinished) => panic!("{unfinished}: {}", what()),
            None => assert!(statistics.converged, "{}", what()),
        }
        if statistics.bricks_failed > 0 {
            assert!(matches!(fault, Trouble::Failing(_)), "failed: {}", what());
            counts.failed += 1;
        } else if self.exact {
            let wanted = &self.wanted[view].pixels;
            let differ = wanted.iter().zip(&picture.pixels).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "pixels of {} differ: {}", wanted.len(), what());
            counts.same += 1;
        }
    }
}

impl Drop for Use<'_> {
    fn drop(&mut self) {
        // What is stuck in a source is left behind here, and ends once it goes on.
        drop(self.renderer.take());
        if let Trouble::Stalling(stalling) = &self.source.fault {
            stalling.go_on();
        }
    }
}

fn renderer(
    device: &Device,
    world: &World,
    source: &Arc<Faulty<Shared, Trouble>>,
    exact: bool,
    settings: &Settings,
    what: &str,
) -> Renderer {
    let data = world.data(source.clone(), exact);
    let settings = settings.checked().unwrap_or_else(|why| panic!("{what}: {why}"));
    let plan = Plan::new(&device.gpu, &device.compiler, &data, &settings);
    plan.and_then(|plan| Renderer::new(&device.gpu, plan, &data))
        .unwrap_or_else(|why| panic!("{what}: {why}"))
}

/// Every view, undisturbed, with room for all.
pub fn first_pictures(device: &Device, world: &World) -> Vec<Picture> {
    let source = world.source(Trouble::Nothing);
    let settings =
        Settings { addressing: ashfall::render::Addressing::Paged, ..Settings::default() };
    let mut renderer = renderer(device, world, &source, true, &settings, &world.what);
    let draw = |view| {
        let (picture, statistics) =
            renderer.draw(view, &mut |_| {}).unwrap_or_else(|why| panic!("{}: {why}", world.what));
        let whole = statistics.converged && statistics.bricks_failed == 0;
        assert!(whole, "{}: {statistics:?}", world.what);
        picture
    };
    (0..VIEWS).map(draw).collect()
}
