//! Random use of one device in one process, again and again: every picture right, and nothing grows.
//!
//! Stretches of drawings follow one another, each from a seed of its own; after each, with all of it
//! dropped, device, threads, files and memory are counted. `ASHFALL_LONG_SEED` is the first one's seed:
//! with that of a stretch that failed, it comes first.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use ashfall::gpu::{
    Buffer, BufferSpec, DeviceRequest, Gpu, Instance, MemoryHome, ShaderCompiler, Validation,
};
use ashfall::passes::SOURCES;

use crate::alone;
use crate::chance::Chance;
use crate::common::device;
use crate::common::drawing::Device;
use crate::process::{Facts, slope, soon, threads_named};
use crate::scenes::World;
use crate::uses::{Counts, Use, first_pictures};

/// Scenes of a stretch.
const WORLDS: usize = 2;
/// Renderers alive at once.
const ALIVE_MAX: usize = 3;
/// One step lasts seconds; so many mean that it hangs.
const HANGS: Duration = Duration::from_secs(300);
/// Resident memory may seem to grow by so much for no reason but its own scatter.
const SCATTER_MB: f64 = 24.0;
/// Runs that are judged by their memory last so long at least.
const WARM_MIN: Duration = Duration::from_secs(60);
/// Checks that a slope is judged by, at least.
const CHECKS_MIN: usize = 8;
/// Beyond that, kB per drawing: 38 to 116 were measured with validation, which keeps something of every
/// renderer; 7 to 47 without. This program's own heap grows by less than 1.
const WATCHED_KB_MAX: f64 = 150.0;
const UNWATCHED_KB_MAX: f64 = 25.0;

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
    let mut chance = Chance(seed);
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
        gpu = Gpu::open(&instance, &DeviceRequest { choice }).expect("as before");
    }
    let kb_max = if watched { WATCHED_KB_MAX } else { UNWATCHED_KB_MAX };
    let cache = std::env::temp_dir().join("ashfall-test-spirv");
    let device = Device { gpu, compiler: ShaderCompiler::new(SOURCES, Some(cache)) };
    let (steps, said) = channel();
    let watcher = std::thread::spawn(move || watch(said));
    let seed = std::env::var("ASHFALL_LONG_SEED").ok().and_then(|seed| seed.parse().ok());
    let seed: u64 = seed.unwrap_or(1);
    let begun = Instant::now();
    let until = begun + Duration::from_secs(seconds);
    let mut counts = Counts::default();
    let mut points: Vec<(f64, f64, u64)> = Vec::new();
    let mut first: Option<Facts> = None;
    for seed in seed.. {
        if Instant::now() >= until {
            break;
        }
        // Heard with a failure.
        println!("stretch of seed {seed}, {} drawings before", counts.drawings);
        stretch(&device, seed, drawings, until, &steps, &mut counts);
        let facts = nothing_left(&device, &format!("seed {seed}"));
        let before = first.get_or_insert(facts);
        assert!(facts.files <= before.files, "seed {seed}: {facts:?} after {before:?}");
        assert!(facts.threads <= before.threads, "seed {seed}: {facts:?} after {before:?}");
        points.push((begun.elapsed().as_secs_f64(), facts.resident_mb, counts.drawings));
    }
    drop(steps);
    watcher.join().expect("no panic");
    // What the device's end finds alive, validation lists.
    drop(device);
    let said: Vec<String> = instance.messages().into_iter().map(|said| said.text).collect();
    assert!(said.is_empty(), "validation says:\n{}", said.join("\n"));
    report(&counts, &points, first, begun.elapsed(), kb_max);
}

fn report(
    counts: &Counts,
    points: &[(f64, f64, u64)],
    facts: Option<Facts>,
    took: Duration,
    kb_max: f64,
) {
    let warm = took.as_secs_f64() * 0.1;
    let warm: Vec<_> = points.iter().filter(|(at, ..)| *at >= warm).collect();
    let line: Vec<_> = warm.iter().map(|(_, mb, drawings)| (*drawings as f64, *mb)).collect();
    let mb_per_drawing = slope(&line);
    let drawings = line.last().map_or(0.0, |last| last.0) - line.first().map_or(0.0, |one| one.0);
    // Drivers and validation take their fill in the first minute: a run of seconds has no other part,
    // and what it checks is that pictures agree, and that ledger, threads and files are as before.
    let judged = warm.len() >= CHECKS_MIN && took >= WARM_MIN;
    let [start, middle, end] = [0, warm.len() / 2, warm.len() - 1].map(|at| warm[at].1);
    println!(
        "random use for {:.0} s: {counts:?}, {} checks, {} files and {} threads at most, resident {start:.1} MB after a tenth, \
         {middle:.1} in the middle, {end:.1} at the end, slope {:.2} kB a drawing{}",
        took.as_secs_f64(),
        points.len(),
        facts.map_or(0, |facts| facts.files),
        facts.map_or(0, |facts| facts.threads),
        mb_per_drawing * 1e3,
        if judged { "" } else { " (too short to judge)" },
    );
    assert!(warm.len() < CHECKS_MIN || counts.same > 0, "some drawings lack nothing");
    let grown = mb_per_drawing * drawings;
    let allowed = SCATTER_MB + kb_max * 1e-3 * drawings;
    assert!(!judged || grown <= allowed, "resident memory grows by {grown:.1} MB: {points:?}");
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
#[ignore = "an hour: random use for ASHFALL_LONG_SECONDS"]
fn random_use_grows_nothing() {
    run(seconds(), 25, true);
}

#[test]
#[ignore = "6 minutes: a tenth of ASHFALL_LONG_SECONDS, without validation, which grows itself"]
fn random_use_grows_nothing_unwatched() {
    run(seconds() / 10, 25, false);
}
