//! Random use of one device in one process, again and again: every picture right, and nothing grows.
//!
//! Stretches of drawings follow one another, each from a seed of its own; after each, with all of it
//! dropped, device, threads, files and memory are counted. `ASHFALL_LONG_SEED` is the first one's seed:
//! with that of a stretch that failed, it comes first.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use ashfall::gpu::{
    Buffer, BufferSpec, DeviceRequest, Gpu, Instance, MemoryHome, Recorder, RoleKind,
    ShaderCompiler, Validation,
};
use ashfall::passes::SOURCES;

use crate::alone;
use crate::chance::Chance;
use crate::common::device;
use crate::common::drawing::Device;
use crate::process::{Facts, open_files, slope, soon, threads_named};
use crate::scenes::World;
use crate::uses::{Counts, Use, first_pictures};

/// Scenes of a stretch.
const WORLDS: usize = 2;
/// Renderers alive at once.
const ALIVE_MAX: usize = 3;
/// One step lasts seconds; so many mean that it hangs.
const HANGS: Duration = Duration::from_secs(300);
/// Runs that are judged by their memory last so long at least.
const WARM_MIN: Duration = Duration::from_secs(60);
/// Checks that a slope is judged by, at least.
const CHECKS_MIN: usize = 8;
/// Memory in use may scatter by so much: the GLSL compiler's arenas grow by some MB at a time as larger
/// shaders come, and crossbeam gives back what ended threads left in steps of 0.3 MB. In an hour of some
/// 35,000 drawings it is 0.2 kB of each.
const SCATTER_MB: f64 = 8.0;

/// Says what hangs and ends the process: a thread that hangs cannot be ended otherwise.
fn watch(steps: Receiver<String>) {
    let mut step = "nothing yet".to_owned();
    loop {
        match steps.recv_timeout(HANGS) {
            Ok(next) => step = next,
            Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {
                eprintln!("HANGS for {HANGS:?}: {step}");
                std::process::abort();
            }
        }
    }
}

/// So many drawings, in whatever order of making, drawing and dropping.
fn stretch(
    device: &Device,
    seed: u64,
    drawings: u64,
    until: Instant,
    steps: &Sender<String>,
    counts: &mut Counts,
) {
    let say = |what: String| steps.send(format!("seed {seed}, {what}")).expect("watched");
    let mut chance = Chance::new(seed);
    let chance = &mut chance;
    let worlds: Vec<World> = (0..WORLDS).map(|_| World::random(chance)).collect();
    let first = |world: &World| {
        say(format!("first pictures of {}", world.what));
        first_pictures(device, world)
    };
    let wanted: Vec<_> = worlds.iter().map(first).collect();
    let last = counts.drawings + drawings;
    let mut alive: Vec<Use> = Vec::new();
    while counts.drawings < last && Instant::now() < until {
        if alive.len() == ALIVE_MAX || (!alive.is_empty() && chance.once_in(6)) {
            let ending = alive.swap_remove(chance.below(alive.len()));
            say(format!("dropping {}", ending.what()));
            drop(ending);
        }
        if alive.is_empty() || chance.once_in(3) {
            let number = chance.below(WORLDS);
            say(format!("making a renderer of {}", worlds[number].what));
            alive.push(Use::new(device, &worlds[number], &wanted[number], chance));
            counts.renderers += 1;
        }
        let number = chance.below(alive.len());
        say(format!("drawing {}", alive[number].what()));
        alive[number].draw(chance, counts);
    }
    say("dropping all".to_owned());
}

/// With everything dropped, only the device is left.
fn nothing_left(device: &Device, what: &str) -> Facts {
    assert!(soon(|| threads_named("loader ") == 0), "{what}: loaders are left");
    // Every object made of the device holds it.
    let owners = || Arc::strong_count(&device.gpu);
    assert!(soon(|| owners() == 1), "{what}: {} objects are left", owners() - 1);
    let collected = soon(|| {
        let spec = BufferSpec { name: "last", bytes: 4, home: MemoryHome::Upload };
        drop(Buffer::new(&device.gpu, &spec).expect("a buffer"));
        device.gpu.ledger.bytes() == 0
    });
    assert!(collected, "{what}: the ledger has {:#?}", device.gpu.ledger.entries());
    // lavapipe lets go of destroyed pipelines when the next submission comes.
    for kind in [RoleKind::Render, RoleKind::Transfer] {
        let submitted = Recorder::new(&device.gpu, kind, None).submit(&[]).expect("nothing to do");
        device.gpu.wait(submitted.point).expect("at once");
    }
    let said = device.gpu.messages();
    assert!(said.is_empty(), "{what}: validation says {said:#?}");
    Facts::now()
}

