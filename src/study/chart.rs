//! Small charts as SVG, written by hand: both axes logarithmic, unless a panel says otherwise, series told apart by dashes and marks,
//! not by colour alone.

use std::fmt::Write;

/// Points joined by a line.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// x, and y where there is one: without, the point stands above the panel, crossed.
    pub points: Vec<(f64, Option<f64>)>,
    /// Beside each point; none where there are none.
    pub labels: Vec<String>,
    /// Points stand alone, without a line.
    pub apart: bool,
}

/// One pair of axes.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Beside its y axis.
    pub y_label: String,
    /// In the order of the legend.
    pub series: Vec<Series>,
    /// Joined by a broad line behind everything, ringed, and named "Pareto front" in the legend.
    pub front: Vec<(f64, f64)>,
    /// y is an error with peak 1: on the right stands what it is in dB.
    pub decibels: bool,
    /// x is marked at round numbers, not at the points.
    pub round_x: bool,
    /// Both axes from 0 on, in even steps.
    pub linear: bool,
}

/// Of a panel, unless said.
const SIZE: [f64; 2] = [330.0, 190.0];
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
/// Of panels that have dB on the right.
const RIGHT_DECIBELS: f64 = 52.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 40.0;
const HEAD: f64 = 60.0;
/// Between rows of the legend.
const LEGEND_ROW: f64 = 18.0;
const FRONT: &str = "#e8c24a";
/// Colour and dashes of each series; marks go with them. As many as a study has series at most: two for
/// each of three integrators, and one for each other axis.
const STYLES: [(&str, &str); 11] = [
    ("#1b5e9b", ""),
    ("#b3541e", "6 4"),
    ("#4a7a2c", "2 3"),
    ("#6b4a8a", "9 3 2 3"),
    ("#a3285f", "12 4"),
    ("#2a7f86", "4 2"),
    ("#6b5b2e", "1 2"),
    ("#444444", "8 2 2 2"),
    ("#8a1f1f", "3 6"),
    ("#3f6fd1", "10 2"),
    ("#5a7d00", "5 5"),
];

/// Panels, `columns` of them in a row; `x_label` under each; what `missing` says stands in the legend
/// where a series lacks points.
pub fn svg(title: &str, x_label: &str, missing: &str, columns: usize, panels: &[Panel]) -> String {
    svg_of(title, x_label, missing, columns, panels, SIZE)
}

/// As [`svg`], with panels of `size` (across, down).
pub fn svg_of(
    title: &str,
    x_label: &str,
    missing: &str,
    columns: usize,
    panels: &[Panel],
    size: [f64; 2],
) -> String {
    let columns = columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let width = columns as f64 * size[0];
    let (legend, legend_rows) = legend(panels, missing, width);
    let head = HEAD + (legend_rows - 1) as f64 * LEGEND_ROW;
    let height = head + rows as f64 * size[1];
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    text(&mut out, [10.0, 20.0], "font-size=\"14\"", title);
    out += &legend;
    for (index, panel) in panels.iter().enumerate() {
        let (column, row) = (index % columns, index / columns);
        let (x, y) = (column as f64 * size[0], head + row as f64 * size[1]);
        draw(&mut out, [x, y], size, panel, x_label);
    }
    out + "</svg>\n"
}

/// The legend, and how many rows it takes in `width`.
fn legend(panels: &[Panel], missing: &str, width: f64) -> (String, usize) {
    let (mut out, mut x, mut y) = (String::new(), 10.0, 40.0);
    let mut place = |wide: f64| {
        if x > 10.0 && x + wide > width {
            (x, y) = (10.0, y + LEGEND_ROW);
        }
        x += wide;
        [x - wide, y]
    };
    let wide = |words: &str| 60.0 + 6.5 * words.chars().count() as f64;
    let longest = panels.iter().max_by_key(|panel| panel.series.len());
    for (index, series) in longest.iter().flat_map(|panel| &panel.series).enumerate() {
        let [x, y] = place(wide(&series.name));
        if !series.apart {
            line(&mut out, index, &[(x, y), (x + 30.0, y)]);
        }
        mark(&mut out, index, (x + 15.0, y));
        text(&mut out, [x + 36.0, y + 4.0], "", &series.name);
    }
    if panels.iter().any(|panel| !panel.front.is_empty()) {
        let [x, y] = place(wide("Pareto front"));
        let x = x + 8.0;
        front(&mut out, &[(x, y), (x + 24.0, y)]);
        text(&mut out, [x + 36.0, y + 4.0], "", "Pareto front");
    }
    let mut all = panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.points);
    if all.any(|(_, y)| y.is_none()) {
        let [x, y] = place(wide(missing));
        cross(&mut out, (x + 6.0, y));
        text(&mut out, [x + 18.0, y + 4.0], "", missing);
    }
    (out, ((y - 40.0) / LEGEND_ROW).round() as usize + 1)
}

