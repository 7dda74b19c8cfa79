//! A trace tells what statistics tell, is valid, bounded, and costs no picture a bit.

#[path = "trace/draw.rs"]
mod draw;
#[path = "trace/file.rs"]
mod file;
mod folder;
#[path = "trace/loaders.rs"]
mod loaders;
#[path = "trace/summary.rs"]
mod summary;

mod binary;
mod common;

use ashfall::gpu::RoleKind;
use ashfall::render::paging::{CopyPath, PagingSettings};
use ashfall::render::{Addressing, Picture, Renderer, SceneData, Settings, Statistics};
use ashfall::scene::Overrides;
use ashfall::trace::TraceOptions;
use binary::ashfall;
use common::drawing::{Device, computed_scene};
use file::{Read, of, parse, read};
use folder::Folder;

fn scene() -> SceneData {
    let overrides = Overrides { size: Some([48, 40]), level_max: Some(0), ..Overrides::default() };
    computed_scene("shells", [96, 96, 96], &overrides)
}

/// A few slots, so that bricks come and go.
fn paged(lockstep: bool) -> Settings {
    let paging = PagingSettings {
        atlas_slots: Some(12),
        staging_bricks: Some(3),
        loaders: Some(2),
        lockstep,
        ..PagingSettings::default()
    };
    Settings { addressing: Addressing::Paged, paging, ..Settings::default() }
}

struct Drawn {
    picture: Picture,
    statistics: Statistics,
    trace: Read,
}

fn draw(device: &Device, settings: &Settings, options: TraceOptions) -> Drawn {
    let data = scene();
    let trace = ashfall::trace::Trace::new(&device.gpu, options);
    let plan = device.plan(&data, settings);
    let mut renderer =
        Renderer::traced(&device.gpu, plan, &data, Some(&trace)).expect("a renderer");
    let (picture, statistics) = renderer.draw(0, &mut |_| {}).expect("drawn");
    let trace = read(&trace);
    trace.check_tracks();
    Drawn { picture, statistics, trace }
}

/// Passes of the render queue are the statistics' passes, as often and as long.
fn check_passes(drawn: &Drawn) {
    let clipped_ms = drawn.trace.about["clipped_us"].as_f64().expect("a number") * 1e-3;
    for time in &drawn.statistics.gpu_ms {
        let track =
            if ["copy", "upload"].contains(&time.pass.as_str()) { "transfer" } else { "render" };
        let mut spans = drawn.trace.spans(track, &time.pass);
        if time.pass == "copy" {
            // The first usage order is copied beside bricks.
            spans.extend(drawn.trace.spans(track, "order"));
        }
        let ns: i64 = spans.iter().map(|span| span.end_ns - span.begin_ns).sum();
        let rounding_ms = 2e-6 * (1 + spans.len()) as f64;
        assert!((ns as f64 * 1e-6 - time.ms).abs() <= rounding_ms + clipped_ms, "{time:?} {ns}");
        if track == "render" {
            assert_eq!(spans.len() as u64, time.count, "{time:?}");
        }
    }
}

fn check_paged(drawn: &Drawn) {
    let Drawn { statistics, trace, .. } = drawn;
    let loading = statistics.loading.as_ref().expect("bricks were loaded");
    assert!(statistics.converged && statistics.bricks_uploaded > 12, "{statistics:?}");
    check_passes(drawn);
    for track in ["rounds", "transfer"] {
        let name = if track == "rounds" { "flush" } else { "copy" };
        assert_eq!(trace.sum(track, name, "bricks"), statistics.bricks_uploaded, "{name}");
        assert_eq!(trace.sum(track, name, "bytes"), statistics.bytes_uploaded, "{name}");
    }
    let reads = trace.spans("loader", "read").len() as u64;
    assert_eq!(reads + of(&trace.about, "reads_under_way"), loading.reads);
    assert_eq!(trace.spans("loader", "survey").len() as u64, loading.surveys);
    assert_eq!(trace.sum("loader", "read", "bytes"), loading.bytes_read);
    assert!(trace.spans("loader", "decode").is_empty(), "nothing that is computed is decoded");
    assert_eq!(trace.tracks.keys().filter(|track| track.starts_with("loader")).count(), 2);
    let submitted = |args: &serde_json::Value| of(args, "bytes");
    let bytes = trace.args_of("submitted").map(submitted).sum::<u64>();
    assert_eq!(bytes, statistics.bytes_uploaded, "each brick's own");
    for name in ["round", "submit", "report"] {
        assert_eq!(trace.spans("rounds", name).len() as u64, statistics.rounds, "{name}");
    }
    // Every brick's way, from being wanted to being published, drawn as a flow from track to track.
    assert_eq!(trace.count_of("published"), statistics.bricks_uploaded);
    assert_eq!(trace.count_of("staged"), statistics.bricks_uploaded);
    assert_eq!(trace.flows_finished.len() as u64, statistics.bricks_uploaded);
    for number in &trace.flows_finished {
        let flow = &trace.flows[number];
        let at = |track: &str| flow.iter().position(|(_, of, _)| of.starts_with(track));
        assert!(flow.len() >= 4 && at("rounds") == Some(0), "{flow:?}");
        assert!(at("transfer") > Some(0), "{flow:?}");
    }
    let sampled = trace.count_of("sampled");
    assert!(sampled > 12 && sampled <= statistics.bricks_uploaded, "{sampled}");
    let held = 12 - trace.last("slots free");
    assert_eq!(trace.count_of("evicted") + held, statistics.bricks_uploaded);
    assert_eq!(trace.counters["bytes read back"].len() as u64 > 0, statistics.bytes_read_back > 0);
    assert_eq!(trace.last("rays waiting"), statistics.rays_waiting);
    assert_eq!(trace.last("bytes uploaded"), statistics.bytes_uploaded);
    assert_eq!(trace.last("RAM cache bytes"), loading.cache_bytes);
    assert!(trace.counters.contains_key("bricks bound"));
    assert!(trace.counters["slots granted"].iter().any(|granted| *granted > 0));
    assert_eq!(of(&trace.about, "events_dropped"), 0);
    assert_eq!(trace.about["device"], statistics.device);
    assert_eq!(trace.about["driver"], statistics.driver);
}

