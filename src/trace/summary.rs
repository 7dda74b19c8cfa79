//! What a trace says in numbers: how busy queues were, how much of the copies' time rendering hid, who waited for
//! whom, and how long bricks were on their way.
//!
//! # Definitions
//! - *Busy*: the time in which at least one step of a queue ran.
//! - *Overlap*: the part of the transfer queue's busy time in which the render queue was busy, too. 1 is the goal: then
//!   rendering hid all of it.
//! - *Stalls*: the host waits for the device ("wait"), for something to come from the loaders ("load"), for a staging
//!   half that a copy still reads ("wait for half"); a loader is idle while none of its reads runs.
//! - *Wasted*: bricks published that no ray went through before they went, or the trace ended.
//! - *Reload factor*: bricks published over distinct bricks published.

use std::collections::{BTreeMap, HashMap, HashSet};

use serde::Serialize;
use serde_json::Value;

/// See the module. Times are milliseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// From the first span's beginning to the last one's end.
    pub wall_ms: f64,
    /// Rounds of the paging loop.
    pub rounds: u64,
    /// Events that the trace had no room for.
    pub events_dropped: u64,
    /// Render and transfer are one queue: nothing can lie beside the other.
    pub roles_share_queue: bool,
    /// By queue: busy, and its part of the wall's time; nothing for one without timestamps.
    pub queues: Vec<Busy>,
    /// Part of the copies' time that lay beside rendering; nothing where nothing was copied or timed.
    pub overlap: Option<f64>,
    /// Who waited, the longest first.
    pub stalls: Vec<Stall>,
    /// Rounds: the middle one, the 95th and 99th of 100, and the worst.
    pub round_ms: Percentiles,
    /// From being wanted to being published.
    pub wanted_to_published_ms: Percentiles,
    /// From being wanted to the end of the round in which a ray went through first.
    pub wanted_to_sampled_ms: Percentiles,
    /// Bricks published.
    pub bricks_published: u64,
    /// Of them, distinct ones.
    pub bricks_distinct: u64,
    /// Published over distinct.
    pub reload_factor: f64,
    /// Bricks that no ray went through.
    pub bricks_wasted: u64,
    /// Texel bytes copied.
    pub bytes_copied: u64,
    /// Of them, those of bricks that no ray went through, taken as a mean brick's.
    pub bytes_wasted: u64,
    /// Bytes copied by a round, on average.
    pub bytes_per_round: f64,
    /// The bricks that took longest from being wanted to being published.
    pub slowest: Vec<SlowBrick>,
}

/// A queue's work.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Busy {
    /// Its name.
    pub queue: String,
    /// Time in which it worked.
    pub ms: f64,
    /// As a part of the wall's.
    pub part: f64,
    /// Steps.
    pub steps: u64,
}

/// Time that somebody waited.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stall {
    /// Who waited for what.
    pub cause: String,
    /// All together.
    pub ms: f64,
    /// How often.
    pub count: u64,
    /// The longest.
    pub worst_ms: f64,
}

/// Of so many values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Values.
    pub count: u64,
    /// The middle one.
    pub median: f64,
    /// The 95th of 100.
    pub p95: f64,
    /// The 99th of 100.
    pub p99: f64,
    /// The greatest.
    pub worst: f64,
}

/// One that was slow.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlowBrick {
    /// As the trace names it.
    pub brick: Value,
    /// From being wanted to being published.
    pub ms: f64,
}

/// Slowest bricks that are named.
const SLOWEST: usize = 5;
/// Spans of the host that are stalls, and what they are waits for.
const STALLS: [(&str, &str); 3] = [
    ("wait", "host for the device"),
    ("load", "rendering for bricks"),
    ("wait for half", "transfer for a staging half"),
];

/// Spans, instants and names of a trace's file.
#[derive(Default)]
struct Read<'a> {
    /// `[track]` its spans: name, times.
    tracks: BTreeMap<String, Vec<(&'a str, [f64; 2])>>,
    /// Name of a brick's step, the brick, when.
    steps: Vec<(&'a str, &'a Value, f64)>,
    bytes_copied: u64,
}

