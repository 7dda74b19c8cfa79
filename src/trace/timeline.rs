//! A picture of a trace's file for people who would rather look: what stands where, in pixels, without how it looks.
//!
//! A lane for each track, a row in it for each depth of nesting; counters below; one brick's way from lane to lane.
//!
//! # Invariants
//! The picture is bounded, whatever the file: spans narrower than half a pixel are merged into the pixel where they
//! begin, a chart has four points a pixel at most, and lanes, rows and names are counted.

use std::collections::{BTreeMap, HashMap};

use serde_json::Value;

use crate::trace::reading::{Place, Recorded, SAME_US, Track, Way};
use crate::trace::summary::busy_us;
use crate::trace::timeline_svg::svg;

/// Pixels across the part that has the times.
pub const WIDTH: f64 = 1030.0;
/// Narrower spans are merged.
pub const NARROW: f64 = 0.5;
/// Rows of a lane; what is nested deeper stands in the last one.
const ROWS_MAX: usize = 4;
/// Lanes drawn.
const LANES_MAX: usize = 40;
/// Names of spans that have a colour each; the others share one.
pub const NAMES_MAX: usize = 24;
/// The shortest window, microseconds.
const WINDOW_US_MIN: f64 = 0.01;

/// Counters that are drawn: title, the counter, and another in the same panel.
const CHARTS: [(&str, &str, Option<&str>); 4] = [
    ("bytes uploaded", "bytes uploaded", None),
    ("bricks bound", "bricks bound", None),
    ("rays waiting", "rays waiting", None),
    ("frame time", "frame time, us", Some("frame target, us")),
];

/// What of the trace is drawn.
#[derive(Clone, Copy, Debug, Default)]
pub struct Choice {
    /// Milliseconds since the trace began; nothing: its beginning.
    pub from_ms: Option<f64>,
    /// One past the last; nothing: its end.
    pub to_ms: Option<f64>,
    /// Number of the flow whose way is drawn; nothing: of those within the window, the one that took longest to come.
    pub brick: Option<u64>,
}

/// Why there is no picture, as the end of a sentence.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// The file is none of ours.
    File(String),
    /// The trace does not hold what was chosen.
    Choice(String),
}

/// The picture as data. Places are pixels from the left end of the window.
#[derive(Clone, Debug, Default)]
pub(super) struct Timeline<'a> {
    pub scene: &'a str,
    pub device: &'a str,
    pub window_ms: [f64; 2],
    pub wall_ms: [f64; 2],
    /// Of spans that are drawn, most time first.
    pub names: Vec<&'a str>,
    pub lanes: Vec<Lane<'a>>,
    /// Tracks for which there was no room.
    pub lanes_left_out: usize,
    pub charts: Vec<Chart>,
    pub way: Option<DrawnWay<'a>>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lane<'a> {
    pub name: &'a str,
    /// Part of the window in which it worked; nothing for the thread that runs the loop.
    pub busy: Option<f64>,
    /// By depth.
    pub rows: Vec<Vec<Piece>>,
}

/// A span, or several in one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    pub x: [f64; 2],
    /// Among [`Timeline::names`]; of several, the one that took longest.
    pub name: usize,
    /// Quarters of the pixel that are covered; nothing for one span.
    pub quarters: Option<u8>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chart {
    pub title: &'static str,
    /// The greatest value drawn.
    pub most: f64,
    /// Steps: place and value from there on.
    pub lines: Vec<Vec<(f64, f64)>>,
}

/// One brick's way through the lanes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DrawnWay<'a> {
    pub number: u64,
    pub brick: Option<&'a Value>,
    /// It was not asked for: of the window's, it took longest.
    pub slowest: bool,
    /// Lane, place, what happened, milliseconds.
    pub places: Vec<(usize, f64, &'a str, f64)>,
}

/// Draws a trace's file as SVG.
///
/// # Errors
/// See [`Refused`].
pub fn draw(file: &Value, choice: &Choice) -> Result<String, Refused> {
    let recorded = Recorded::of(file).map_err(Refused::File)?;
    Timeline::of(file, &recorded, choice).map(|timeline| svg(&timeline))
}