fn run(seconds: u64, drawings: u64, watched: bool) {
    let _alone = alone();
    let Some((mut gpu, mut instance)) = device::open() else { return };
    if !watched {
        let choice = std::env::var("ASHFALL_DEVICE").ok();
        drop(gpu);
        instance = Instance::new(Validation::Off).expect("as before");
        gpu = Gpu::open(&instance, &DeviceRequest { choice, ..DeviceRequest::default() })
            .expect("as before");
    }
    let cache = std::env::temp_dir().join("ashfall-test-spirv");
    // What the GLSL compiler needs it keeps: the first stretch compiles, so that no later one is first.
    let mut device = Device { gpu, compiler: ShaderCompiler::new(SOURCES, None) };
    let (steps, said) = channel();
    let watcher = std::thread::spawn(move || watch(said));
    let seed = std::env::var("ASHFALL_LONG_SEED").ok().and_then(|seed| seed.parse().ok());
    let seed: u64 = seed.unwrap_or(1);
    let begun = Instant::now();
    let until = begun + Duration::from_secs(seconds);
    let mut counts = Counts::default();
    let mut points: Vec<(f64, Facts, u64)> = Vec::new();
    let mut first: Option<Facts> = None;
    let mut compiling = None;
    for seed in seed.. {
        if Instant::now() >= until {
            break;
        }
        // Heard with a failure.
        println!("stretch of seed {seed}, {} drawings before", counts.drawings);
        stretch(&device, seed, drawings, until, &steps, &mut counts);
        let facts = nothing_left(&device, &format!("seed {seed}"));
        compiling.get_or_insert_with(|| {
            let cached = ShaderCompiler::new(SOURCES, Some(cache.clone()));
            std::mem::replace(&mut device.compiler, cached)
        });
        let before = first.get_or_insert(facts);
        // Threads and what they opened may still be on their way out.
        let few = soon(|| {
            let now = Facts::now();
            now.files <= before.files && now.threads <= before.threads
        });
        let now = Facts::now();
        assert!(few, "seed {seed}: {now:?} after {before:?}, open are {:#?}", open_files());
        println!("    after it: {facts:?}");
        points.push((begun.elapsed().as_secs_f64(), facts, counts.drawings));
    }
    drop(steps);
    watcher.join().expect("no panic");
    // What the device's end finds alive, validation lists.
    drop(device);
    let said: Vec<String> = instance.messages().into_iter().map(|said| said.text).collect();
    assert!(said.is_empty(), "validation says:\n{}", said.join("\n"));
    report(&counts, &points, first, begun.elapsed(), watched);
}

fn report(
    counts: &Counts,
    points: &[(f64, Facts, u64)],
    first: Option<Facts>,
    took: Duration,
    watched: bool,
) {
    let warm = took.as_secs_f64() * 0.1;
    let warm: Vec<_> = points.iter().filter(|(at, ..)| *at >= warm).collect();
    let line: Vec<_> =
        warm.iter().map(|(_, facts, drawings)| (*drawings as f64, facts.in_use_mb)).collect();
    let mb_per_drawing = slope(&line);
    let drawings = line.last().map_or(0.0, |last| last.0) - line.first().map_or(0.0, |one| one.0);
    // Drivers and validation take their fill in the first minute: a run of seconds has no other part,
    // and what it checks is that pictures agree, and that ledger, threads and files are as before.
    // Validation keeps some 30 kB of every drawing, and nothing grows without it: it is not judged.
    let judged = !watched && warm.len() >= CHECKS_MIN && took >= WARM_MIN;
    let at = |part: usize| warm[part * (warm.len() - 1) / 2].1;
    let [start, middle, end] = [0, 1, 2].map(at);
    println!(
        "random use for {:.0} s: {counts:?}, {} checks, {} files and {} threads at most; in use after a tenth \
         {:.2} MB, in the middle {:.2}, at the end {:.2}, slope {:.3} kB a drawing{}; resident {:.1} MB, {:.1}, {:.1}",
        took.as_secs_f64(),
        points.len(),
        first.map_or(0, |facts| facts.files),
        first.map_or(0, |facts| facts.threads),
        start.in_use_mb,
        middle.in_use_mb,
        end.in_use_mb,
        mb_per_drawing * 1e3,
        if judged { "" } else { " (not judged)" },
        start.resident_mb,
        middle.resident_mb,
        end.resident_mb,
    );
    assert!(warm.len() < CHECKS_MIN || counts.same > 0, "some drawings lack nothing");
    let grown = mb_per_drawing * drawings;
    assert!(!judged || grown <= SCATTER_MB, "memory in use grows by {grown:.1} MB: {points:?}");
}

#[test]
fn random_use_grows_nothing_in_10_seconds() {
    run(10, 10, true);
}

fn seconds() -> u64 {
    let seconds = std::env::var("ASHFALL_LONG_SECONDS").ok();
    seconds.map_or(3600, |text| text.parse().expect("seconds"))
}

#[test]
#[ignore = "an hour: random use for ASHFALL_LONG_SECONDS, without validation, which grows itself"]
fn random_use_grows_nothing() {
    run(seconds(), 25, false);
}

#[test]
#[ignore = "6 minutes: a tenth of ASHFALL_LONG_SECONDS, with validation"]
fn random_use_under_validation() {
    run(seconds() / 10, 25, true);
}
