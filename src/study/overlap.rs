//! How much of the transfer rendering hides, by queue topology, copy path and staging halves: the same orbit, drawn
//! free running through a small atlas, each way by a device opened for it.
//!
//! # Source
//! Overlap as `trace::summary` has it: the part of the copies' time beside which rays were marched.

use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;
use xxhash_rust::xxh3::Xxh3;

use crate::error::{Error, Exit, Result};
use crate::gpu::{
    Buffer, BufferSpec, DeviceRequest, Gpu, Instance, MemoryHome, QueueTopology, Recorder,
    RoleKind, ShaderCompiler, Timestamps,
};
use crate::render::paging::CopyPath;
use crate::render::{Plan, Renderer, SceneData, Settings};
use crate::scene::{Scene, View};
use crate::study::repeated::Spread;
use crate::trace::summary::Summary;
use crate::trace::{Trace, TraceOptions};

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Views of the orbit, and degrees between them.
    pub views: u32,
    /// See `views`.
    pub degrees: f64,
    /// Turns that count; one more comes before them.
    pub repeats: u32,
}

/// One way for bricks to travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Travel {
    /// Which queues.
    pub queues: QueueTopology,
    /// How voxels come into a slot.
    pub path: CopyPath,
    /// The upload buffer is handed over.
    pub hands_over: bool,
    /// Staging halves, 2 or 3.
    pub halves: u32,
}

/// What one way gave.
#[derive(Clone, Debug, Serialize)]
pub struct OverlapRow {
    /// The topology.
    pub queues: &'static str,
    /// "straight", "placed", or "handed over".
    pub path: &'static str,
    /// Staging halves.
    pub halves: u32,
    /// Milliseconds of the orbit on the wall.
    pub ms: Spread,
    /// Over the first row's, turn by turn.
    pub over_first: Spread,
    /// Part of the copies' time beside which rays were marched; nothing where a queue has no timestamps.
    pub overlap: Option<Spread>,
    /// 10^9 bytes of texels a second of the copies' time; nothing as above.
    pub copied_gb_per_second: Option<Spread>,
    /// The same over one plain copy of as many bytes as a half holds, on the same queue.
    pub over_plain_copy: Option<f64>,
    /// Milliseconds in which rendering waited for bricks or loaders.
    pub waited_ms: Spread,
    /// Bricks uploaded, of the last turn.
    pub bricks: u64,
}

/// A way that was not gone.
#[derive(Clone, Debug, Serialize)]
pub struct NotRun {
    /// Which.
    pub what: &'static str,
    /// Why.
    pub why: String,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub struct OverlapTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// What times are by: "wall".
    pub clock: &'static str,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Views of the orbit.
    pub views: u32,
    /// Turns that count.
    pub repeats: u32,
    /// Digest of all pictures, the same for every way and turn: exact refinement, so the error is 0.
    pub pictures: String,
    /// Way by way.
    pub rows: Vec<OverlapRow>,
    /// What the device does not offer.
    pub not_run: Vec<NotRun>,
}

