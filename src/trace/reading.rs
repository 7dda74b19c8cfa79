//! A trace's file, read again by those who reckon or draw: spans by track, counters, bricks' steps and ways.

use std::collections::{BTreeMap, HashMap};

use serde_json::Value;

/// Times further from the trace's beginning than 30 years are none.
const TIME_US_MAX: f64 = 1e15;
/// Two moments nearer than this, microseconds, are one: the file has nanoseconds, rounded in binary.
pub const SAME_US: f64 = 5e-4;

/// Process and thread, as the file numbers them.
pub type Place = (Option<u64>, Option<u64>);

/// A span of the file. Microseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice<'a> {
    pub name: &'a str,
    pub begin_us: f64,
    pub end_us: f64,
}

/// What happened to a brick. Microseconds.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    pub name: &'a str,
    pub brick: &'a Value,
    pub at_us: f64,
    /// Texel bytes, where they are told.
    pub bytes: Option<u64>,
}

/// A brick's way, as far as the file tells it.
#[derive(Clone, Debug, Default)]
pub struct Way<'a> {
    pub brick: Option<&'a Value>,
    /// It came to its slot.
    pub finished: bool,
    /// Track, what happened there ("" where the file does not say), when.
    pub places: Vec<(Place, &'a str, f64)>,
}

/// One line of the picture.
#[derive(Clone, Debug, Default)]
pub struct Track<'a> {
    pub name: &'a str,
    pub slices: Vec<Slice<'a>>,
}

/// All of it.
#[derive(Default)]
pub struct Recorded<'a> {
    /// Those that have a span, and those that could have had.
    pub tracks: BTreeMap<Place, Track<'a>>,
    /// In order of time.
    pub steps: Vec<Step<'a>>,
    /// Values and when, in order of time.
    pub counters: BTreeMap<&'a str, Vec<(f64, f64)>>,
    /// By number.
    pub ways: BTreeMap<u64, Way<'a>>,
    /// Texel bytes of the transfer queue's copies.
    pub bytes_copied: u64,
}

impl<'a> Recorded<'a> {
    /// Of a trace's file as JSON.
    ///
    /// # Errors
    /// What keeps it from being one of ours, as the end of a sentence.
    pub fn of(file: &'a Value) -> Result<Recorded<'a>, String> {
        let events = file["traceEvents"].as_array().ok_or("has no traceEvents")?;
        let place = |event: &Value| (event["pid"].as_u64(), event["tid"].as_u64());
        let named = events.iter().filter(|event| event["name"] == "thread_name");
        let names: HashMap<Place, &str> = named
            .map(|event| (place(event), event["args"]["name"].as_str().unwrap_or("?")))
            .collect();
        let mut recorded = Recorded::default();
        // A queue that can be timed and a loader are there all the same without a span.
        let idle = |name: &str| name.ends_with(" queue") || name.starts_with("loader");
        for (place, name) in names.iter().filter(|(_, name)| idle(name)) {
            recorded.tracks.entry(*place).or_default().name = name;
        }
        for (number, event) in events.iter().enumerate() {
            let at = || {
                let told = event["ts"].as_f64().ok_or(format!("has no time in event {number}"))?;
                let known = told.abs() <= TIME_US_MAX;
                known.then_some(told).ok_or(format!("has a time beyond 30 years in event {number}"))
            };
            let name = event["name"].as_str().unwrap_or("?");
            match event["ph"].as_str() {
                Some("X") => {
                    let begin_us = at()?;
                    let took = event["dur"].as_f64().unwrap_or(0.0).clamp(0.0, TIME_US_MAX);
                    let track = recorded.tracks.entry(place(event)).or_default();
                    track.name = names.get(&place(event)).copied().unwrap_or("?");
                    track.slices.push(Slice { name, begin_us, end_us: begin_us + took });
                    if track.name.starts_with("transfer queue") {
                        let bytes = event["args"]["bytes"].as_u64().unwrap_or(0);
                        recorded.bytes_copied = recorded.bytes_copied.saturating_add(bytes);
                    }
                }
                Some("i") => recorded.steps.push(Step {
                    name,
                    brick: &event["args"]["brick"],
                    at_us: at()?,
                    bytes: event["args"]["bytes"].as_u64(),
                }),
                Some("C") => {
                    if let Some(value) = event["args"]["value"].as_f64() {
                        recorded.counters.entry(name).or_default().push((at()?, value));
                    }
                }
                Some("s" | "t" | "f") if event["cat"] == "brick" => {
                    let Some(id) = event["id"].as_u64() else { continue };
                    let args = &event["args"];
                    let way = recorded.ways.entry(id).or_default();
                    way.brick = way.brick.or(args.get("brick"));
                    way.finished |= args["finished"] == true;
                    way.places.push((place(event), args["step"].as_str().unwrap_or(""), at()?));
                }
                _ => {}
            }
        }
        recorded.steps.sort_by(|a, b| a.at_us.total_cmp(&b.at_us));
        recorded.counters.values_mut().for_each(|of| of.sort_by(|a, b| a.0.total_cmp(&b.0)));
        recorded.ways.values_mut().for_each(|way| way.places.sort_by(|a, b| a.2.total_cmp(&b.2)));
        let empty = recorded.slices().next().is_none();
        if empty { Err("has no spans".to_owned()) } else { Ok(recorded) }
    }

    /// Spans of all tracks.
    pub fn slices(&self) -> impl Iterator<Item = &Slice<'a>> {
        self.tracks.values().flat_map(|track| &track.slices)
    }

    /// From the first span's beginning to the last one's end.
    pub fn wall_us(&self) -> [f64; 2] {
        let begin = self.slices().map(|slice| slice.begin_us).fold(f64::INFINITY, f64::min);
        let end = self.slices().map(|slice| slice.end_us).fold(f64::NEG_INFINITY, f64::max);
        [begin, end]
    }
}