fn draw(out: &mut String, [left, top]: [f64; 2], size: [f64; 2], panel: &Panel, x_label: &str) {
    let [width, height] = size;
    let right = if panel.decibels { RIGHT_DECIBELS } else { RIGHT };
    let points = || panel.series.iter().flat_map(|series| &series.points);
    let (x0, x1) = (left + LEFT, left + width - right);
    let (y0, y1) = (top + height - BOTTOM, top + TOP);
    let scale = if panel.linear { Scale::linear } else { Scale::of };
    let xs = scale(&mut points().map(|(x, _)| *x), x0, x1);
    let ys = scale(&mut points().filter_map(|(_, y)| *y), y0, y1);
    text(out, [x0, top + 20.0], "font-weight=\"bold\"", &panel.title);
    let middle = (y0 + y1) / 2.0;
    let turned =
        |x: f64| format!("text-anchor=\"middle\" transform=\"rotate(-90 {x:.1} {middle:.1})\"");
    text(out, [left + 14.0, middle], &turned(left + 14.0), &panel.y_label);
    text(out, [(x0 + x1) / 2.0, y0 + 32.0], "text-anchor=\"middle\"", x_label);
    let frame = |x0: f64, y0: f64, x1: f64, y1: f64, colour| {
        format!(
            "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"{colour}\" fill=\"none\"/>\n"
        )
    };
    for (value, name) in ys.ticks() {
        let y = ys.at(value);
        *out += &frame(x0, y, x1, y, "#ddd");
        text(out, [x0 - 5.0, y + 4.0], "text-anchor=\"end\"", &name);
    }
    if panel.decibels {
        for db in (-60..=200).step_by(10) {
            let error = 10f64.powf(-f64::from(db) / 20.0);
            if (ys.least..=ys.most).contains(&error) {
                let y = ys.at(error);
                *out += &frame(x1, y, x1 + 4.0, y, "#222");
                text(out, [x1 + 7.0, y + 4.0], "", &format!("{db} dB"));
            }
        }
        *out += &frame(x1, y0, x1, y1, "#222");
    }
    let known = || points().map(|(x, _)| (*x, number(*x)));
    let mut marked: Vec<_> = if panel.round_x { xs.ticks() } else { known().collect() };
    marked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = f64::NEG_INFINITY;
    for (value, name) in marked {
        let x = xs.at(value);
        let half = 3.5 * name.len() as f64;
        if x - half > free {
            free = x + half;
            if panel.round_x {
                *out += &frame(x, y0, x, y1, "#eee");
            }
            *out += &frame(x, y0, x, y0 + 4.0, "#222");
            text(out, [x, y0 + 16.0], "text-anchor=\"middle\"", &name);
        }
    }
    *out += &frame(x0, y0, x1, y0, "#222");
    *out += &frame(x0, y0, x0, y1, "#222");
    let best: Vec<_> = panel.front.iter().map(|(x, y)| (xs.at(*x), ys.at(*y))).collect();
    if !best.is_empty() {
        front(out, &best);
    }
    let place = |(x, y): &(f64, Option<f64>)| Some((xs.at(*x), ys.at((*y)?)));
    // No words on a mark.
    let of_mark = |(x, y): (f64, f64)| [x - 4.0, y - 4.0, x + 4.0, y + 4.0];
    let mut taken: Vec<[f64; 4]> = points().filter_map(place).map(of_mark).collect();
    for (index, series) in panel.series.iter().enumerate() {
        let there: Vec<(f64, f64)> = series.points.iter().filter_map(place).collect();
        if !series.apart {
            line(out, index, &there);
        }
        there.iter().for_each(|at| mark(out, index, *at));
        let absent = series.points.iter().filter(|(_, y)| y.is_none());
        absent.for_each(|(x, _)| cross(out, (xs.at(*x), y1 - 9.0)));
    }
    for (index, series) in panel.series.iter().enumerate() {
        for (point, words) in series.points.iter().zip(&series.labels) {
            if let Some(at) = place(point).filter(|_| !words.is_empty()) {
                label(out, index, at, words, [x0, x1], &mut taken);
            }
        }
    }
}

