//! A trace as a reader of Chrome's format sees it, held to the format.

use std::collections::{BTreeMap, BTreeSet};

use ashfall::trace::Trace;
use serde_json::Value;

/// A span: first and one past the last nanosecond.
pub struct Span {
    pub name: String,
    pub begin_ns: i64,
    pub end_ns: i64,
    pub args: Value,
}

/// Spans by track, in the file's order; counters' values in order of time.
pub struct Read {
    pub tracks: BTreeMap<String, Vec<Span>>,
    pub counters: BTreeMap<String, Vec<u64>>,
    /// What happens to bricks: what, to which, when.
    pub steps: Vec<(String, String, i64)>,
    /// And what else is said of it.
    pub step_args: Vec<Value>,
    /// By number: kind of event, track, when.
    pub flows: BTreeMap<u64, Vec<(String, String, i64)>>,
    /// By number: what happened at each place.
    pub flow_steps: BTreeMap<u64, Vec<String>>,
    pub flows_finished: BTreeSet<u64>,
    pub about: Value,
}

pub fn read(trace: &Trace) -> Read {
    let mut bytes = Vec::new();
    trace.write(&mut bytes).expect("written into memory");
    parse(&bytes)
}

/// Every event has what the format wants of its kind, and stands on a track that has a name.
pub fn parse(bytes: &[u8]) -> Read {
    let file: Value = serde_json::from_slice(bytes).expect("JSON");
    let events = file["traceEvents"].as_array().expect("events");
    let mut names = BTreeMap::new();
    for event in events.iter().filter(|event| event["ph"] == "M") {
        let name = event["args"]["name"].as_str().expect("a name").to_owned();
        match event["name"].as_str() {
            Some("thread_name") => _ = names.insert((of(event, "pid"), of(event, "tid")), name),
            other => assert_eq!(other, Some("process_name")),
        }
    }
    let mut read = Read {
        tracks: names.values().map(|name| (name.clone(), Vec::new())).collect(),
        counters: BTreeMap::new(),
        steps: Vec::new(),
        step_args: Vec::new(),
        flows: BTreeMap::new(),
        flow_steps: BTreeMap::new(),
        flows_finished: BTreeSet::new(),
        about: file["otherData"].clone(),
    };
    assert_eq!(read.tracks.len(), names.len(), "tracks have names of their own");
    let mut counted_at = BTreeMap::new();
    for event in events {
        let name = event["name"].as_str().expect("a name").to_owned();
        assert!(event["args"].is_object(), "{event}");
        match event["ph"].as_str() {
            Some("M") => {}
            Some("X") => {
                let track = &names[&(of(event, "pid"), of(event, "tid"))];
                let (begin_ns, length_ns) = (ns(event, "ts"), ns(event, "dur"));
                assert!(length_ns >= 0, "{event}");
                let (end_ns, args) = (begin_ns + length_ns, event["args"].clone());
                let span = Span { name, begin_ns, end_ns, args };
                read.tracks.get_mut(track).expect("named").push(span);
            }
            Some("C") => {
                let before = counted_at.insert(name.clone(), ns(event, "ts"));
                assert!(before <= Some(ns(event, "ts")), "{event}");
                read.counters.entry(name).or_default().push(of(&event["args"], "value"));
            }
            Some("i") => {
                let (brick, at_ns) = (event["args"]["brick"].to_string(), ns(event, "ts"));
                read.steps.push((name, brick, at_ns));
                read.step_args.push(event["args"].clone());
            }
            Some(part @ ("s" | "t" | "f")) => {
                let flow = read.flows.entry(of(event, "id")).or_default();
                let place = names[&(of(event, "pid"), of(event, "tid"))].clone();
                // Begun once, ended once, in order of time.
                assert_eq!(flow.is_empty(), part == "s", "{event}");
                assert!(flow.last().is_none_or(|(last, _, _)| last != "f"), "{event}");
                assert!(flow.last().is_none_or(|(_, _, at)| *at <= ns(event, "ts")), "{event}");
                flow.push((part.to_owned(), place, ns(event, "ts")));
                assert_eq!(event["args"]["brick"].is_object(), part == "s", "{event}");
                let step = event["args"]["step"].as_str().expect("what happened").to_owned();
                read.flow_steps.entry(of(event, "id")).or_default().push(step);
                if event["args"]["finished"] == true {
                    read.flows_finished.insert(of(event, "id"));
                }
            }
            _ => panic!("an event of no known kind: {event}"),
        }
    }
    read
}

impl Read {
    /// Spans of the loop's track are nested or in sequence; those of loaders and queues in sequence.
    pub fn check_tracks(&self) {
        for (track, spans) in &self.tracks {
            let mut open: Vec<&Span> = Vec::new();
            for span in spans {
                while open.last().is_some_and(|outer| outer.end_ns <= span.begin_ns) {
                    open.pop();
                }
                let outer = open.last();
                assert!(
                    outer.is_none_or(|outer| {
                        outer.begin_ns <= span.begin_ns
                            && span.end_ns <= outer.end_ns
                            && track == "rounds"
                    }),
                    "{track}: {} at {} ns overlaps {}",
                    span.name,
                    span.begin_ns,
                    outer.expect("there").name
                );
                open.push(span);
            }
        }
    }

    pub fn spans(&self, track: &str, name: &str) -> Vec<&Span> {
        let of_track = |(known, _): &(&String, &Vec<Span>)| known.starts_with(track);
        let tracks = self.tracks.iter().filter(of_track);
        tracks.flat_map(|(_, spans)| spans).filter(|span| span.name == name).collect()
    }

    /// The sum of an argument of all such spans.
    pub fn sum(&self, track: &str, name: &str, argument: &str) -> u64 {
        self.spans(track, name).iter().map(|span| of(&span.args, argument)).sum()
    }

    /// How many bricks came so far.
    pub fn count_of(&self, step: &str) -> u64 {
        self.steps.iter().filter(|(name, _, _)| name == step).count() as u64
    }

    /// What is said of bricks that came so far.
    pub fn args_of(&self, step: &str) -> impl Iterator<Item = &Value> {
        let args = self.steps.iter().zip(&self.step_args);
        args.filter(move |((name, _, _), _)| name == step).map(|(_, args)| args)
    }

    pub fn last(&self, counter: &str) -> u64 {
        let values = self.counters.get(counter).unwrap_or_else(|| panic!("no {counter}"));
        let last = *values.last().expect("a value");
        assert_eq!(self.about["last_values"][counter], last);
        last
    }
}

pub fn of(value: &Value, key: &str) -> u64 {
    value[key].as_u64().unwrap_or_else(|| panic!("no {key} in {value}"))
}

fn ns(event: &Value, key: &str) -> i64 {
    let us = event[key].as_f64().unwrap_or_else(|| panic!("no {key} in {event}"));
    (us * 1000.0).round() as i64
}
