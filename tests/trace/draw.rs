//! Pictures of traces: of made-up ones, whose lanes and places are known, of a real one, and of what is no trace.

use std::path::Path;

use serde_json::{Value, json};

use crate::binary::{Run, ashfall};
use crate::common::drawing::Device;
use crate::folder::Folder;

fn name(pid: u64, tid: u64, name: &str) -> Value {
    json!({ "ph": "M", "name": "thread_name", "pid": pid, "tid": tid, "args": { "name": name } })
}

/// From and to in milliseconds.
fn span((pid, tid): (u64, u64), name: &str, [from, to]: [f64; 2]) -> Value {
    let (ts, dur) = (from * 1e3, (to - from) * 1e3);
    json!({ "ph": "X", "name": name, "pid": pid, "tid": tid, "ts": ts, "dur": dur, "args": {} })
}

fn counter(name: &str, ms: f64, value: u64) -> Value {
    json!({ "ph": "C", "name": name, "pid": 1, "tid": 0, "ts": ms * 1e3, "args": { "value": value } })
}

fn passed(ph: &str, (pid, tid): (u64, u64), step: &str, ms: f64) -> Value {
    let args = json!({ "finished": true, "step": step, "brick": { "channel": 0, "level": 1, "x": 2, "y": 3, "z": 4 } });
    json!({ "ph": ph, "cat": "brick", "name": "brick", "id": 7, "pid": pid, "tid": tid, "ts": ms * 1e3, "args": args })
}

const LOOP: (u64, u64) = (1, 1);
const LOADER: (u64, u64) = (1, 2);
const RENDER: (u64, u64) = (2, 1);

/// Of 1030 ms: a pixel is a millisecond.
fn known() -> Value {
    let events = [
        name(1, 1, "rounds"),
        name(1, 2, "loader 0"),
        name(2, 1, "render queue"),
        name(2, 2, "transfer queue"),
        span(LOOP, "round", [0.0, 1030.0]),
        span(LOOP, "a <bad> & name", [100.0, 300.0]),
        span(LOADER, "read", [50.0, 70.0]),
        span(LOADER, "decode", [70.0, 100.0]),
        span(RENDER, "march_bricks", [400.0, 915.0]),
        counter("bytes uploaded", 10.0, 0),
        counter("bytes uploaded", 500.0, 3 << 20),
        counter("frame time, us", 20.0, 16_000),
        counter("frame target, us", 20.0, 33_000),
        passed("s", LOOP, "wanted", 40.0),
        passed("t", LOADER, "read", 50.0),
        passed("f", LOOP, "published", 250.0),
    ];
    json!({ "otherData": { "scene": "some/where/plant.toml", "device": "a device" }, "traceEvents": events })
}

fn drawn(file: &Path, output: &Path, flags: &[&str]) -> Run {
    let fixed = ["trace".as_ref(), "draw".as_ref(), file.as_os_str()];
    let output = ["-o".as_ref(), output.as_os_str()];
    ashfall(fixed.into_iter().chain(output).chain(flags.iter().map(|flag| flag.as_ref())))
}

/// Every element is closed, none holds what would end it early.
fn is_well_formed(svg: &str) -> bool {
    let mut open = Vec::new();
    for piece in svg.split('<').skip(1) {
        let Some((tag, _)) = piece.split_once('>') else { return false };
        match tag.strip_prefix('/') {
            Some(name) => {
                if open.pop() != Some(name) {
                    return false;
                }
            }
            None if tag.ends_with('/') => {}
            None => open.push(tag.split_whitespace().next().unwrap_or("")),
        }
    }
    open.is_empty()
        && svg.matches('&').count()
            == svg.matches("&amp;").count()
                + svg.matches("&lt;").count()
                + svg.matches("&gt;").count()
}

