//! Summaries of traces that were made up, whose numbers are known, and of one that was recorded.

use std::path::Path;

use ashfall::trace::summary::Summary;
use serde_json::{Value, json};

use crate::binary::ashfall;
use crate::folder::Folder;

/// Tracks: the loop, a loader, both queues.
fn names() -> Vec<Value> {
    let name = |pid: u64, tid: u64, name: &str| json!({ "ph": "M", "name": "thread_name", "pid": pid, "tid": tid, "ts": 0, "args": { "name": name } });
    vec![
        name(1, 1, "rounds"),
        name(1, 2, "loader 0"),
        name(2, 1, "render queue"),
        name(2, 2, "transfer queue"),
    ]
}

/// From and to in milliseconds.
fn span((pid, tid): (u64, u64), name: &str, [from, to]: [f64; 2], bytes: u64) -> Value {
    let (ts, dur) = (from * 1e3, (to - from) * 1e3);
    json!({ "ph": "X", "name": name, "pid": pid, "tid": tid, "ts": ts, "dur": dur, "args": { "bytes": bytes } })
}

fn step(name: &str, brick: u64, ms: f64) -> Value {
    let args = json!({ "brick": { "x": brick } });
    json!({ "ph": "i", "s": "t", "name": name, "pid": 1, "tid": 1, "ts": ms * 1e3, "args": args })
}

fn file(events: &[Value]) -> Value {
    let events = [&names()[..], events].concat();
    json!({ "otherData": { "events_dropped": 3 }, "traceEvents": events })
}

const LOOP: (u64, u64) = (1, 1);
const LOADER: (u64, u64) = (1, 2);
const RENDER: (u64, u64) = (2, 1);
const TRANSFER: (u64, u64) = (2, 2);

/// Hundred milliseconds: rays for 40, copies for 20, of which 15 beside rays; waits of 30, 10 and 5; three bricks,
/// one of them twice and one for nothing.
fn known() -> Value {
    file(&[
        span(LOOP, "round", [0.0, 60.0], 0),
        span(LOOP, "wait", [10.0, 40.0], 0),
        span(LOOP, "wait for half", [40.0, 45.0], 0),
        span(LOOP, "round", [60.0, 100.0], 0),
        span(LOOP, "load", [80.0, 90.0], 0),
        span(RENDER, "march_bricks", [10.0, 35.0], 0),
        span(RENDER, "tally", [35.0, 40.0], 0),
        span(RENDER, "march_bricks", [70.0, 80.0], 0),
        // Ten beside rays, five of five beside, none of five.
        span(TRANSFER, "copy", [30.0, 40.0], 3000),
        span(TRANSFER, "copy", [75.0, 80.0], 600),
        span(TRANSFER, "copy", [90.0, 95.0], 400),
        span(LOADER, "read", [5.0, 10.0], 0),
        span(LOADER, "read", [12.0, 20.0], 0),
        step("wanted", 1, 1.0),
        step("wanted", 2, 2.0),
        step("published", 1, 41.0),
        step("published", 2, 42.0),
        step("sampled", 1, 60.0),
        step("evicted", 1, 61.0),
        step("wanted", 3, 62.0),
        step("wanted", 1, 63.0),
        step("published", 3, 82.0),
        step("published", 1, 93.0),
        step("sampled", 1, 99.0),
        step("sampled", 3, 99.0),
    ])
}