/// Words beside a point, in the first of four places that is free and within the panel, if any is.
fn label(
    out: &mut String,
    style: usize,
    at: (f64, f64),
    words: &str,
    within: [f64; 2],
    taken: &mut Vec<[f64; 4]>,
) {
    let (colour, _) = STYLES[style % STYLES.len()];
    let (wide, high) = (5.4 * words.chars().count() as f64, 11.0);
    let places = [(7.0, -4.0), (7.0, 13.0), (-7.0 - wide, -4.0), (-7.0 - wide, 13.0)];
    for (dx, dy) in places {
        let (x, y) = (at.0 + dx, at.1 + dy);
        let [left, top, right, bottom] = [x - 3.0, y - high, x + wide + 3.0, y];
        let meets = |other: &[f64; 4]| {
            left < other[2] && right > other[0] && top < other[3] && bottom > other[1]
        };
        if left >= within[0] && right <= within[1] && !taken.iter().any(meets) {
            taken.push([left, top, right, bottom]);
            text(
                out,
                [x, y],
                &format!(
                    "font-size=\"9.5\" fill=\"{colour}\" paint-order=\"stroke\" stroke=\"#fff\" stroke-width=\"2.5\""
                ),
                words,
            );
            return;
        }
    }
}

/// A broad line, and rings that show around marks.
fn front(out: &mut String, points: &[(f64, f64)]) {
    let joined: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{FRONT}\" stroke-opacity=\"0.55\" stroke-width=\"7\" stroke-linejoin=\"round\"/>",
        joined.join(" ")
    );
    for (x, y) in points {
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7.5\" fill=\"{FRONT}\" fill-opacity=\"0.75\"/>"
        );
    }
}

/// From a value to its place on an axis, by logarithm or evenly.
struct Scale {
    linear: bool,
    least: f64,
    most: f64,
    from: f64,
    to: f64,
}

impl Scale {
    fn of(values: &mut dyn Iterator<Item = f64>, from: f64, to: f64) -> Scale {
        let positive = values.filter(|value| *value > 0.0 && value.is_finite());
        let ends = positive.fold(None, |ends: Option<(f64, f64)>, value| {
            let (least, most) = ends.unwrap_or((value, value));
            Some((least.min(value), most.max(value)))
        });
        let (least, most) = ends.unwrap_or((1.0, 1.0));
        // Never less than a factor of two, so that what is nearly even looks so.
        let most = most.max(least * 2.0);
        let margin = (most / least).powf(0.06);
        Scale { linear: false, least: least / margin, most: most * margin, from, to }
    }

    fn linear(values: &mut dyn Iterator<Item = f64>, from: f64, to: f64) -> Scale {
        let most = values.filter(|value| value.is_finite()).fold(0.0, f64::max);
        Scale {
            linear: true,
            least: 0.0,
            most: if most > 0.0 { 1.05 * most } else { 1.0 },
            from,
            to,
        }
    }

    fn at(&self, value: f64) -> f64 {
        let part = match self.linear {
            true => value / self.most,
            false => (value / self.least).ln() / (self.most / self.least).ln(),
        };
        self.from + part * (self.to - self.from)
    }

    /// Round numbers: 1, 2, 5 in each decade, the powers of ten alone where those are many.
    fn ticks(&self) -> Vec<(f64, String)> {
        if self.linear {
            let decade = 10f64.powf((self.most / 5.0).log10().floor());
            let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * decade);
            let step = steps.into_iter().find(|step| self.most / step <= 6.0).unwrap_or(decade);
            let count = (self.most / step) as u32;
            return (0..=count)
                .map(|at| (f64::from(at) * step, number(f64::from(at) * step)))
                .collect();
        }
        let decades = (self.most / self.least).log10();
        let steps: &[f64] = if decades > 3.0 { &[1.0] } else { &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0] };
        let steps = if decades > 1.0 && decades <= 3.0 { &[1.0, 2.0, 5.0] } else { steps };
        let powers = self.least.log10().floor() as i32..=self.most.log10().ceil() as i32;
        let all = powers.flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)));
        let inside = all.filter(|value| (self.least..=self.most).contains(value));
        inside.map(|value| (value, number(value))).collect()
    }
}

