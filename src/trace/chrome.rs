//! The file: Chrome's trace event format, a JSON object.
//!
//! # Source
//! Google, "Trace Event Format", 2016.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use serde::Serialize;
use serde_json::{Value, json};

use crate::gpu::RoleKind;
use crate::trace::clip::{Clipped, follow_each_other, nest};
use crate::trace::event::{BrickStep, Counter, Details, Event, Span, Track};
use crate::trace::flows::flows;
use crate::trace::recording::{Filled, ROLES, Trace, queue_index};
use crate::volume::BrickId;

const HOST: u32 = 1;
const DEVICE: u32 = 2;

#[derive(Serialize)]
struct Entry<'a> {
    ph: &'a str,
    name: &'a str,
    pid: u32,
    tid: u32,
    ts: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dur: Option<f64>,
    /// Of flows.
    #[serde(skip_serializing_if = "Option::is_none")]
    cat: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bp: Option<&'a str>,
    /// How far an instant reaches: its thread.
    #[serde(skip_serializing_if = "Option::is_none")]
    s: Option<&'a str>,
    args: Value,
}

/// On the host's first track, with nothing else known.
fn entry<'a>(ph: &'a str, name: &'a str, ts: f64) -> Entry<'a> {
    let (pid, tid) = Track::Host.place();
    Entry {
        ph,
        name,
        pid,
        tid,
        ts,
        dur: None,
        cat: None,
        id: None,
        bp: None,
        s: None,
        args: json!({}),
    }
}

fn args_of_step(id: BrickId, step: BrickStep) -> Value {
    let mut args = json!({ "brick": brick(id) });
    match step {
        BrickStep::Submitted { time_point, bytes } => {
            args["time_point"] = time_point.into();
            args["bytes"] = bytes.into();
        }
        BrickStep::Published(round) | BrickStep::Sampled(round) | BrickStep::Evicted(round) => {
            args["round"] = round.into();
        }
        BrickStep::Wanted | BrickStep::Staged => {}
    }
    args
}

impl Track {
    /// Process and thread in the file.
    fn place(self) -> (u32, u32) {
        match self {
            Track::Host => (HOST, 1),
            Track::Loader(number) => (HOST, 2 + number),
            Track::Queue(role) => (DEVICE, 1 + queue_index(role) as u32),
        }
    }
}

