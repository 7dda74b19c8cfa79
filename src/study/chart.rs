//! Small charts as SVG, written by hand: both axes logarithmic, series told apart by dashes and marks,
//! not by colour alone.

use std::fmt::Write;

/// Points joined by a line.
#[derive(Clone, Debug)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// x, and y where there is one: without, the point stands above the panel, crossed.
    pub points: Vec<(f64, Option<f64>)>,
}

/// One pair of axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Beside its y axis.
    pub y_label: String,
    /// In the order of the legend.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 330.0;
const HEIGHT: f64 = 190.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 40.0;
const HEAD: f64 = 60.0;
/// Colour and dashes of each series; marks go with them.
const STYLES: [(&str, &str); 4] =
    [("#1b5e9b", ""), ("#b3541e", "6 4"), ("#4a7a2c", "2 3"), ("#6b4a8a", "9 3 2 3")];

/// Panels, `columns` of them in a row; `x_label` under each; what `missing` says stands in the legend
/// where a series lacks points.
pub fn svg(title: &str, x_label: &str, missing: &str, columns: usize, panels: &[Panel]) -> String {
    let columns = columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let (width, height) = (columns as f64 * WIDTH, HEAD + rows as f64 * HEIGHT);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    text(&mut out, [10.0, 20.0], "font-size=\"14\"", title);
    legend(&mut out, panels, missing);
    for (index, panel) in panels.iter().enumerate() {
        let (column, row) = (index % columns, index / columns);
        let (x, y) = (column as f64 * WIDTH, HEAD + row as f64 * HEIGHT);
        draw(&mut out, [x, y], panel, x_label);
    }
    out + "</svg>\n"
}

fn legend(out: &mut String, panels: &[Panel], missing: &str) {
    let mut x = 10.0;
    let series = panels.iter().max_by_key(|panel| panel.series.len());
    for (index, series) in series.iter().flat_map(|panel| &panel.series).enumerate() {
        line(out, index, &[(x, 40.0), (x + 30.0, 40.0)]);
        mark(out, index, (x + 15.0, 40.0));
        text(out, [x + 36.0, 44.0], "", &series.name);
        x += 60.0 + 6.5 * series.name.len() as f64;
    }
    let all = panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.points);
    if all.clone().any(|(_, y)| y.is_none()) {
        cross(out, (x + 6.0, 40.0));
        text(out, [x + 18.0, 44.0], "", missing);
    }
}

fn draw(out: &mut String, [left, top]: [f64; 2], panel: &Panel, x_label: &str) {
    let points = || panel.series.iter().flat_map(|series| &series.points);
    let xs = Scale::of(points().map(|(x, _)| *x), left + LEFT, left + WIDTH - RIGHT);
    let ys = Scale::of(points().filter_map(|(_, y)| *y), top + HEIGHT - BOTTOM, top + TOP);
    let (x0, x1) = (left + LEFT, left + WIDTH - RIGHT);
    let (y0, y1) = (top + HEIGHT - BOTTOM, top + TOP);
    text(out, [x0, top + 20.0], "font-weight=\"bold\"", &panel.title);
    let middle = (y0 + y1) / 2.0;
    let turned =
        format!("text-anchor=\"middle\" transform=\"rotate(-90 {:.1} {middle:.1})\"", left + 14.0);
    text(out, [left + 14.0, middle], &turned, &panel.y_label);
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
    let mut known: Vec<f64> = points().map(|(x, _)| *x).collect();
    known.sort_by(f64::total_cmp);
    let mut free = f64::NEG_INFINITY;
    for value in known {
        let (x, name) = (xs.at(value), number(value));
        let half = 3.5 * name.len() as f64;
        if x - half > free {
            free = x + half;
            *out += &frame(x, y0, x, y0 + 4.0, "#222");
            text(out, [x, y0 + 16.0], "text-anchor=\"middle\"", &name);
        }
    }
    *out += &frame(x0, y0, x1, y0, "#222");
    *out += &frame(x0, y0, x0, y1, "#222");
    for (index, series) in panel.series.iter().enumerate() {
        let there = series.points.iter().filter_map(|(x, y)| Some((xs.at(*x), ys.at((*y)?))));
        let there: Vec<(f64, f64)> = there.collect();
        line(out, index, &there);
        there.iter().for_each(|at| mark(out, index, *at));
        let absent = series.points.iter().filter(|(_, y)| y.is_none());
        absent.for_each(|(x, _)| cross(out, (xs.at(*x), y1 - 9.0)));
    }
}

/// From a value to its place on an axis, by logarithm.
struct Scale {
    least: f64,
    most: f64,
    from: f64,
    to: f64,
}

impl Scale {
    fn of(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Scale {
        let positive = values.filter(|value| *value > 0.0 && value.is_finite());
        let ends = positive.fold(None, |ends: Option<(f64, f64)>, value| {
            let (least, most) = ends.unwrap_or((value, value));
            Some((least.min(value), most.max(value)))
        });
        let (least, most) = ends.unwrap_or((1.0, 1.0));
        // Never less than a factor of two, so that what is nearly even looks so.
        let most = most.max(least * 2.0);
        let margin = (most / least).powf(0.06);
        Scale { least: least / margin, most: most * margin, from, to }
    }

    fn at(&self, value: f64) -> f64 {
        let part = (value / self.least).ln() / (self.most / self.least).ln();
        self.from + part * (self.to - self.from)
    }

    /// Round numbers: 1, 2, 5 in each decade, the powers of ten alone where those are many.
    fn ticks(&self) -> Vec<(f64, String)> {
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
    if value >= 10.0 { format!("{value:.0}") } else { format!("{}", (value * 1e3).round() / 1e3) }
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

/// A disc, a hollow square, a triangle, a hollow diamond.
fn mark(out: &mut String, style: usize, (x, y): (f64, f64)) {
    let (colour, _) = STYLES[style % STYLES.len()];
    let shape = match style % STYLES.len() {
        0 => "M-3.5 0A3.5 3.5 0 1 0 3.5 0A3.5 3.5 0 1 0 -3.5 0Z",
        1 => "M-3.5 -3.5H3.5V3.5H-3.5Z",
        2 => "M0 -4.5L4 3.5H-4Z",
        _ => "M0 -5L4 0L0 5L-4 0Z",
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
    fn points_lie_by_logarithm_and_missing_ones_are_crossed() {
        let scale = Scale::of([1.0, 100.0].into_iter(), 0.0, 1.0);
        assert!((scale.at(10.0) - 0.5).abs() < 1e-12);
        assert!(scale.ticks().iter().any(|(value, name)| *value == 10.0 && name == "10"));
        let points = vec![(8.0, None), (16.0, Some(1.0)), (32.0, Some(2.0))];
        let series = vec![Series { name: "a < b".to_owned(), points }];
        let panel = Panel { title: "t".to_owned(), y_label: "y".to_owned(), series };
        let drawn = svg("title", "slots", "never ends", 2, &[panel]);
        assert!(drawn.contains("never ends") && drawn.contains("a &lt; b"));
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
    }
}