impl Summary {
    /// Of a trace's file as JSON.
    ///
    /// # Errors
    /// What keeps it from being one of ours, as the end of a sentence.
    pub fn of(file: &Value) -> Result<Summary, String> {
        let events = file["traceEvents"].as_array().ok_or("has no traceEvents")?;
        let read = Read::of(events)?;
        let spans = || read.tracks.values().flatten().map(|(_, times)| *times);
        let begin = spans().map(|[begin, _]| begin).fold(f64::INFINITY, f64::min);
        let end = spans().map(|[_, end]| end).fold(f64::NEG_INFINITY, f64::max);
        if begin > end {
            return Err("has no spans".to_owned());
        }
        let wall_ms = (end - begin) * 1e-3;
        let queue = |name: &str| read.tracks.iter().find(|(track, _)| track.starts_with(name));
        let busy = |name: &str| -> Option<(Busy, Vec<[f64; 2]>)> {
            let (track, spans) = queue(name)?;
            let joined = joined(spans.iter().map(|(_, times)| *times).collect());
            let ms = length(&joined) * 1e-3;
            let steps = spans.len() as u64;
            Some((Busy { queue: track.clone(), ms, part: ms / wall_ms.max(1e-9), steps }, joined))
        };
        let (render, transfer) = (busy("render queue"), busy("transfer queue"));
        let overlap = match (&render, &transfer) {
            (Some((_, rays)), Some((_, copies))) => overlap(copies, rays),
            _ => None,
        };
        let mut summary = Summary {
            wall_ms,
            events_dropped: file["otherData"]["events_dropped"].as_u64().unwrap_or(0),
            roles_share_queue: file["otherData"]["roles_share_queue"] == true,
            queues: [render, transfer].into_iter().flatten().map(|(busy, _)| busy).collect(),
            overlap,
            stalls: read.stalls(),
            bytes_copied: read.bytes_copied,
            ..Summary::default()
        };
        let rounds: Vec<f64> =
            read.host("round").map(|[begin, end]| (end - begin) * 1e-3).collect();
        summary.rounds = rounds.len() as u64;
        summary.round_ms = Percentiles::of(rounds);
        summary.bytes_per_round = summary.bytes_copied as f64 / summary.rounds.max(1) as f64;
        summary.follow_bricks(&read.steps);
        Ok(summary)
    }

    fn follow_bricks(&mut self, steps: &[(&str, &Value, f64)]) {
        // By the text of the brick: when it was wanted, whether it is there and was sampled.
        let mut wanted: HashMap<String, f64> = HashMap::new();
        let mut there: HashMap<String, bool> = HashMap::new();
        let mut distinct = HashSet::new();
        let (mut to_published, mut to_sampled) = (Vec::new(), Vec::new());
        for (name, brick, at) in steps {
            let key = brick.to_string();
            match *name {
                "wanted" => _ = wanted.insert(key, *at),
                "published" => {
                    self.bricks_published += 1;
                    distinct.insert(key.clone());
                    if let Some(since) = wanted.get(&key) {
                        let ms = (at - since) * 1e-3;
                        to_published.push(ms);
                        self.slowest.push(SlowBrick { brick: (*brick).clone(), ms });
                    }
                    // Its place was never given to another: it came again for another reason.
                    if there.insert(key, false) == Some(false) {
                        self.bricks_wasted += 1;
                    }
                }
                "sampled" if there.get(&key) == Some(&false) => {
                    to_sampled.extend(wanted.get(&key).map(|since| (at - since) * 1e-3));
                    there.insert(key, true);
                }
                "evicted" => self.bricks_wasted += u64::from(there.remove(&key) == Some(false)),
                _ => {}
            }
        }
        self.bricks_wasted += there.values().filter(|sampled| !**sampled).count() as u64;
        self.bricks_distinct = distinct.len() as u64;
        self.reload_factor = self.bricks_published as f64 / self.bricks_distinct.max(1) as f64;
        let mean = self.bytes_copied as f64 / self.bricks_published.max(1) as f64;
        self.bytes_wasted = (mean * self.bricks_wasted as f64).round() as u64;
        self.wanted_to_published_ms = Percentiles::of(to_published);
        self.wanted_to_sampled_ms = Percentiles::of(to_sampled);
        self.slowest.sort_by(|a, b| b.ms.total_cmp(&a.ms));
        self.slowest.truncate(SLOWEST);
    }
}

