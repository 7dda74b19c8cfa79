//! What a trace says in numbers: how busy queues were, how much of the copies' time rendering hid, who waited for
//! whom, and how long bricks were on their way.
//!
//! # Definitions
//! - *Busy*: the time in which at least one step of a queue ran.
//! - *Overlap*: the part of the transfer queue's busy time in which the render queue was busy, too. 1 is the goal: then
//!   rendering hid all of it.
//! - *Stalls*: the host waits for the device ("wait"), for something to come from the loaders ("load"), for a staging
//!   half that a copy still reads ("wait for half"); a loader is idle while it neither reads, decodes, inspects nor
//!   surveys: between two jobs, before the first one (from the trace's first span on), and after the last one.
//!   Rendering waits for loaders while its queue is idle, between two of its steps, and a loader is not.
//! - *Wasted*: bricks published that no ray went through before they went, or the trace ended. Their bytes are what
//!   was copied for each of them.
//! - *Reload factor*: bricks published over distinct bricks published.

use std::collections::{HashMap, HashSet};

use serde::Serialize;
use serde_json::Value;

use crate::trace::reading::{Recorded, SAME_US, Slice, Step, Track};

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
    /// Of them, those of bricks that no ray went through.
    pub bytes_wasted: u64,
    /// Wasted bricks whose bytes the trace does not tell: taken as a mean brick's.
    pub bytes_wasted_guessed: u64,
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

impl Summary {
    /// Of a trace's file as JSON.
    ///
    /// # Errors
    /// What keeps it from being one of ours, as the end of a sentence.
    pub fn of(file: &Value) -> Result<Summary, String> {
        let read = Recorded::of(file)?;
        let [begin_us, end_us] = read.wall_us();
        let wall_ms = (end_us - begin_us) * 1e-3;
        let busy = |name: &str| -> Option<(Busy, Vec<[f64; 2]>)> {
            let track = read.tracks.values().find(|track| track.name.starts_with(name))?;
            let joined = busy_us(&track.slices);
            let ms = length(&joined) * 1e-3;
            let (queue, steps) = (track.name.to_owned(), track.slices.len() as u64);
            Some((Busy { queue, ms, part: ms / wall_ms.max(1e-9), steps }, joined))
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
            stalls: stalls(&read),
            bytes_copied: read.bytes_copied,
            ..Summary::default()
        };
        let rounds = host_ms(&read, "round");
        summary.rounds = rounds.len() as u64;
        summary.round_ms = Percentiles::of(rounds);
        summary.bytes_per_round = summary.bytes_copied as f64 / summary.rounds.max(1) as f64;
        summary.follow_bricks(&read.steps);
        Ok(summary)
    }

    fn follow_bricks(&mut self, steps: &[Step]) {
        // By the text of the brick: when it was wanted, the bytes copied for it, whether it is there and was sampled.
        let mut wanted: HashMap<String, f64> = HashMap::new();
        let mut copied: HashMap<String, u64> = HashMap::new();
        let mut there: HashMap<String, Resident> = HashMap::new();
        let mut distinct = HashSet::new();
        let (mut to_published, mut to_sampled) = (Vec::new(), Vec::new());
        for Step { name, brick, at_us, bytes } in steps {
            let key = brick.to_string();
            let ms_since = |since: &f64| (at_us - since) * 1e-3;
            match *name {
                "wanted" => _ = wanted.insert(key, *at_us),
                "submitted" => _ = bytes.map(|bytes| copied.insert(key, bytes)),
                "published" => {
                    self.bricks_published += 1;
                    distinct.insert(key.clone());
                    if let Some(ms) = wanted.get(&key).map(ms_since) {
                        to_published.push(ms);
                        self.slowest.push(SlowBrick { brick: (*brick).clone(), ms });
                    }
                    let now = Resident { bytes: copied.remove(&key), sampled: false };
                    // Its place was never given to another: it came again for another reason.
                    self.count_waste(there.insert(key, now));
                }
                "sampled" => {
                    if let Some(known) = there.get_mut(&key).filter(|known| !known.sampled) {
                        to_sampled.extend(wanted.get(&key).map(ms_since));
                        known.sampled = true;
                    }
                }
                "evicted" => self.count_waste(there.remove(&key)),
                _ => {}
            }
        }
        there.into_values().for_each(|left| self.count_waste(Some(left)));
        self.bricks_distinct = distinct.len() as u64;
        self.reload_factor = self.bricks_published as f64 / self.bricks_distinct.max(1) as f64;
        let mean = self.bytes_copied as f64 / self.bricks_published.max(1) as f64;
        let guessed = (mean * self.bytes_wasted_guessed as f64).round() as u64;
        self.bytes_wasted = self.bytes_wasted.saturating_add(guessed);
        self.wanted_to_published_ms = Percentiles::of(to_published);
        self.wanted_to_sampled_ms = Percentiles::of(to_sampled);
        self.slowest.sort_by(|a, b| b.ms.total_cmp(&a.ms));
        self.slowest.truncate(SLOWEST);
    }