impl<'a> Timeline<'a> {
    pub fn of(
        file: &'a Value,
        recorded: &Recorded<'a>,
        choice: &Choice,
    ) -> Result<Timeline<'a>, Refused> {
        let wall = recorded.wall_us();
        let window = Window::of(wall, choice)?;
        let names = window.names(recorded);
        let index: HashMap<&str, usize> =
            names.iter().enumerate().map(|(index, name)| (*name, index)).collect();
        let lanes = recorded.tracks.values().take(LANES_MAX);
        let lanes: Vec<Lane> = lanes.map(|track| window.lane(track, &index)).collect();
        let places: BTreeMap<Place, usize> =
            recorded.tracks.keys().enumerate().map(|(lane, place)| (*place, lane)).collect();
        Ok(Timeline {
            scene: file["otherData"]["scene"].as_str().unwrap_or(""),
            device: file["otherData"]["device"].as_str().unwrap_or(""),
            window_ms: [window.from_us * 1e-3, window.to_us * 1e-3],
            wall_ms: wall.map(|us| us * 1e-3),
            names,
            lanes_left_out: recorded.tracks.len() - lanes.len(),
            lanes,
            charts: window.charts(recorded),
            way: window.way(recorded, &places, choice.brick)?,
        })
    }
}

/// The part of the trace that is drawn. Microseconds.
#[derive(Clone, Copy, Debug)]
struct Window {
    from_us: f64,
    to_us: f64,
}

impl Window {
    fn of([begin_us, end_us]: [f64; 2], choice: &Choice) -> Result<Window, Refused> {
        let from_us = choice.from_ms.map_or(begin_us, |ms| ms * 1e3);
        let to_us = choice.to_ms.map_or(end_us, |ms| ms * 1e3);
        let ms = |us: f64| us * 1e-3;
        let given = choice.from_ms.is_some() || choice.to_ms.is_some();
        if given && !(from_us < end_us && to_us > begin_us && to_us - from_us >= WINDOW_US_MIN) {
            return Err(Refused::Choice(format!(
                "nothing lies from {:.3} to {:.3} ms: the trace is from {:.3} to {:.3} ms",
                ms(from_us),
                ms(to_us),
                ms(begin_us),
                ms(end_us)
            )));
        }
        // A trace of one moment is drawn all the same.
        Ok(Window { from_us, to_us: to_us.max(from_us + WINDOW_US_MIN) })
    }

    fn x(&self, us: f64) -> f64 {
        (us - self.from_us) / (self.to_us - self.from_us) * WIDTH
    }

    /// The part of a span that is drawn, if any.
    fn clipped(&self, [begin_us, end_us]: [f64; 2]) -> Option<[f64; 2]> {
        // What ends where the window begins is outside of it, unless it takes no time.
        let inside = end_us > self.from_us + SAME_US || begin_us >= self.from_us;
        (inside && begin_us < self.to_us)
            .then_some([begin_us.max(self.from_us), end_us.min(self.to_us)])
    }

