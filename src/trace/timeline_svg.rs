//! How the picture of a trace looks, as SVG written by hand. Names stand in spans that have room for them, so that
//! colour alone tells nothing apart.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde_json::Value;

use crate::trace::timeline::{Chart, DrawnWay, Lane, NAMES_MAX, Timeline, WIDTH};

const LEFT: f64 = 132.0;
const RIGHT: f64 = 22.0;
const PAGE: f64 = LEFT + WIDTH + RIGHT;
const ROW: f64 = 17.0;
const LANE_GAP: f64 = 15.0;
const CHART: f64 = 44.0;
const CHART_GAP: f64 = 14.0;
/// Between lines of text.
const LINE: f64 = 17.0;
/// Half of a number's ring.
const RING: f64 = 7.5;
/// Of one letter, about.
const LETTER: f64 = 5.6;
const NAME_LETTERS_MAX: usize = 40;

/// What is drawn in one colour everywhere, so that pictures compare.
const KNOWN: [(&str, &str); 30] = [
    ("view", "#c3cad0"),
    ("round", "#dfe3e6"),
    ("wait", "#d9826b"),
    ("load", "#c0392b"),
    ("wait for half", "#8e2f5f"),
    ("submit", "#7f93a3"),
    ("report", "#a79bc4"),
    ("bind", "#7fb069"),
    ("stage", "#4a7a2c"),
    ("flush", "#2a7f86"),
    ("place", "#57a5a0"),
    ("upload", "#35613a"),
    ("read", "#1b5e9b"),
    ("decode", "#6fb1e3"),
    ("inspect", "#a9a3e0"),
    ("survey", "#c9a227"),
    ("march_bricks", "#e3a74a"),
    ("march", "#e3a74a"),
    ("cast", "#e3a74a"),
    ("copy", "#2a7f86"),
    ("order", "#57a5a0"),
    ("forget", "#b0aa94"),
    ("publish", "#a3285f"),
    ("rays", "#b08b5e"),
    ("tally", "#6b4a8a"),
    ("choose", "#8a8f2a"),
    ("count", "#58707d"),
    ("scan", "#3f6fd1"),
    ("grant", "#5a7d00"),
    ("resolve", "#c287b0"),
];
/// For all others, in turn.
const OTHERS: [&str; 6] = ["#b3541e", "#6b5b2e", "#2f8f6b", "#9c4f96", "#c48a8a", "#4d5fa8"];
/// Of names beyond [`NAMES_MAX`].
const REST: &str = "#9a9a9a";
/// A brick's way.
const WAY: &str = "#111111";

/// The whole picture.
pub(super) fn svg(timeline: &Timeline) -> String {
    let colours = colours(&timeline.names);
    let mut head = String::new();
    let mut y = 24.0;
    let [from, to] = timeline.window_ms;
    text(&mut head, [10.0, y], "font-size=\"15\"", &title(timeline));
    y += LINE;
    let [begin, end] = timeline.wall_ms;
    let whole = format!(
        "{from:.1} to {to:.1} ms of a trace from {begin:.1} to {end:.1} ms; times in ms since it began"
    );
    text(&mut head, [10.0, y], "fill=\"#666\"", &whole);
    y = legend(&mut head, timeline, &colours, y + 22.0);
    if let Some(way) = &timeline.way {
        y = way_words(&mut head, way, y + LINE);
    }
    let top = y + 28.0;
    let mut body = String::new();
    let mut y = top;
    let mut middles = Vec::new();
    for lane in &timeline.lanes {
        let high = ROW * lane.rows.len() as f64;
        middles.push(y + high / 2.0);
        draw_lane(&mut body, lane, &timeline.names, &colours, y);
        y += high + LANE_GAP;
    }
    if timeline.lanes_left_out > 0 {
        let words = format!("{} more tracks are not drawn", timeline.lanes_left_out);
        text(&mut body, [LEFT, y], "fill=\"#666\"", &words);
        y += LINE;
    }
    for chart in &timeline.charts {
        draw_chart(&mut body, chart, y);
        y += CHART + CHART_GAP;
    }
    let bottom = y - 4.0;
    if let Some(way) = &timeline.way {
        draw_way(&mut body, way, &middles);
    }
    let height = bottom + 26.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{PAGE}\" height=\"{height:.0}\" viewBox=\"0 0 {PAGE} {height:.0}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    out += &head;
    axis(&mut out, timeline.window_ms, [top - 8.0, bottom]);
    out + &body + "</svg>\n"
}