/// On one clock: a pass of a round lies between its submit's begin and its wait's end.
fn check_clock(drawn: &Drawn) {
    let trace = &drawn.trace;
    let error_us = trace.about["render_queue_clock"]["error_us"].as_f64().expect("a number");
    let error_ns = (error_us * 1000.0).ceil() as i64 + 1;
    let passes = trace.spans("render", "march_bricks");
    assert!(!passes.is_empty());
    for pass in passes {
        let round = trace.spans("rounds", "round");
        let round = round.iter().find(|round| round.args["round"] == pass.args["round"]);
        let round = round.expect("of a round");
        assert!(round.begin_ns - error_ns <= pass.begin_ns, "before its round, by {error_ns}");
        assert!(pass.end_ns <= round.end_ns + error_ns, "after its round, by {error_ns}");
    }
}

/// Placing is on the host's track, behind every flush.
#[test]
fn placed_bricks_are_told_too() {
    let Some(device) = Device::open() else { return };
    let mut settings = paged(true);
    settings.paging.copy_path = Some(CopyPath::Placed);
    let drawn = draw(&device, &settings, TraceOptions::default());
    check_paged(&drawn);
    let [flushes, places] = ["flush", "place"].map(|name| drawn.trace.spans("rounds", name));
    assert!(flushes.len() > 2 && flushes.len() == places.len());
    for (flush, place) in flushes.iter().zip(&places) {
        assert!(flush.end_ns <= place.begin_ns, "placed before it was copied");
    }
    device.finish();
}

#[test]
fn rounds_in_lockstep_and_running_free_are_told_as_statistics_tell_them() {
    let Some(device) = Device::open() else { return };
    let plain = device.draw_with(&scene(), 0, &paged(true));
    for lockstep in [true, false] {
        let options = TraceOptions { scene: "shells".to_owned(), ..TraceOptions::default() };
        let drawn = draw(&device, &paged(lockstep), options);
        check_paged(&drawn);
        check_clock(&drawn);
        assert_eq!(drawn.trace.about["scene"], "shells");
        assert!(drawn.picture == plain.picture, "a trace changed the picture");
    }
    device.finish();
}

#[test]
fn rounds_of_several_submits_lose_no_pass_and_count_none_twice() {
    let Some(device) = Device::open() else { return };
    let settings = Settings { steps_per_dispatch: 32, ..paged(true) };
    let plan = device.plan(&scene(), &settings);
    let march = plan.passes.iter().find(|pass| pass.name == "march_bricks").expect("a pass");
    let dispatches = march.dispatches_per_tile;
    assert!(dispatches > 8, "one submit holds all {dispatches}");
    let drawn = draw(&device, &settings, TraceOptions::default());
    check_paged(&drawn);
    let marched = drawn.trace.spans("render", "march_bricks").len() as u64;
    assert_eq!(marched, drawn.statistics.rounds * u64::from(dispatches));
    device.finish();
}

#[test]
fn a_volume_that_is_drawn_directly_tells_its_passes_and_uploads() {
    let Some(device) = Device::open() else { return };
    let settings =
        Settings { addressing: Addressing::Direct, steps_per_dispatch: 32, ..Settings::default() };
    let drawn = draw(&device, &settings, TraceOptions::default());
    check_passes(&drawn);
    assert!(drawn.trace.spans("render", "march").len() > 1);
    assert!(!drawn.trace.spans("transfer", "upload").is_empty());
    assert_eq!(drawn.trace.last("bytes uploaded"), drawn.statistics.bytes_uploaded);
    device.finish();
}