    fn names<'a>(&self, recorded: &Recorded<'a>) -> Vec<&'a str> {
        let mut took: BTreeMap<&str, f64> = BTreeMap::new();
        for slice in recorded.slices() {
            if let Some([begin, end]) = self.clipped([slice.begin_us, slice.end_us]) {
                *took.entry(slice.name).or_default() += end - begin;
            }
        }
        let mut names: Vec<(&str, f64)> = took.into_iter().collect();
        names.sort_by(|a, b| b.1.total_cmp(&a.1));
        names.into_iter().take(NAMES_MAX).map(|(name, _)| name).collect()
    }

    fn lane<'a>(&self, track: &Track<'a>, names: &HashMap<&str, usize>) -> Lane<'a> {
        let mut slices = track.slices.clone();
        // Of two that begin together, the longer one holds the other.
        slices
            .sort_by(|a, b| a.begin_us.total_cmp(&b.begin_us).then(b.end_us.total_cmp(&a.end_us)));
        let mut rows = vec![Row::default()];
        let mut open: Vec<f64> = Vec::new();
        for slice in &slices {
            while open.last().is_some_and(|end| *end <= slice.begin_us + SAME_US) {
                open.pop();
            }
            let depth = open.len().min(ROWS_MAX - 1);
            open.push(slice.end_us);
            let Some(times) = self.clipped([slice.begin_us, slice.end_us]) else { continue };
            if rows.len() <= depth {
                rows.resize_with(depth + 1, Row::default);
            }
            let name = names.get(slice.name).copied().unwrap_or(NAMES_MAX);
            rows[depth].add(times.map(|us| self.x(us)), name);
        }
        let within = busy_us(&slices).into_iter().filter_map(|times| self.clipped(times));
        // Not `sum`, which is -0 of nothing.
        let busy = within.fold(0.0, |sum, [begin, end]| sum + (end - begin));
        Lane {
            name: track.name,
            busy: (track.name != "rounds").then_some(busy / (self.to_us - self.from_us)),
            rows: rows.into_iter().map(Row::pieces).collect(),
        }
    }

    fn charts(&self, recorded: &Recorded) -> Vec<Chart> {
        let line = |counter: &str| {
            recorded.counters.get(counter).map(|values| self.line(values)).unwrap_or_default()
        };
        let chart = |(title, counter, other): (&'static str, &str, Option<&str>)| {
            let mut lines = vec![line(counter)];
            lines.extend(other.map(line).filter(|line| !line.is_empty()));
            let values = lines.iter().flatten().map(|(_, value)| *value);
            let most = values.fold(0.0, f64::max);
            (!lines[0].is_empty()).then_some(Chart { title, most, lines })
        };
        CHARTS.into_iter().filter_map(chart).collect()
    }

    /// Steps within the window, four in a pixel at most: the first, the least, the greatest and the last.
    fn line(&self, values: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut line: Vec<(f64, f64)> = Vec::new();
        let before = values.iter().rev().find(|(at, _)| *at <= self.from_us);
        line.extend(before.map(|(_, value)| (0.0, *value)));
        let inside = values.iter().filter(|(at, _)| *at > self.from_us && *at <= self.to_us);
        let mut pixel: Option<(f64, [f64; 4])> = None;
        let close = |line: &mut Vec<(f64, f64)>, pixel: Option<(f64, [f64; 4])>| {
            for value in pixel.iter().flat_map(|(_, values)| values) {
                let at = pixel.map_or(0.0, |(at, _)| at);
                if line.last().is_none_or(|(_, last)| last != value) {
                    line.push((at, *value));
                }
            }
        };
        for (at_us, value) in inside {
            let x = self.x(*at_us);
            match &mut pixel {
                Some((at, [_, least, greatest, last])) if at.floor() == x.floor() => {
                    (*least, *greatest) = (least.min(*value), greatest.max(*value));
                    *last = *value;
                }
                _ => {
                    close(&mut line, pixel);
                    pixel = Some((x, [*value; 4]));
                }
            }
        }
        close(&mut line, pixel);
        if let Some((_, last)) = line.last().copied() {
            line.push((WIDTH, last));
        }
        line
    }

    fn way<'a>(
        &self,
        recorded: &Recorded<'a>,
        lanes: &BTreeMap<Place, usize>,
        wanted: Option<u64>,
    ) -> Result<Option<DrawnWay<'a>>, Refused> {
        let chosen = match wanted {
            None => self.slowest(&recorded.ways),
            Some(number) => {
                let way = recorded.ways.get(&number).map(|way| (number, way));
                Some(way.ok_or_else(|| match recorded.ways.last_key_value() {
                    Some((last, _)) => Refused::Choice(format!(
                        "has no brick {number} on its way: its flows go up to {last}"
                    )),
                    None => Refused::Choice("has no brick on its way at all".to_owned()),
                })?)
            }
        };
        let Some((number, way)) = chosen else { return Ok(None) };
        let drawn = |(place, what, at_us): &(Place, &'a str, f64)| {
            let lane = lanes.get(place).copied().filter(|lane| *lane < LANES_MAX)?;
            let inside = (self.from_us..=self.to_us).contains(at_us);
            inside.then_some((lane, self.x(*at_us), *what, at_us * 1e-3))
        };
        let places: Vec<_> = way.places.iter().filter_map(drawn).collect();
        if places.is_empty() {
            let ms = |at: Option<&(Place, &str, f64)>| at.map_or(0.0, |(_, _, us)| us * 1e-3);
            return Err(Refused::Choice(format!(
                "has brick {number} on its way from {:.3} to {:.3} ms, outside of what is drawn",
                ms(way.places.first()),
                ms(way.places.last())
            )));
        }
        Ok(Some(DrawnWay { number, brick: way.brick, slowest: wanted.is_none(), places }))
    }

    /// Of bricks that came within the window, the one that took longest.
    fn slowest<'w, 'a>(&self, ways: &'w BTreeMap<u64, Way<'a>>) -> Option<(u64, &'w Way<'a>)> {
        let took = |way: &Way| {
            let (_, _, begin_us) = way.places.first()?;
            let published = way.places.iter().find(|(_, what, _)| *what == "published");
            let (_, _, end_us) = published.or(way.places.last())?;
            let inside = way.finished && *begin_us >= self.from_us && *end_us <= self.to_us;
            inside.then_some(end_us - begin_us)
        };
        let candidates = ways.iter().filter_map(|(number, way)| Some((took(way)?, *number, way)));
        let longest = candidates.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        longest.map(|(_, number, way)| (number, way))
    }
}