impl<'a> Read<'a> {
    fn of(events: &'a [Value]) -> Result<Read<'a>, String> {
        let place = |event: &Value| (event["pid"].as_u64(), event["tid"].as_u64());
        let named = events.iter().filter(|event| event["name"] == "thread_name");
        let names: HashMap<_, _> = named
            .map(|event| (place(event), event["args"]["name"].as_str().unwrap_or("?")))
            .collect();
        let mut read = Read::default();
        // A queue without a step is there all the same, if it can be timed.
        for name in names.values().filter(|name| name.ends_with(" queue")) {
            read.tracks.entry((*name).to_owned()).or_default();
        }
        for (number, event) in events.iter().enumerate() {
            let at = || event["ts"].as_f64().ok_or(format!("has no time in event {number}"));
            let name = event["name"].as_str().unwrap_or("?");
            match event["ph"].as_str() {
                Some("X") => {
                    let begin = at()?;
                    let track = names.get(&place(event)).copied().unwrap_or("?");
                    let end = begin + event["dur"].as_f64().unwrap_or(0.0).max(0.0);
                    read.tracks.entry(track.to_owned()).or_default().push((name, [begin, end]));
                    if track.starts_with("transfer queue") {
                        read.bytes_copied += event["args"]["bytes"].as_u64().unwrap_or(0);
                    }
                }
                Some("i") => read.steps.push((name, &event["args"]["brick"], at()?)),
                _ => {}
            }
        }
        read.steps.sort_by(|a, b| a.2.total_cmp(&b.2));
        Ok(read)
    }

    /// Spans of this name of the thread that runs the loop.
    fn host(&self, name: &'a str) -> impl Iterator<Item = [f64; 2]> {
        let of_host = self.tracks.get("rounds").into_iter().flatten();
        of_host.filter(move |(known, _)| *known == name).map(|(_, times)| *times)
    }

    fn stalls(&self) -> Vec<Stall> {
        let mut stalls = Vec::new();
        let mut add = |cause: &str, waits: Vec<f64>| {
            if !waits.is_empty() {
                stalls.push(Stall {
                    cause: cause.to_owned(),
                    ms: waits.iter().sum(),
                    count: waits.len() as u64,
                    worst_ms: waits.iter().copied().fold(0.0, f64::max),
                });
            }
        };
        for (name, cause) in STALLS {
            add(cause, self.host(name).map(|[begin, end]| (end - begin) * 1e-3).collect());
        }
        // Between two reads of one loader.
        let loaders = self.tracks.iter().filter(|(track, _)| track.starts_with("loader"));
        let idle = loaders.flat_map(|(_, spans)| {
            let joined = joined(spans.iter().map(|(_, times)| *times).collect());
            let gaps: Vec<f64> =
                joined.windows(2).map(|pair| (pair[1][0] - pair[0][1]) * 1e-3).collect();
            gaps
        });
        add("loaders for wishes", idle.collect());
        stalls.sort_by(|a, b| b.ms.total_cmp(&a.ms));
        stalls
    }
}

impl Percentiles {
    fn of(mut values: Vec<f64>) -> Percentiles {
        values.sort_by(f64::total_cmp);
        let last = values.len().saturating_sub(1);
        let of = |part: f64| values.get((last as f64 * part).round() as usize).copied();
        Percentiles {
            count: values.len() as u64,
            median: of(0.5).unwrap_or(0.0),
            p95: of(0.95).unwrap_or(0.0),
            p99: of(0.99).unwrap_or(0.0),
            worst: of(1.0).unwrap_or(0.0),
        }
    }
}

/// Of the time in which one queue copied, the part in which the other was busy, too; nothing where it copied nothing.
/// Both as [`joined`] gives them.
pub fn overlap(copies: &[[f64; 2]], rays: &[[f64; 2]]) -> Option<f64> {
    let both = |copy: &[f64; 2]| -> f64 {
        rays.iter().map(|ray| (copy[1].min(ray[1]) - copy[0].max(ray[0])).max(0.0)).sum()
    };
    let all = length(copies);
    (all > 0.0).then(|| copies.iter().map(both).sum::<f64>() / all)
}

/// The same times, sorted, without overlaps among themselves.
pub fn joined(mut times: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    times.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for [begin, end] in times {
        match joined.last_mut().filter(|last| last[1] >= begin) {
            Some(last) => last[1] = last[1].max(end),
            None => joined.push([begin, end]),
        }
    }
    joined
}

/// Of times without overlaps.
fn length(times: &[[f64; 2]]) -> f64 {
    times.iter().map(|[begin, end]| end - begin).sum()
}