#[test]
fn an_estimated_clock_says_so_and_how_wrong_it_may_be() {
    let Some(device) = Device::open() else { return };
    let options = TraceOptions { calibrate: false, ..TraceOptions::default() };
    let drawn = draw(&device, &paged(true), options);
    check_paged(&drawn);
    check_clock(&drawn);
    for role in [RoleKind::Render, RoleKind::Transfer] {
        let clock = &drawn.trace.about[format!("{}_queue_clock", role.name())];
        assert_eq!(clock["kind"], "estimated", "{clock}");
        assert!(clock["error_us"].as_f64() > Some(0.0), "{clock}");
    }
    device.finish();
}

#[test]
fn a_trace_is_bounded_and_counts_what_it_dropped() {
    let Some(device) = Device::open() else { return };
    let whole = draw(&device, &paged(true), TraceOptions::default());
    let options = TraceOptions { events_max: 100, ..TraceOptions::default() };
    let drawn = draw(&device, &paged(true), options);
    let events = |read: &Read| {
        let spans: usize = read.tracks.values().map(Vec::len).sum();
        let counts: usize = read.counters.values().map(Vec::len).sum();
        spans + counts + read.steps.len()
    };
    assert_eq!(events(&drawn.trace), 100);
    assert_eq!(of(&drawn.trace.about, "events_max"), 100);
    // Runs in lockstep repeat, but for when deliveries come: bound and cache are counted as they do.
    let dropped = of(&drawn.trace.about, "events_dropped") as f64;
    let expected = (events(&whole.trace) - 100) as f64;
    assert!((dropped / expected - 1.0).abs() < 0.2, "{dropped} of {expected}");
    assert!(drawn.picture == whole.picture);
    device.finish();
}

#[test]
fn the_command_writes_a_trace_only_where_it_is_asked_to() {
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("trace");
    let text = SCENE;
    let scene = folder.write("scene.toml", text);
    let render = |picture: &str, flags: &[&str]| {
        let mut arguments = vec!["render".into(), scene.clone().into_os_string(), "-o".into()];
        arguments.push(folder.path(picture).into_os_string());
        arguments.extend(flags.iter().map(|flag| flag.into()));
        ashfall(arguments)
    };
    let files = || std::fs::read_dir(&folder).expect("a folder").count();
    assert_eq!(render("plain.exr", &["--addressing", "paged"]).code, Some(0));
    assert_eq!(files(), 2, "the scene and the picture");
    let path = folder.path("trace.json");
    let trace = path.to_str().expect("a name in UTF-8");
    let flags = ["--addressing", "paged", "--trace", trace];
    let run = render("traced.exr", &flags);
    assert_eq!((run.code, files()), (Some(0), 4), "{}", run.stderr);
    let bytes = |name: &str| std::fs::read(folder.path(name)).expect("a file");
    assert!(bytes("plain.exr") == bytes("traced.exr"), "a trace changed the picture");
    let read = parse(&bytes("trace.json"));
    read.check_tracks();
    assert!(!read.spans("rounds", "round").is_empty());
    assert_eq!(read.about["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(read.about["scene"], scene.to_str().expect("a name in UTF-8"));
}

#[test]
fn a_trace_that_cannot_be_written_is_met_before_drawing_where_it_can_be() {
    let folder = Folder::new("trace-unwritable");
    let scene = folder.write("scene.toml", SCENE);
    let render = |trace: &std::path::Path| {
        let picture = folder.path("picture.png");
        ashfall([
            "render".as_ref(),
            scene.as_os_str(),
            "-o".as_ref(),
            picture.as_os_str(),
            "--trace".as_ref(),
            trace.as_os_str(),
        ])
    };
    for (trace, word) in [("missing/trace.json", "missing is not there"), ("", "it is a folder")] {
        let run = render(&folder.path(trace));
        assert_eq!(run.code, Some(4), "{}", run.stderr);
        assert!(run.sentence().is_ok_and(|line| line.contains(word)), "{}", run.stderr);
        assert!(!folder.path("picture.png").exists(), "it was drawn");
    }
    // A full disk shows only when the trace is there.
    let full = std::path::Path::new("/dev/full");
    if full.exists() && Device::open().is_some() {
        let run = render(full);
        assert_eq!(run.code, Some(4), "{}", run.stderr);
        assert!(run.sentence().is_ok_and(|line| line.contains("No space")), "{}", run.stderr);
    }
    let files = std::fs::read_dir(&folder).expect("a folder").count();
    assert!(files <= 2, "nothing but scene and picture is left");
}

const SCENE: &str = r#"format = 1
[picture]
size = [24, 16]
[[volume]]
name = "shells"
source = { computed = "shells", size = [64, 64, 64] }
spacing = [1.0, 1.0, 1.0]
[[volume.channel]]
window = [0.0, 255.0]
transfer = [{ at = 0.0, color = [1.0, 0.5, 0.0], extinction = 0.0 }, { at = 1.0, color = [1.0, 0.5, 0.0], extinction = 0.5 }]
[[view]]
name = "front"
eye = [32.0, 32.0, -90.0]
target = [32.0, 32.0, 32.0]
up = [0.0, 1.0, 0.0]
fov_degrees = 40
"#;