impl Trace {
    /// Writes everything so far as one JSON object.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let filled = self.filled();
        let (tracks, clipped) = tracks_of(&filled);
        writeln!(out, "{{\"displayTimeUnit\":\"ns\",\"otherData\":")?;
        serde_json::to_writer(&mut *out, &self.about(&filled, clipped))?;
        write!(out, ",\"traceEvents\":[")?;
        let mut separator = "\n";
        let mut write = |entry: &Entry| -> io::Result<()> {
            out.write_all(std::mem::replace(&mut separator, ",\n").as_bytes())?;
            serde_json::to_writer(&mut *out, entry)?;
            Ok(())
        };
        for (pid, name) in [(HOST, "host"), (DEVICE, self.gpu.facts().name.as_str())] {
            write(&naming("process_name", pid, 0, name))?;
        }
        let queues = ROLES.iter().map(|role| Track::Queue(*role));
        let loaders = (0..filled.loaders).map(Track::Loader);
        let known: BTreeSet<Track> = tracks.keys().copied().chain(loaders).chain(queues).collect();
        for track in known {
            let (pid, tid) = track.place();
            write(&naming("thread_name", pid, tid, &self.track_name(track)))?;
        }
        for span in tracks.values().flatten() {
            let (pid, tid) = span.track.place();
            let dur = Some(microseconds(span.end_ns - span.begin_ns));
            let (name, ts) = (span.name, microseconds(span.begin_ns));
            write(&Entry { pid, tid, dur, args: args_of(span.details), ..entry("X", name, ts) })?;
        }
        for event in &filled.events {
            match *event {
                Event::Count { counter, at_ns, value } => {
                    let (name, ts) = (counter.name(), microseconds(at_ns));
                    write(&Entry {
                        tid: 0,
                        args: json!({ "value": value }),
                        ..entry("C", name, ts)
                    })?;
                }
                Event::Brick { id, step, at_ns } => {
                    let (name, ts) = (step.name(), microseconds(at_ns));
                    write(&Entry {
                        s: Some("t"),
                        args: args_of_step(id, step),
                        ..entry("i", name, ts)
                    })?;
                }
                Event::Span(_) => {}
            }
        }
        let flows = flows(filled.events.iter(), &tracks);
        for (number, flow) in flows.iter().enumerate().filter(|(_, flow)| flow.places.len() > 1) {
            let last = flow.places.len() - 1;
            for (index, (track, step, at_ns)) in flow.places.iter().enumerate() {
                let ph = if index == 0 {
                    "s"
                } else if index == last {
                    "f"
                } else {
                    "t"
                };
                let (pid, tid) = track.place();
                let mut args = json!({ "finished": flow.finished, "step": step });
                if index == 0 {
                    args["brick"] = brick(flow.brick);
                }
                write(&Entry {
                    pid,
                    tid,
                    cat: Some("brick"),
                    id: Some(number as u64),
                    bp: (index == last).then_some("e"),
                    args,
                    ..entry(ph, "brick", microseconds(*at_ns))
                })?;
            }
        }
        writeln!(out, "\n]}}")
    }

    fn track_name(&self, track: Track) -> String {
        match track {
            Track::Host => "rounds".to_owned(),
            Track::Loader(number) => format!("loader {number}"),
            Track::Queue(role) if self.gpu.has_timestamps(role) => format!("{} queue", role.name()),
            Track::Queue(role) => format!("{} queue: has no timestamps", role.name()),
        }
    }

    fn about(&self, filled: &Filled, clipped: Clipped) -> Value {
        let facts = self.gpu.facts();
        let last = |counter: &Counter| {
            (counter.name().to_owned(), json!(filled.counted[*counter as usize]))
        };
        let counters: serde_json::Map<_, _> = Counter::ALL.iter().map(last).collect();
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "scene": self.options.scene,
            "device": facts.name,
            "driver": facts.driver,
            "roles_share_queue": self.gpu.roles_share_queue(),
            "render_queue_clock": self.clock_text(filled, RoleKind::Render),
            "transfer_queue_clock": self.clock_text(filled, RoleKind::Transfer),
            "rounds": filled.rounds,
            "last_values": counters,
            "reads_under_way": filled.reads_under_way,
            "events_max": self.options.events_max,
            "events_dropped": filled.dropped,
            "spans_clipped": clipped.spans,
            "clipped_us": microseconds(clipped.ns.cast_signed()),
            "clipping": "host and loaders: a span ends with the one it began in; queues: a step \
                         begins when the one before has ended",
        })
    }

    fn clock_text(&self, filled: &Filled, role: RoleKind) -> Value {
        if !self.gpu.has_timestamps(role) {
            return json!({ "kind": "none", "why": "the queue has no timestamps" });
        }
        match filled.clocks[queue_index(role)].report() {
            None => json!({ "kind": "unused", "why": "nothing was measured" }),
            Some(report) => json!({
                "kind": if report.calibrated { "calibrated" } else { "estimated" },
                "by": if report.calibrated {
                    "VK_EXT_calibrated_timestamps"
                } else {
                    "a submit ends when the host sees its time point"
                },
                "error_us": report.error_ns * 1e-3,
            }),
        }
    }
}

/// Spans by track, sorted and clipped.
fn tracks_of(filled: &Filled) -> (BTreeMap<Track, Vec<Span>>, Clipped) {
    let mut tracks: BTreeMap<Track, Vec<Span>> = BTreeMap::new();
    for event in &filled.events {
        if let Event::Span(span) = event {
            tracks.entry(span.track).or_default().push(*span);
        }
    }
    let mut all = Clipped::default();
    for (track, spans) in &mut tracks {
        let clipped = match track {
            Track::Host | Track::Loader(_) => nest(spans),
            Track::Queue(_) => follow_each_other(spans),
        };
        all.spans += clipped.spans;
        all.ns += clipped.ns;
    }
    (tracks, all)
}

fn naming<'a>(what: &'a str, pid: u32, tid: u32, name: &str) -> Entry<'a> {
    Entry { pid, tid, args: json!({ "name": name }), ..entry("M", what, 0.0) }
}

fn microseconds(ns: i64) -> f64 {
    ns as f64 / 1000.0
}

fn args_of(details: Details) -> Value {
    match details {
        Details::None => json!({}),
        Details::Round(round) => json!({ "round": round }),
        Details::Brick(id, bytes) => json!({ "brick": brick(id), "bytes": bytes }),
        Details::Block(first, bricks) => json!({ "first_brick": brick(first), "bricks": bricks }),
        Details::Step { time_point, round } => json!({ "time_point": time_point, "round": round }),
        Details::Copy { time_point, bricks, bytes } => {
            json!({ "time_point": time_point, "bricks": bricks, "bytes": bytes })
        }
    }
}

fn brick(id: BrickId) -> Value {
    let BrickId { volume, channel, level, x, y, z } = id;
    json!({ "volume": volume, "channel": channel, "level": level, "x": x, "y": y, "z": z })
}