/// Spans of one depth, and what of each pixel narrow ones cover: by name.
#[derive(Default)]
struct Row {
    wide: Vec<Piece>,
    narrow: BTreeMap<u32, BTreeMap<usize, f64>>,
}

impl Row {
    fn add(&mut self, x: [f64; 2], name: usize) {
        if x[1] - x[0] >= NARROW {
            self.wide.push(Piece { x, name, quarters: None });
        } else {
            let pixel = self.narrow.entry(x[0] as u32).or_default();
            *pixel.entry(name).or_default() += x[1] - x[0];
        }
    }

    /// Merged ones first, so that what is wide lies above them.
    fn pieces(self) -> Vec<Piece> {
        let mut pieces: Vec<Piece> = Vec::new();
        for (pixel, names) in self.narrow {
            let covered: f64 = names.values().sum();
            let longest = names.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((name, _)) = longest else { continue };
            let quarters = Some((covered * 4.0).round().clamp(1.0, 4.0) as u8);
            let x = [f64::from(pixel), f64::from(pixel) + 1.0];
            match pieces.last_mut().filter(|last| last.x[1] == x[0]) {
                Some(last) if last.name == name && last.quarters == quarters => last.x[1] = x[1],
                _ => pieces.push(Piece { x, name, quarters }),
            }
        }
        pieces.extend(self.wide);
        pieces
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn span(tid: u64, name: &str, [from, to]: [f64; 2]) -> Value {
        json!({ "ph": "X", "name": name, "pid": 1, "tid": tid, "ts": from, "dur": to - from })
    }

    fn file(events: Vec<Value>) -> Value {
        let name = |tid: u64, name: &str| json!({ "ph": "M", "name": "thread_name", "pid": 1, "tid": tid, "args": { "name": name } });
        let events = [vec![name(1, "rounds"), name(2, "loader 0")], events].concat();
        json!({ "otherData": { "scene": "a.toml" }, "traceEvents": events })
    }

    fn of<'a>(file: &'a Value, choice: &Choice) -> Timeline<'a> {
        let recorded = Recorded::of(file).expect("a trace");
        Timeline::of(file, &recorded, choice).expect("drawn")
    }

    #[test]
    fn spans_lie_where_their_times_say_nested_ones_a_row_below() {
        let file = file(vec![
            span(1, "round", [0.0, 1030.0]),
            span(1, "wait", [103.0, 206.0]),
            span(1, "wait", [206.0, 309.0]),
            span(2, "read", [515.0, 618.0]),
        ]);
        let drawn = of(&file, &Choice::default());
        assert_eq!(drawn.names, ["round", "wait", "read"]);
        let piece = |x, name| Piece { x, name, quarters: None };
        let waits = vec![piece([103.0, 206.0], 1), piece([206.0, 309.0], 1)];
        let rounds =
            Lane { name: "rounds", busy: None, rows: vec![vec![piece([0.0, 1030.0], 0)], waits] };
        assert_eq!(drawn.lanes[0], rounds);
        assert_eq!(drawn.lanes[1].rows, [[piece([515.0, 618.0], 2)]]);
        assert!((drawn.lanes[1].busy.expect("of a loader") - 0.1).abs() < 1e-9);
        // The window stretches what is left of them.
        let choice = Choice { from_ms: Some(0.206), to_ms: Some(0.721), brick: None };
        let half = of(&file, &choice);
        let [wait] = half.lanes[0].rows[1][..] else { panic!("{:?}", half.lanes[0]) };
        assert_eq!((half.names[wait.name], wait.quarters), ("wait", None));
        assert!(wait.x[0].abs() < 1e-9 && (wait.x[1] - 206.0).abs() < 1e-6, "{wait:?}");
    }

    #[test]
    fn spans_narrower_than_half_a_pixel_are_merged() {
        // Ten pixels, each half covered by a hundred spans; one pixel in which another name takes more.
        let mut events = vec![span(1, "round", [0.0, 1030.0])];
        for number in 0..1000 {
            let at = f64::from(number) * 0.01;
            events.push(span(2, "read", [at, at + 0.005]));
        }
        events.extend([span(2, "read", [20.0, 20.1]), span(2, "survey", [20.5, 20.7])]);
        let file = file(events);
        let drawn = of(&file, &Choice::default());
        let piece = |x, name, quarters| Piece { x, name, quarters: Some(quarters) };
        let [read, survey] =
            ["read", "survey"].map(|of| drawn.names.iter().position(|name| *name == of).unwrap());
        let merged = [piece([0.0, 10.0], read, 2), piece([20.0, 21.0], survey, 1)];
        assert_eq!(drawn.lanes[1].rows, [merged]);
    }

    #[test]
    fn a_chart_holds_its_value_until_it_changes_and_four_points_a_pixel_at_most() {
        let value = |ts: f64, value: f64| json!({ "ph": "C", "name": "rays waiting", "pid": 1, "tid": 0, "ts": ts, "args": { "value": value } });
        let mut events = vec![span(1, "round", [0.0, 1030.0]), value(10.0, 7.0)];
        let within = |n: u32| f64::from((n + 20) % 50);
        events.extend((0..99).map(|n| value(20.0 + 0.009 * f64::from(n), within(n))));
        let file = file(events);
        let charts = of(&file, &Choice::default()).charts;
        let pixel = [(20.0, 20.0), (20.0, 0.0), (20.0, 49.0), (20.0, 18.0)];
        let line = [&[(10.0, 7.0)], &pixel[..], &[(1030.0, 18.0)]].concat();
        assert_eq!(charts, [Chart { title: "rays waiting", most: 49.0, lines: vec![line] }]);
        let choice = Choice { from_ms: Some(0.515), ..Choice::default() };
        let late = &of(&file, &choice).charts[0];
        assert_eq!(late.lines, [[(0.0, 18.0), (WIDTH, 18.0)]], "as it was before");
    }

    #[test]
    fn the_slowest_brick_of_the_window_is_followed_or_the_one_asked_for() {
        let at = |id: u64, ph: &str, tid: u64, step: &str, ts: f64| json!({ "ph": ph, "cat": "brick", "name": "brick", "id": id, "pid": 1, "tid": tid, "ts": ts, "args": { "finished": true, "step": step, "brick": { "x": id } } });
        let file = file(vec![
            span(1, "round", [0.0, 1030.0]),
            at(0, "s", 1, "wanted", 10.0),
            at(0, "t", 1, "published", 30.0),
            at(0, "f", 1, "evicted", 900.0),
            at(1, "s", 1, "wanted", 100.0),
            at(1, "t", 2, "read", 110.0),
            at(1, "f", 1, "published", 200.0),
        ]);
        let way = of(&file, &Choice::default()).way.expect("a brick");
        let places =
            [(0, 100.0, "wanted", 0.1), (1, 110.0, "read", 0.11), (0, 200.0, "published", 0.2)];
        assert_eq!((way.number, way.slowest), (1, true));
        for (drawn, wanted) in way.places.iter().zip(places) {
            assert_eq!((drawn.0, drawn.2), (wanted.0, wanted.2));
            assert!((drawn.1 - wanted.1).abs() < 1e-9 && (drawn.3 - wanted.3).abs() < 1e-9);
        }
        let early = Choice { to_ms: Some(0.15), ..Choice::default() };
        assert_eq!(of(&file, &early).way.expect("a brick").number, 0);
        let late = Choice { from_ms: Some(0.15), ..Choice::default() };
        assert_eq!(of(&file, &late).way, None, "none came within it whole");
        let recorded = Recorded::of(&file).expect("a trace");
        let refused = |choice| match Timeline::of(&file, &recorded, &choice) {
            Err(Refused::Choice(why)) => why,
            other => panic!("{other:?}"),
        };
        let missing = Choice { brick: Some(2), ..Choice::default() };
        assert!(refused(missing).contains("has no brick 2"));
        let outside = Choice { from_ms: Some(0.95), brick: Some(0), ..Choice::default() };
        assert!(refused(outside).contains("from 0.010 to 0.900 ms"));
        for (from_ms, to_ms) in [(2.0, 3.0), (0.5, 0.4), (0.5, 0.5), (-2.0, -1.0)] {
            let choice = Choice { from_ms: Some(from_ms), to_ms: Some(to_ms), brick: None };
            assert!(refused(choice).contains("nothing lies from"));
        }
    }
}