    /// A brick went, or the trace ended.
    fn count_waste(&mut self, gone: Option<Resident>) {
        let Some(Resident { bytes, sampled: false }) = gone else { return };
        self.bricks_wasted += 1;
        match bytes {
            Some(bytes) => self.bytes_wasted = self.bytes_wasted.saturating_add(bytes),
            None => self.bytes_wasted_guessed += 1,
        }
    }
}

/// A brick in its slot.
struct Resident {
    /// Copied for it, where the trace tells.
    bytes: Option<u64>,
    /// A ray went through it.
    sampled: bool,
}

/// How long spans of this name of the thread that runs the loop took.
fn host_ms(read: &Recorded, name: &str) -> Vec<f64> {
    let rounds = read.tracks.values().filter(|track| track.name == "rounds");
    let named = rounds.flat_map(|track| &track.slices).filter(|slice| slice.name == name);
    named.map(|slice| (slice.end_us - slice.begin_us) * 1e-3).collect()
}

fn stalls(read: &Recorded) -> Vec<Stall> {
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
        add(cause, host_ms(read, name));
    }
    add("rendering for loaders", starved_ms(read));
    let [mut before, mut between, mut after] = [const { Vec::new() }; 3];
    for loader in read.tracks.values().filter(|track| track.name.starts_with("loader")) {
        let idle = Idle::of(loader, read.wall_us());
        before.extend(idle.before_ms);
        between.extend(idle.between_ms);
        after.extend(idle.after_ms);
    }
    add("loaders for their first wish", before);
    add("loaders for wishes", between);
    add("loaders after their last wish", after);
    stalls.sort_by(|a, b| b.ms.total_cmp(&a.ms));
    stalls
}

/// Of each time that the render queue was idle between two steps, how long a loader worked.
fn starved_ms(read: &Recorded) -> Vec<f64> {
    let named = |name| read.tracks.values().filter(move |track| track.name.starts_with(name));
    let rays = named("render queue").next().map(|track| busy_us(&track.slices));
    let loaders = named("loader").flat_map(|track| &track.slices).copied();
    let loads = busy_us(&loaders.collect::<Vec<Slice>>());
    let mut next = 0;
    let mut starved = |[idle, end]: [f64; 2]| {
        // Both are sorted: what ended before this time is of no later one.
        next += loads[next..].iter().take_while(|load| load[1] <= idle).count();
        let within = loads[next..].iter().take_while(|load| load[0] < end);
        within.map(|load| load[1].min(end) - load[0].max(idle)).fold(0.0, |sum, us| sum + us)
    };
    let rays = rays.unwrap_or_default();
    let idle = rays.windows(2).map(|pair| starved([pair[0][1], pair[1][0]]));
    idle.filter(|us| *us > SAME_US).map(|us| us * 1e-3).collect()
}

/// When a loader had nothing to do.
struct Idle {
    before_ms: Option<f64>,
    between_ms: Vec<f64>,
    after_ms: Option<f64>,
}

impl Idle {
    fn of(loader: &Track, [begin_us, end_us]: [f64; 2]) -> Idle {
        let busy = busy_us(&loader.slices);
        let gap = |from: f64, to: f64| (to - from > SAME_US).then_some((to - from) * 1e-3);
        // One that never had a wish waited for its first all along.
        let first = busy.first().map_or(end_us, |[begin, _]| *begin);
        Idle {
            before_ms: gap(begin_us, first),
            between_ms: busy.windows(2).filter_map(|pair| gap(pair[0][1], pair[1][0])).collect(),
            after_ms: busy.last().and_then(|[_, end]| gap(*end, end_us)),
        }
    }
}

/// When at least one of these spans ran.
pub(super) fn busy_us(slices: &[Slice]) -> Vec<[f64; 2]> {
    joined(slices.iter().map(|slice| [slice.begin_us, slice.end_us]).collect())
}

impl Percentiles {
    /// Of these; zeros where there are none.
    pub fn of(mut values: Vec<f64>) -> Percentiles {
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