fn number(value: f64) -> String {
    match value {
        _ if value >= 10.0 => format!("{value:.0}"),
        _ if value > 0.0 && value < 1e-3 => format!("{value:.0e}"),
        _ => format!("{}", (value * 1e3).round() / 1e3),
    }
}

fn line(out: &mut String, style: usize, points: &[(f64, f64)]) {
    let (colour, dashes) = STYLES[style % STYLES.len()];
    let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" stroke-dasharray=\"{dashes}\"/>",
        points.join(" ")
    );
}

/// Shapes, filled and hollow in turn.
fn mark(out: &mut String, style: usize, (x, y): (f64, f64)) {
    let (colour, _) = STYLES[style % STYLES.len()];
    let shape = match style % STYLES.len() {
        0 => "M-3.5 0A3.5 3.5 0 1 0 3.5 0A3.5 3.5 0 1 0 -3.5 0Z",
        1 => "M-3.5 -3.5H3.5V3.5H-3.5Z",
        2 => "M0 -4.5L4 3.5H-4Z",
        3 => "M0 -5L4 0L0 5L-4 0Z",
        4 => "M-3.5 -3.5H3.5V3.5H-3.5Z",
        5 => "M-3.5 0A3.5 3.5 0 1 0 3.5 0A3.5 3.5 0 1 0 -3.5 0Z",
        6 => "M0 -5L4 0L0 5L-4 0Z",
        7 => "M0 4.5L4 -3.5H-4Z",
        8 => "M0 4.5L4 -3.5H-4Z",
        9 => "M0 -4.5L4 3.5H-4Z",
        _ => "M-4.5 -1.5H-1.5V-4.5H1.5V-1.5H4.5V1.5H1.5V4.5H-1.5V1.5H-4.5Z",
    };
    let fill = if style.is_multiple_of(2) { colour } else { "#fff" };
    let _ = writeln!(
        out,
        "<path transform=\"translate({x:.1} {y:.1})\" d=\"{shape}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"/>"
    );
}

fn cross(out: &mut String, (x, y): (f64, f64)) {
    let _ = writeln!(
        out,
        "<path transform=\"translate({x:.1} {y:.1})\" d=\"M-4 -4L4 4M-4 4L4 -4\" stroke=\"#222\" stroke-width=\"1.8\"/>"
    );
}

fn text(out: &mut String, [x, y]: [f64; 2], attributes: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{words}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_axes_begin_at_nothing() {
        let scale = Scale::linear(&mut [3.0, 40.0].into_iter(), 0.0, 1.0);
        assert!((scale.at(21.0) - 0.5).abs() < 1e-12 && scale.at(0.0) == 0.0);
        let names: Vec<String> = scale.ticks().into_iter().map(|(_, name)| name).collect();
        assert_eq!(names, ["0", "10", "20", "30", "40"]);
    }

    #[test]
    fn points_lie_by_logarithm_and_missing_ones_are_crossed() {
        let scale = Scale::of(&mut [1.0, 100.0].into_iter(), 0.0, 1.0);
        assert!((scale.at(10.0) - 0.5).abs() < 1e-12);
        assert!(scale.ticks().iter().any(|(value, name)| *value == 10.0 && name == "10"));
        let points = vec![(8.0, None), (16.0, Some(1.0)), (32.0, Some(2.0))];
        let labels = vec![String::new(), "first".to_owned(), "second".to_owned()];
        let series = vec![Series { name: "a < b".to_owned(), points, labels, apart: true }];
        let front = vec![(16.0, 1.0)];
        let (title, y_label) = ("t".to_owned(), "y".to_owned());
        let panel =
            Panel { title, y_label, series, front, decibels: true, round_x: true, linear: false };
        let drawn = svg("title", "slots", "never ends", 2, &[panel]);
        assert!(drawn.contains("never ends") && drawn.contains("a &lt; b"));
        for words in ["first", "second", "Pareto front", "0 dB"] {
            assert!(drawn.contains(words), "{words}");
        }
        assert!(!drawn.contains("stroke-width=\"1.6\""), "points that stand alone have no line");
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
    }
}