#[test]
fn known_overlap_stalls_and_waste_are_found() {
    let summary = Summary::of(&known()).expect("a trace");
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    near(summary.wall_ms, 100.0);
    assert_eq!((summary.rounds, summary.events_dropped), (2, 3));
    near(summary.round_ms.worst, 60.0);
    let busy: Vec<_> = summary.queues.iter().map(|of| (&*of.queue, of.ms, of.steps)).collect();
    assert_eq!(busy, [("render queue", 40.0, 3), ("transfer queue", 20.0, 3)]);
    near(summary.queues[0].part, 0.4);
    near(summary.overlap.expect("copies"), 0.75);
    let stalls: Vec<_> =
        summary.stalls.iter().map(|stall| (&*stall.cause, stall.ms, stall.count)).collect();
    assert_eq!(
        stalls,
        [
            ("loaders after their last wish", 80.0, 1),
            ("host for the device", 30.0, 1),
            ("rendering for bricks", 10.0, 1),
            ("transfer for a staging half", 5.0, 1),
            ("loaders for their first wish", 5.0, 1),
            ("loaders for wishes", 2.0, 1),
        ]
    );
    assert_eq!((summary.bricks_published, summary.bricks_distinct), (4, 3));
    near(summary.reload_factor, 4.0 / 3.0);
    assert_eq!(summary.bricks_wasted, 1, "the second was never sampled");
    assert_eq!((summary.bytes_copied, summary.bytes_wasted), (4000, 1000), "a mean brick's");
    assert_eq!(summary.bytes_wasted_guessed, 1);
    near(summary.bytes_per_round, 2000.0);
    // 40, 40, 20, 30 from wanted to published; 59, 36 and 37 to sampled.
    near(summary.wanted_to_published_ms.median, 40.0);
    near(summary.wanted_to_published_ms.worst, 40.0);
    assert_eq!(summary.wanted_to_published_ms.count, 4);
    near(summary.wanted_to_sampled_ms.worst, 59.0);
    near(summary.wanted_to_sampled_ms.median, 37.0);
    assert_eq!(summary.slowest.len(), 4);
    near(summary.slowest[3].ms, 20.0);
}

fn submitted(brick: u64, ms: f64, bytes: u64) -> Value {
    let mut step = step("submitted", brick, ms);
    step["args"]["bytes"] = bytes.into();
    step
}

/// Each wasted brick counts with what was copied for it, the last time that it came.
#[test]
fn wasted_bytes_are_those_of_the_wasted_bricks() {
    let summary = Summary::of(&file(&[
        span(LOOP, "round", [0.0, 100.0], 0),
        span(TRANSFER, "copy", [10.0, 20.0], 1000),
        submitted(1, 5.0, 700),
        submitted(2, 5.0, 250),
        submitted(3, 5.0, 50),
        step("published", 1, 21.0),
        step("published", 2, 21.0),
        step("published", 3, 21.0),
        step("sampled", 1, 30.0),
        step("evicted", 2, 40.0),
        // Smaller when it came again; then the trace ends.
        submitted(2, 50.0, 30),
        step("published", 2, 51.0),
    ]))
    .expect("a trace");
    assert_eq!((summary.bricks_published, summary.bricks_wasted), (4, 3));
    assert_eq!((summary.bytes_wasted, summary.bytes_wasted_guessed), (250 + 50 + 30, 0));
}