#[test]
fn a_known_trace_has_known_lanes_and_places() {
    let folder = Folder::new("draw");
    let file = folder.write("trace.json", known().to_string());
    let output = folder.path("timeline.svg");
    let run = drawn(&file, &output, &[]);
    assert_eq!((run.code, &*run.stdout), (Some(0), ""), "{}", run.stderr);
    let svg = std::fs::read_to_string(&output).expect("a picture");
    assert!(is_well_formed(&svg), "{svg}");
    for words in [
        ">plant.toml on a device<",
        ">rounds<",
        ">loader 0<",
        ">render queue<",
        ">transfer queue<",
        ">busy 50.0 %<",
        ">a &lt;bad&gt; &amp; name<",
        ">bytes uploaded<",
        ">3.0 MiB<",
        ">frame time<",
        ">33.0 ms<",
        ">target<",
        "slowest brick, flow 7 (channel 0, level 1, 2 3 4) · 1 wanted 40.0 ms · 2 read +10.0 · 3 published +210.0",
    ] {
        assert!(svg.contains(words), "{words}: {svg}");
    }
    assert!(!svg.contains("rays waiting"), "a counter that is not there");
    // The left end lies at 132; the two last lanes are one row each.
    let starts = |x: &str, wide: &str| {
        svg.lines()
            .any(|line| line.contains(&format!("M{x} ")) && line.contains(&format!("h{wide}v")))
    };
    for (x, wide) in
        [("132.0", "1029.4"), ("232.0", "199.4"), ("182.0", "19.4"), ("532.0", "514.4")]
    {
        assert!(starts(x, wide), "{x} {wide}: {svg}");
    }
    // A window of a tenth: ten pixels a millisecond.
    let run = drawn(&file, &output, &["--from", "40", "--to", "143"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let svg = std::fs::read_to_string(&output).expect("a picture");
    assert!(svg.contains("M232.0 ") && svg.contains("h199.4v"), "{svg}");
    assert!(!svg.contains("slowest brick"), "it was published later");
    let run = drawn(&file, &output, &["--from", "40", "--to", "143", "--brick", "7"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let svg = std::fs::read_to_string(&output).expect("a picture");
    assert!(svg.contains("brick, flow 7") && !svg.contains("slowest"), "{svg}");
    assert_eq!(folder.names().len(), 2, "nothing else is left");
}

#[test]
fn a_picture_is_bounded_whatever_the_trace() {
    let folder = Folder::new("draw-bounds");
    let mut events = vec![name(1, 1, "rounds")];
    for number in 0..60_000u64 {
        let at = number as f64 * 0.01;
        let track = (1, 1 + number % 60);
        events.push(span(track, &format!("name {}", number % 3000), [at, at + 0.004]));
        events.push(counter("rays waiting", at, number * 7 % 1000));
    }
    // Nested as deep as there are, and as long as can be.
    events.extend((0..2000).map(|depth| span(LOOP, "deep", [-f64::from(depth), 1e6])));
    let file = folder.write("trace.json", json!({ "traceEvents": events }).to_string());
    let output = folder.path("timeline.svg");
    for window in [&[][..], &["--from", "0", "--to", "600"]] {
        let run = drawn(&file, &output, window);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let svg = std::fs::read_to_string(&output).expect("a picture");
        assert!(is_well_formed(&svg));
        assert!(svg.len() < 2_000_000, "{} bytes", svg.len());
        assert!(svg.contains("20 more tracks are not drawn") && svg.contains(">others<"));
    }
}

#[test]
fn what_cannot_be_drawn_is_one_sentence() {
    let folder = Folder::new("draw-refused");
    let good = folder.write("good.json", known().to_string());
    let svg = folder.path("timeline.svg");
    let refused = |file: &Path, output: &Path, flags: &[&str], code: i32, words: &str| {
        let run = drawn(file, output, flags);
        assert_eq!(run.code, Some(code), "{words}: {}", run.stderr);
        assert!(run.sentence().is_ok_and(|line| line.contains(words)), "{words}: {}", run.stderr);
        assert!(!output.exists(), "{words}: it was drawn");
    };
    for (bytes, words) in [
        ("", "is no JSON"),
        ("{", "is no JSON"),
        ("[]", "has no traceEvents"),
        ("{\"traceEvents\":{}}", "has no traceEvents"),
        ("{\"traceEvents\":[]}", "has no spans"),
        ("{\"traceEvents\":[7,null,\"a\",[]]}", "has no spans"),
        (
            "{\"traceEvents\":[{\"ph\":\"C\",\"name\":\"rays waiting\",\"ts\":1,\"args\":{\"value\":1}}]}",
            "has no spans",
        ),
        ("{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\"}]}", "has no time in event 0"),
        (
            "{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\",\"ts\":\"1\"}]}",
            "has no time in event 0",
        ),
        (
            "{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\",\"ts\":1e300}]}",
            "beyond 30 years in event 0",
        ),
        ("{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\",\"ts\":1e999}]}", "is no JSON"),
    ] {
        let bad = folder.write("bad.json", bytes);
        refused(&bad, &svg, &[], 3, words);
    }
    refused(&folder.path("missing.json"), &svg, &[], 3, "cannot be read");
    refused(&good, &folder.path("timeline.png"), &[], 2, "ends in .svg");
    refused(&good, &folder.path("none/timeline.svg"), &[], 4, "is not there");
    refused(&good, &svg, &["--from", "2000"], 2, "nothing lies from 2000.000 to 1030.000 ms");
    refused(&good, &svg, &["--from", "20", "--to", "10"], 2, "nothing lies");
    refused(&good, &svg, &["--brick", "8"], 2, "has no brick 8");
    refused(&good, &svg, &["--brick", "7", "--from", "300"], 2, "from 40.000 to 250.000 ms");
    for flags in [["--from", "NaN"], ["--to", "inf"], ["--from", "soon"], ["--brick", "-1"]] {
        let run = drawn(&good, &svg, &flags);
        assert_eq!(run.code, Some(2), "{flags:?}: {}", run.stderr);
    }
    // What is odd and can be drawn, is.
    for bytes in [
        "{\"traceEvents\":[{\"ph\":\"X\",\"ts\":5}]}",
        "{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\\u0000\\u001b<\",\"ts\":-1e15,\"dur\":1e300}]}",
        "{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\",\"ts\":1,\"dur\":-7},{\"ph\":\"s\",\"cat\":\"brick\",\"id\":1,\"ts\":1}]}",
        "{\"traceEvents\":[{\"ph\":\"X\",\"name\":\"a\",\"ts\":1},{\"ph\":\"C\",\"name\":\"bricks bound\",\"ts\":1,\"args\":{\"value\":-1e308}}]}",
    ] {
        let odd = folder.write("odd.json", bytes);
        let run = drawn(&odd, &svg, &[]);
        assert_eq!(run.code, Some(0), "{bytes}: {}", run.stderr);
        let drawn = std::fs::read_to_string(&svg).expect("a picture");
        assert!(
            is_well_formed(&drawn) && !drawn.contains("NaN") && !drawn.contains("inf"),
            "{drawn}"
        );
    }
}

#[test]
fn a_trace_of_a_drawing_is_drawn() {
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("draw-real");
    let scene = folder.write("scene.toml", crate::SCENE);
    let (trace, picture) = (folder.path("trace.json"), folder.path("picture.png"));
    let run = ashfall([
        "render".as_ref(),
        scene.as_os_str(),
        "-o".as_ref(),
        picture.as_os_str(),
        "--trace".as_ref(),
        trace.as_os_str(),
        "--addressing".as_ref(),
        "paged".as_ref(),
    ]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let output = folder.path("timeline.svg");
    let run = drawn(&trace, &output, &[]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let svg = std::fs::read_to_string(&output).expect("a picture");
    assert!(is_well_formed(&svg));
    for words in [
        "scene.toml on ",
        "loader 0",
        "render queue",
        "transfer queue",
        "slowest brick",
        "march_bricks",
        "bricks bound",
        "rays waiting",
    ] {
        assert!(svg.contains(words), "{words}");
    }
}