/// Measures every way that the device offers; `progress` is told the finished part.
///
/// # Errors
/// Exit code 1 where two ways differ in a byte: a bug of ours; else as drawing does.
pub fn measure(
    (instance, device): (&Arc<Instance>, Option<&str>),
    compiler: &ShaderCompiler,
    data: &SceneData,
    settings: Settings,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<OverlapTable> {
    let open = |queues, halves| {
        let choice = device.map(str::to_owned);
        let request = DeviceRequest { choice, presents: false, queues, three_halves: halves == 3 };
        Gpu::open(instance, &request)
    };
    let facts = open(QueueTopology::Auto, 2)?.facts().clone();
    let mut not_run: Vec<NotRun> = QueueTopology::ALL
        .into_iter()
        .filter_map(|of| Some(NotRun { what: of.name(), why: of.lacks(&facts.queues)?.to_owned() }))
        .collect();
    not_run.push(NotRun {
        what: "host-image-copy",
        why: "not built: our Vulkan headers (1.3.251) are older than VK_EXT_host_image_copy"
            .to_owned(),
    });
    let ways = ways(&QueueTopology::offered(&facts.queues));
    let orbit = orbit(data, effort)?;
    let mut turns: Vec<Vec<Turn>> = vec![Vec::new(); ways.len()];
    let mut pictures: Option<String> = None;
    let runs = ways.len() as u32 * (effort.repeats + 1);
    for turn in 0..=effort.repeats {
        for (at, way) in ways.iter().enumerate() {
            let gpu = open(way.queues, way.halves)?;
            let gone = go(&gpu, compiler, &orbit, settings, *way)?;
            let first = pictures.get_or_insert_with(|| gone.pictures.clone());
            if *first != gone.pictures {
                let message = format!("{way:?} draws other bytes than {:?}", ways[0]);
                return Err(Error { exit: Exit::Bug, message });
            }
            if turn > 0 {
                turns[at].push(gone);
            }
            progress(f64::from(turn * ways.len() as u32 + at as u32 + 1) / f64::from(runs));
        }
    }
    let rows = ways.iter().zip(&turns).map(|(way, of_way)| row(*way, of_way, &turns[0]));
    Ok(OverlapTable {
        device: facts.name,
        driver: facts.driver,
        clock: "wall",
        size: data.scene.picture.size,
        views: effort.views,
        repeats: effort.repeats,
        pictures: pictures.unwrap_or_default(),
        rows: rows.collect(),
        not_run,
    })
}

/// Every way that topologies allow.
fn ways(offered: &[QueueTopology]) -> Vec<Travel> {
    let mut ways = Vec::new();
    for queues in offered {
        for halves in [2, 3] {
            let way = |path, hands_over| Travel { queues: *queues, path, hands_over, halves };
            if *queues != QueueTopology::Ownership {
                ways.push(way(CopyPath::Straight, false));
                ways.push(way(CopyPath::Placed, false));
            }
            // Where one family has both roles, the hand-over is but barriers: what those cost is told too.
            if matches!(queues, QueueTopology::Ownership | QueueTopology::OneQueue) {
                ways.push(way(CopyPath::Placed, true));
            }
        }
    }
    ways
}

/// What one turn of one way gave.
#[derive(Clone)]
struct Turn {
    ms: f64,
    overlap: Option<f64>,
    gb_per_second: Option<f64>,
    plain_gb_per_second: Option<f64>,
    waited_ms: f64,
    bricks: u64,
    pictures: String,
}

fn row(way: Travel, turns: &[Turn], first: &[Turn]) -> OverlapRow {
    let of = |value: &dyn Fn(&Turn) -> f64| -> Vec<f64> { turns.iter().map(value).collect() };
    let known = |value: &dyn Fn(&Turn) -> Option<f64>| {
        let values: Option<Vec<f64>> = turns.iter().map(value).collect();
        values.filter(|values| !values.is_empty())
    };
    let ms = of(&|turn| turn.ms);
    let first_ms: Vec<f64> = first.iter().map(|turn| turn.ms).collect();
    let copied = known(&|turn| turn.gb_per_second);
    let plain = known(&|turn| turn.plain_gb_per_second);
    OverlapRow {
        queues: way.queues.name(),
        path: if way.hands_over { "handed over" } else { way.path.name() },
        halves: way.halves,
        ms: Spread::of(&ms),
        over_first: Spread::of_ratios(&ms, &first_ms),
        overlap: known(&|turn| turn.overlap).map(|values| Spread::of(&values)),
        over_plain_copy: copied
            .as_ref()
            .zip(plain)
            .map(|(copied, plain)| Spread::of_ratios(copied, &plain).median),
        copied_gb_per_second: copied.map(|values| Spread::of(&values)),
        waited_ms: Spread::of(&of(&|turn| turn.waited_ms)),
        bricks: turns.last().map_or(0, |turn| turn.bricks),
    }
}

fn orbit(data: &SceneData, effort: &Effort) -> Result<SceneData> {
    let (middle, first) = (data.middle_world(0), &data.scene.views[0]);
    let turned = |number: u32| View {
        name: format!("{number}"),
        ..first.turned(middle, effort.degrees * f64::from(number))
    };
    data.again(Scene { views: (0..effort.views).map(turned).collect(), ..data.scene.clone() })
}

fn go(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    orbit: &SceneData,
    mut settings: Settings,
    way: Travel,
) -> Result<Turn> {
    settings.paging.copy_path = Some(way.path);
    settings.paging.hands_over = way.hands_over;
    let plan = Plan::new(gpu, compiler, orbit, &settings)?;
    let half_bytes =
        plan.buffers.iter().find(|of| of.name == "staging_half_0").map_or(0, |of| of.bytes);
    let plain = plain_copy(gpu, half_bytes)?;
    let trace = Trace::new(gpu, TraceOptions::default());
    let mut renderer = Renderer::traced(gpu, plan, orbit, Some(&trace))?;
    let mut digest = Xxh3::new();
    let begun = Instant::now();
    let mut bytes = 0;
    let mut bricks = 0;
    for view in 0..orbit.scene.views.len() {
        let (picture, statistics) = renderer.draw(view, &mut |_| {})?;
        if let Some(lacks) = statistics.lacks() {
            return Err(Error { exit: Exit::Incomplete, message: format!("a view {lacks}") });
        }
        digest.update(bytemuck::cast_slice(&picture.pixels));
        bytes += statistics.bytes_uploaded;
        bricks += statistics.bricks_uploaded;
    }
    let ms = begun.elapsed().as_secs_f64() * 1e3;
    drop(renderer);
    let mut file = Vec::new();
    let bug = |why: String| Error { exit: Exit::Bug, message: why };
    trace.write(&mut file).map_err(|why| bug(why.to_string()))?;
    let file = serde_json::from_slice(&file).map_err(|why| bug(why.to_string()))?;
    let summary = Summary::of(&file).map_err(bug)?;
    let copied_ms = summary.queues.get(1).map_or(0.0, |queue| queue.ms);
    let timed = gpu.has_timestamps(RoleKind::Transfer) && copied_ms > 0.0;
    let waited = summary.stalls.iter().filter(|stall| stall.cause.starts_with("rendering"));
    Ok(Turn {
        ms,
        overlap: summary.overlap,
        gb_per_second: timed.then(|| bytes as f64 / copied_ms * 1e-6),
        plain_gb_per_second: plain,
        waited_ms: waited.map(|stall| stall.ms).sum(),
        bricks,
        pictures: format!("{:016x}", digest.digest()),
    })
}

/// 10^9 bytes a second of one copy from the host's memory to the device's, on the transfer role's queue: the bus.
fn plain_copy(gpu: &Arc<Gpu>, bytes: u64) -> Result<Option<f64>> {
    let Some(timestamps) = Timestamps::new(gpu, RoleKind::Transfer, 4)?.filter(|_| bytes > 0)
    else {
        return Ok(None);
    };
    let buffer = |name, home| Buffer::new(gpu, &BufferSpec { name, bytes, home });
    let source = buffer("plain_source", MemoryHome::Upload)?;
    let target = buffer("plain_target", MemoryHome::Device)?;
    source.write_with(0, bytes, |bytes| bytes.fill(7))?;
    let mut best = f64::INFINITY;
    for _ in 0..3 {
        let mut recorder = Recorder::new(gpu, RoleKind::Transfer, Some(&timestamps));
        recorder.copy_buffer("plain", &source, 0, &target, 0, bytes);
        gpu.wait(recorder.submit(&[])?.point)?;
        let times = timestamps.take()?;
        let ms: f64 = times.iter().flat_map(|times| times.step_ms()).map(|(_, ms)| ms).sum();
        best = best.min(ms);
    }
    Ok((best > 0.0 && best.is_finite()).then(|| bytes as f64 / best * 1e-6))
}