fn title(timeline: &Timeline) -> String {
    let scene = timeline.scene.rsplit(['/', '\\']).next().unwrap_or("");
    let mut title = if scene.is_empty() { "A trace".to_owned() } else { short(scene, 60) };
    if !timeline.device.is_empty() {
        title += &format!(" on {}", short(timeline.device, 60));
    }
    title
}

fn colours(names: &[&str]) -> Vec<&'static str> {
    let mut others = OTHERS.iter().cycle();
    let known = |name: &str| KNOWN.iter().find(|(known, _)| *known == name).map(|(_, of)| *of);
    let mut colour = |name: &&str| known(name).or_else(|| others.next().copied()).unwrap_or(REST);
    names.iter().map(&mut colour).chain([REST]).collect()
}

fn colour(colours: &[&'static str], name: usize) -> &'static str {
    colours.get(name).copied().unwrap_or(REST)
}

/// Names and their colours; where it ends.
fn legend(out: &mut String, timeline: &Timeline, colours: &[&'static str], top: f64) -> f64 {
    let (mut x, mut y) = (10.0, top);
    let more = timeline.names.len() == NAMES_MAX;
    let rest = more.then_some(("others", REST));
    let named = timeline.names.iter().zip(colours).map(|(name, colour)| (*name, *colour));
    for (name, colour) in named.chain(rest) {
        let words = short(name, NAME_LETTERS_MAX);
        let wide = 30.0 + 6.2 * words.chars().count() as f64;
        if x > 10.0 && x + wide > PAGE {
            (x, y) = (10.0, y + LINE);
        }
        let _ = writeln!(
            out,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"12\" height=\"11\" fill=\"{colour}\"/>",
            y - 9.5
        );
        text(out, [x + 17.0, y], "", &words);
        x += wide;
    }
    y
}

/// What the numbers of a brick's way mean; where it ends.
fn way_words(out: &mut String, way: &DrawnWay, top: f64) -> f64 {
    let first = way.places.first().map_or(0.0, |(_, _, _, ms)| *ms);
    let which = if way.slowest { "slowest brick" } else { "brick" };
    let id = way.brick.map(|id| format!(" ({})", brick_words(id))).unwrap_or_default();
    let mut pieces = vec![format!("{which}, flow {}{id}", way.number)];
    for (number, (_, _, what, ms)) in way.places.iter().enumerate() {
        let what = if what.is_empty() { "passed" } else { what };
        let when = match number {
            0 => format!("{ms:.1} ms"),
            _ => format!("+{:.1}", ms - first),
        };
        pieces.push(format!("{} {} {when}", number + 1, short(what, NAME_LETTERS_MAX)));
    }
    let (mut line, mut y) = (String::new(), top);
    for piece in pieces {
        if !line.is_empty() && LETTER * (line.len() + piece.len()) as f64 > PAGE - 40.0 {
            text(out, [10.0, y], "", &line);
            (line, y) = (String::new(), y + LINE);
        }
        line += if line.is_empty() { "" } else { " · " };
        line += &piece;
    }
    text(out, [10.0, y], "", &line);
    y
}

fn brick_words(id: &Value) -> String {
    let of = |key: &str| id[key].as_u64().map_or("?".to_owned(), |number| number.to_string());
    let place = ["x", "y", "z"].map(of).join(" ");
    format!("channel {}, level {}, {place}", of("channel"), of("level"))
}

/// Lines at round times, named above and below.
fn axis(out: &mut String, [from, to]: [f64; 2], [top, bottom]: [f64; 2]) {
    let step = round_step((to - from) / 10.0);
    let digits = usize::try_from((-step.log10().floor()).max(0.0) as u64).unwrap_or(0).min(9);
    let first = (from / step).ceil();
    let mut lines = String::new();
    for number in 0..=20 {
        let ms = (first + f64::from(number)) * step;
        if ms > to {
            break;
        }
        let x = LEFT + (ms - from) / (to - from) * WIDTH;
        let _ = write!(lines, "M{x:.1} {top:.1}V{bottom:.1}");
        for y in [top - 4.0, bottom + 15.0] {
            let words = format!("{ms:.digits$}");
            text(out, [x, y], "text-anchor=\"middle\" fill=\"#555\" font-size=\"10\"", &words);
        }
    }
    let _ = writeln!(out, "<path d=\"{lines}\" stroke=\"#e2e2e2\" fill=\"none\"/>");
    text(
        out,
        [LEFT - 30.0, bottom + 15.0],
        "text-anchor=\"end\" fill=\"#555\" font-size=\"10\"",
        "ms",
    );
}

/// 1, 2 or 5 times a power of ten, not less than `least`.
fn round_step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * power);
    steps.into_iter().find(|step| *step >= least * 0.999).unwrap_or(10.0 * power)
}

fn draw_lane(out: &mut String, lane: &Lane, names: &[&str], colours: &[&'static str], top: f64) {
    let high = ROW * lane.rows.len() as f64;
    let middle = top + high / 2.0;
    let two = lane.busy.is_some();
    let y = if two { middle - 2.0 } else { middle + 4.0 };
    text(out, [LEFT - 8.0, y], "text-anchor=\"end\"", &short(lane.name, 22));
    if let Some(busy) = lane.busy {
        let words = format!("busy {:.1} %", 100.0 * busy);
        let style = "text-anchor=\"end\" fill=\"#666\" font-size=\"9.5\"";
        text(out, [LEFT - 8.0, middle + 9.5], style, &words);
    }
    let _ = writeln!(
        out,
        "<rect x=\"{LEFT}\" y=\"{top:.1}\" width=\"{WIDTH}\" height=\"{high:.1}\" fill=\"#f6f6f4\"/>"
    );
    // One path for all of a colour: merged ones first, so that what is wide lies above.
    let mut merged: BTreeMap<(u8, &str), String> = BTreeMap::new();
    let mut wide: BTreeMap<&str, String> = BTreeMap::new();
    let mut words = String::new();
    for (depth, row) in lane.rows.iter().enumerate() {
        let y = top + ROW * depth as f64;
        let tall = ROW - 1.5;
        for piece in row {
            let [x0, x1] = piece.x.map(|x| LEFT + x);
            let fill = colour(colours, piece.name);
            let path = match piece.quarters {
                Some(quarters) => merged.entry((quarters, fill)).or_default(),
                None => wide.entry(fill).or_default(),
            };
            // A hair apart, so that neighbours of one colour are told apart where there is room.
            let across = x1 - x0 - if x1 - x0 > 3.0 { 0.6 } else { 0.0 };
            let _ = write!(path, "M{x0:.1} {y:.1}h{across:.1}v{tall}h-{across:.1}z");
            let name = names.get(piece.name).copied().unwrap_or("");
            let name = short(name, NAME_LETTERS_MAX);
            let room = LETTER * name.chars().count() as f64 + 8.0;
            if piece.quarters.is_none() && x1 - x0 >= room && !name.is_empty() {
                let ink = if is_dark(fill) { "#fff" } else { "#222" };
                let style = format!("font-size=\"10\" fill=\"{ink}\"");
                text(&mut words, [x0 + 4.0, y + 11.5], &style, &name);
            }
        }
    }
    for ((quarters, fill), path) in merged {
        // What little there is must be seen.
        let part = 0.3 + 0.7 * f64::from(quarters) / 4.0;
        let _ = writeln!(out, "<path fill=\"{fill}\" fill-opacity=\"{part:.2}\" d=\"{path}\"/>");
    }
    for (fill, path) in wide {
        let _ = writeln!(out, "<path fill=\"{fill}\" d=\"{path}\"/>");
    }
    *out += &words;
}

/// Whether white words read better on it than black ones.
fn is_dark(colour: &str) -> bool {
    let part = |at: usize| {
        let digits = colour.get(at..at + 2).unwrap_or("ff");
        f64::from(u8::from_str_radix(digits, 16).unwrap_or(255))
    };
    0.3 * part(1) + 0.59 * part(3) + 0.11 * part(5) < 140.0
}

fn draw_chart(out: &mut String, chart: &Chart, top: f64) {
    let bottom = top + CHART;
    let most = if chart.most > 0.0 { chart.most } else { 1.0 };
    let y_of = |value: f64| bottom - (value.max(0.0) / most) * (CHART - 2.0);
    let _ = writeln!(
        out,
        "<path d=\"M{LEFT} {top:.1}V{bottom:.1}h{WIDTH}\" stroke=\"#bbb\" fill=\"none\"/>"
    );
    let end = "text-anchor=\"end\"";
    text(out, [LEFT - 8.0, top + 22.0], end, chart.title);
    let grey = "text-anchor=\"end\" fill=\"#666\" font-size=\"9.5\"";
    text(out, [LEFT - 8.0, top + 8.0], grey, &value_words(chart.title, chart.most));
    text(out, [LEFT - 8.0, bottom], grey, "0");
    for (index, line) in chart.lines.iter().enumerate() {
        let Some((first, value)) = line.first() else { continue };
        let mut path = format!("M{:.1} {:.1}", LEFT + first, y_of(*value));
        for (x, value) in &line[1..] {
            let _ = write!(path, "H{:.1}V{:.1}", LEFT + x, y_of(*value));
        }
        let last = LEFT + line.last().map_or(0.0, |(x, _)| *x);
        match index {
            0 => {
                let _ = writeln!(
                    out,
                    "<path d=\"{path}\" stroke=\"#1b5e9b\" stroke-width=\"1.3\" fill=\"none\"/>\n<path d=\"{path}L{last:.1} {bottom:.1}H{:.1}Z\" fill=\"#1b5e9b\" fill-opacity=\"0.12\"/>",
                    LEFT + first
                );
            }
            _ => {
                let _ = writeln!(
                    out,
                    "<path d=\"{path}\" stroke=\"#b3541e\" stroke-width=\"1.3\" stroke-dasharray=\"5 3\" fill=\"none\"/>"
                );
                let style = "font-size=\"9.5\" fill=\"#b3541e\"";
                text(out, [LEFT + 4.0, y_of(*value) - 3.0], style, "target");
            }
        }
    }
}

fn value_words(title: &str, value: f64) -> String {
    match title {
        "bytes uploaded" => format!("{:.1} MiB", value / f64::from(1 << 20)),
        "frame time" => format!("{:.1} ms", value * 1e-3),
        _ => format!("{value:.0}"),
    }
}

/// Arrows from lane to lane, and the numbers of places; those too near each other share a ring.
fn draw_way(out: &mut String, way: &DrawnWay, middles: &[f64]) {
    let y_of = |lane: usize| middles.get(lane).copied().unwrap_or(0.0);
    // Lane, from, to, numbers; and the rings in the order of the way.
    let mut rings: Vec<(usize, [f64; 2], String)> = Vec::new();
    let mut order: Vec<usize> = Vec::new();
    for (number, (lane, x, _, _)) in way.places.iter().enumerate() {
        let words = (number + 1).to_string();
        let near = |(of, at, _): &&mut (usize, [f64; 2], String)| {
            of == lane && x - at[1] < 2.0 * RING + 2.0
        };
        let ring = rings.iter_mut().position(|ring| near(&ring));
        order.push(ring.unwrap_or(rings.len()));
        match ring {
            Some(ring) => {
                let (_, at, known) = &mut rings[ring];
                at[1] = *x;
                *known += &format!(" {words}");
            }
            None => rings.push((*lane, [*x; 2], words)),
        }
    }
    let middle = |at: &[f64; 2]| LEFT + (at[0] + at[1]) / 2.0;
    let half = |words: &str| RING.max(LETTER * words.len() as f64 / 2.0 + 3.0);
    let mut arrows = String::new();
    for pair in order.windows(2).filter(|pair| pair[0] != pair[1]) {
        let (from, to) = (&rings[pair[0]], &rings[pair[1]]);
        let [x0, y0] = [middle(&from.1), y_of(from.0)];
        let [x1, y1] = [middle(&to.1), y_of(to.0)];
        let long = (x1 - x0).hypot(y1 - y0).max(1e-9);
        // From ring to ring.
        let (dx, dy) = ((x1 - x0) / long, (y1 - y0) / long);
        let edge = |words: &str| if dy.abs() > 0.5 { RING } else { half(words) };
        if long <= edge(&from.2) + edge(&to.2) {
            continue;
        }
        let (begin, end) = (edge(&from.2), long - edge(&to.2));
        let at = |along: f64, aside: f64| {
            format!("{:.1} {:.1}", x0 + dx * along - dy * aside, y0 + dy * along + dx * aside)
        };
        let _ = write!(
            arrows,
            "M{}L{}M{}L{}L{}",
            at(begin, 0.0),
            at(end, 0.0),
            at(end - 7.0, 3.5),
            at(end, 0.0),
            at(end - 7.0, -3.5)
        );
    }
    for (stroke, width) in [("#fff", 4.5), (WAY, 1.5)] {
        let _ = writeln!(
            out,
            "<path d=\"{arrows}\" stroke=\"{stroke}\" stroke-width=\"{width}\" fill=\"none\"/>"
        );
    }
    for (lane, at, words) in &rings {
        let (x, y, half) = (middle(at), y_of(*lane), half(words));
        let _ = writeln!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{}\" rx=\"{RING}\" fill=\"#fff\" stroke=\"{WAY}\" stroke-width=\"1.4\"/>",
            x - half,
            y - RING,
            2.0 * half,
            2.0 * RING
        );
        text(
            out,
            [x, y + 3.5],
            "text-anchor=\"middle\" font-size=\"9.5\" font-weight=\"bold\"",
            words,
        );
    }
}

fn short(words: &str, letters_max: usize) -> String {
    match words.chars().count() > letters_max {
        true => words.chars().take(letters_max - 1).chain(['…']).collect(),
        false => words.to_owned(),
    }
}

fn text(out: &mut String, [x, y]: [f64; 2], attributes: &str, words: &str) {
    // XML has no place for control characters.
    let words: String = words.chars().filter(|letter| !letter.is_control()).collect();
    let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{words}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_axis_are_round() {
        for (least, step) in [(0.9, 1.0), (1.1, 2.0), (21.0, 50.0), (0.06, 0.1), (100.0, 100.0)] {
            assert!(
                (round_step(least) / step - 1.0).abs() < 1e-9,
                "{least}: {}",
                round_step(least)
            );
        }
    }

    #[test]
    fn words_cannot_break_the_picture() {
        let mut out = String::new();
        text(&mut out, [1.0, 2.0], "", &short("<a&b>\u{1}\n", 7));
        assert_eq!(out, "<text x=\"1.0\" y=\"2.0\" >&lt;a&amp;b&gt;</text>\n");
        assert_eq!(short("abcdef", 3), "ab…");
    }
}