/// Who waited for whom, one made-up trace for each cause, and how long.
#[test]
fn each_cause_of_a_stall_is_told_by_its_name() {
    let round = || span(LOOP, "round", [0.0, 100.0], 0);
    let busy = || span(LOADER, "read", [0.0, 100.0], 0);
    // As the file has them: 0.7 and 0.1 are less than 0.8.
    let read = |ts: f64, dur: f64| json!({ "ph": "X", "name": "read", "pid": 1, "tid": 2, "ts": ts, "dur": dur });
    let cases = [
        ("host for the device", vec![span(LOOP, "wait", [10.0, 50.0], 0), busy()], [40.0, 1.0]),
        ("rendering for bricks", vec![span(LOOP, "load", [10.0, 50.0], 0), busy()], [40.0, 1.0]),
        (
            "transfer for a staging half",
            vec![
                span(LOOP, "wait for half", [10.0, 20.0], 0),
                span(LOOP, "wait for half", [30.0, 60.0], 0),
                busy(),
            ],
            [40.0, 2.0],
        ),
        // Two loaders at once count once; what comes before the first step and after the last one is not between.
        (
            "rendering for loaders",
            vec![
                busy(),
                span((1, 3), "read", [0.0, 100.0], 0),
                span(RENDER, "march_bricks", [10.0, 30.0], 0),
                span(RENDER, "march_bricks", [70.0, 90.0], 0),
            ],
            [40.0, 1.0],
        ),
        // What a loader does part by part is no pause, nor is the rounding of its times.
        (
            "loaders for wishes",
            vec![
                read(0.0, 0.7),
                read(0.7, 0.1),
                read(0.8, 10_099.2),
                span(LOADER, "decode", [10.1, 20.2], 0),
                span(LOADER, "inspect", [20.2, 30.3], 0),
                span(LOADER, "survey", [70.3, 80.0], 0),
                span(LOADER, "read", [80.0, 100.0], 0),
            ],
            [40.0, 1.0],
        ),
        ("loaders for their first wish", vec![span(LOADER, "read", [40.0, 100.0], 0)], [40.0, 1.0]),
        ("loaders after their last wish", vec![span(LOADER, "read", [0.0, 60.0], 0)], [40.0, 1.0]),
    ];
    for (cause, events, [ms, count]) in cases {
        let other = json!({ "ph": "M", "name": "thread_name", "pid": 1, "tid": 3, "args": { "name": "loader 1" } });
        let two = events.iter().any(|event| event["tid"] == 3);
        let other = if two { &[other][..] } else { &[] };
        let events = [&[round()], &events[..], other].concat();
        let summary = Summary::of(&file(&events)).expect("a trace");
        let [stall] = &summary.stalls[..] else { panic!("{cause}: {:?}", summary.stalls) };
        assert_eq!((&*stall.cause, stall.count as f64), (cause, count));
        assert!((stall.ms - ms).abs() < 1e-6, "{cause}: {} ms", stall.ms);
    }
    // A loader that never had a wish waited for its first all along.
    let idle = Summary::of(&file(&[round()])).expect("a trace");
    assert_eq!(idle.stalls.len(), 1);
    let stall = &idle.stalls[0];
    assert_eq!((&*stall.cause, stall.ms), ("loaders for their first wish", 100.0));
}

#[test]
fn queues_without_times_have_no_overlap() {
    let summary = Summary::of(&file(&[span(LOOP, "round", [0.0, 1.0], 0)])).expect("a trace");
    assert_eq!(summary.overlap, None);
    let rays = [span(LOOP, "round", [0.0, 9.0], 0), span(RENDER, "cast", [1.0, 2.0], 0)];
    assert_eq!(Summary::of(&file(&rays)).expect("a trace").overlap, None, "nothing was copied");
}

#[test]
fn the_command_says_it_in_words_and_in_json() {
    let folder = Folder::new("summary");
    let path = folder.write("trace.json", known().to_string());
    let run = |arguments: &[&Path]| {
        ashfall(["trace".as_ref()].into_iter().chain(arguments.iter().copied()))
    };
    let text = run(&["summary".as_ref(), &path]);
    assert_eq!(text.code, Some(0), "{}", text.stderr);
    for words in ["75.0 %", "host for the device", "4 bricks", "1.33", "render queue"] {
        assert!(text.stdout.contains(words), "{words}: {}", text.stdout);
    }
    let json = run(&["summary".as_ref(), &path, "--json".as_ref()]);
    let value: Value = serde_json::from_str(&json.stdout).expect("JSON");
    assert_eq!((&value["format"], &value["overlap"]), (&json!(1), &json!(0.75)));
    let both = run(&["compare".as_ref(), &path, &path]);
    assert_eq!(both.code, Some(0), "{}", both.stderr);
    assert!(both.stdout.contains("1.00"), "{}", both.stdout);
    for (bytes, words) in [
        ("{}", "has no traceEvents"),
        ("not JSON", "is no JSON"),
        ("{\"traceEvents\":[]}", "has no spans"),
    ] {
        let bad = folder.write("bad.json", bytes);
        let run = run(&["summary".as_ref(), &bad]);
        assert_eq!(run.code, Some(3), "{}", run.stderr);
        assert!(run.sentence().is_ok_and(|line| line.contains(words)), "{}", run.stderr);
    }
}
