//! What the machine does: the atlas slot by slot, bricks, rounds, passes, and queues side by side.

use std::collections::VecDeque;
use std::path::PathBuf;

use egui::{Color32, Mesh, Pos2, Rect, Sense, Shape, Stroke, Ui, pos2, vec2};

use crate::gpu::RoleKind;
use crate::render::paging::SlotBrick;
use crate::trace::summary::{joined, overlap};
use crate::trace::{Span, Track};
use crate::viewer::Shown;
use crate::viewer::panels::{Command, Doing, FileNames, WARNS, WIDTH};
use crate::viewer::report::percentiles;

/// See the module.
pub struct Machine {
    /// Of the last rounds, the newest last.
    rounds: VecDeque<Round>,
    /// The picture that the last of them is of.
    number: u64,
    /// What the atlas is coloured by.
    by: ColoredBy,
    /// The atlas as it was drawn last: of which picture, by what.
    atlas: Option<(u64, ColoredBy, Mesh)>,
    /// What happened lately, of the picture of this number.
    spans: (u64, Vec<Span>),
    trace: String,
}

/// One of the graphs' columns.
struct Round {
    ms: f64,
    bytes: u64,
    touched: u64,
    missed: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColoredBy {
    Level,
    Channel,
    Age,
}

impl ColoredBy {
    const ALL: [ColoredBy; 3] = [ColoredBy::Level, ColoredBy::Channel, ColoredBy::Age];

    fn name(self) -> &'static str {
        match self {
            ColoredBy::Level => "level",
            ColoredBy::Channel => "channel",
            ColoredBy::Age => "age",
        }
    }
}

/// Rounds that graphs show.
const ROUNDS_SHOWN: usize = 120;
/// Squares of the atlas's picture at most: of more slots several share one.
const SQUARES_MAX: usize = 4096;
/// Rounds after which a brick is old.
const OLD: u32 = 100;
/// Of what happened lately so much is drawn.
const LANES_NS: i64 = 400_000_000;
const FREE: Color32 = Color32::from_gray(38);
/// Okabe and Ito's colours, which every kind of colour blindness tells apart.
const COLORS: [Color32; 8] = [
    Color32::from_rgb(230, 159, 0),
    Color32::from_rgb(86, 180, 233),
    Color32::from_rgb(0, 158, 115),
    Color32::from_rgb(240, 228, 66),
    Color32::from_rgb(0, 114, 178),
    Color32::from_rgb(213, 94, 0),
    Color32::from_rgb(204, 121, 167),
    Color32::from_rgb(200, 200, 200),
];

impl Machine {
    pub fn new(names: &FileNames) -> Machine {
        Machine {
            rounds: VecDeque::new(),
            number: 0,
            by: ColoredBy::Level,
            atlas: None,
            spans: (0, Vec::new()),
            trace: names.trace.to_string_lossy().into_owned(),
        }
    }

    /// Writes what happened lately.
    pub fn save(&self) -> Command {
        Command::Trace(PathBuf::from(&self.trace))
    }

    /// Takes what is new.
    pub fn follow(&mut self, doing: &Doing<'_>) {
        let shown = doing.shown;
        if shown.number == self.number {
            return;
        }
        self.number = shown.number;
        self.spans = (shown.number, doing.trace.latest_spans(LANES_NS));
        if shown.converged {
            return;
        }
        self.rounds.push_back(Round {
            ms: shown.round_ms,
            bytes: shown.cache.bytes_uploaded,
            touched: shown.cache.touched,
            missed: shown.cache.missed,
        });
        if self.rounds.len() > ROUNDS_SHOWN {
            self.rounds.pop_front();
        }
    }

    /// The atlas, and what is in it and on its way.
    pub fn memory(&mut self, ui: &mut Ui, shown: &Shown) {
        let cache = &shown.cache;
        let used = cache.slots.iter().flatten().count();
        let all: u32 = cache.slots_of_atlas.iter().sum();
        let device = shown.statistics.as_ref().map_or(0, |of| of.device_bytes >> 20);
        ui.label(format!("{used} of {all} slots in use, device memory {device} MiB"));
        ui.horizontal(|ui| {
            ui.label("by");
            for by in ColoredBy::ALL {
                ui.selectable_value(&mut self.by, by, by.name());
            }
        });
        self.atlas(ui, shown);
        legend(ui, self.by, &cache.slots);
        egui::Grid::new("bricks").striped(true).show(ui, |ui| {
            let mib = |bytes: u64| format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20));
            let last = self.rounds.back();
            let hit = last.map(|round| (round.touched, round.touched + round.missed));
            let hit = hit.filter(|(_, all)| *all > 0);
            for (what, value) in [
                ("pending", cache.pending.to_string()),
                ("wanted, no slot yet", cache.wanted.to_string()),
                ("absent / hidden", format!("{} / {}", cache.absent, cache.hidden)),
                ("of one value", cache.constant.to_string()),
                (
                    "copied for this view",
                    format!("{}, {}", shown.bricks_uploaded, mib(cache.bytes_uploaded)),
                ),
                ("last round copied", mib(self.bytes_of_round(self.rounds.len().wrapping_sub(1)))),
                ("read back by a round", format!("{} bytes", cache.bytes_read_back)),
                (
                    "hits of the last round",
                    hit.map_or("-".to_owned(), |(hits, all)| {
                        format!("{:.1} %", 100.0 * hits as f64 / all as f64)
                    }),
                ),
            ] {
                ui.label(what);
                ui.label(value);
                ui.end_row();
            }
        });
        if cache.failed > 0 {
            let why = shown.statistics.as_ref().and_then(|of| of.first_failure.clone());
            let why = why.map_or(String::new(), |why| format!(", the first: {why}"));
            ui.colored_label(WARNS, format!("{} bricks failed{why}", cache.failed));
        }
        if let Some(unfinished) = shown.statistics.as_ref().and_then(|of| of.unfinished) {
            ui.colored_label(WARNS, unfinished.to_string());
        }
    }

    /// Bytes copied before a round of the graph; a new view counts anew.
    fn bytes_of_round(&self, index: usize) -> u64 {
        let Some(round) = self.rounds.get(index) else { return 0 };
        let before = index.checked_sub(1).and_then(|before| self.rounds.get(before));
        let before = before.map_or(0, |before| before.bytes);
        if before <= round.bytes { round.bytes - before } else { round.bytes }
    }

    fn atlas(&mut self, ui: &mut Ui, shown: &Shown) {
        let cache = &shown.cache;
        let slots: usize = cache.slots_of_atlas.iter().map(|slots| *slots as usize).sum();
        let each = slots.div_ceil(SQUARES_MAX).max(1);
        let squares = slots.div_ceil(each);
        let width = WIDTH - 30.0;
        let across = (squares as f32 * 2.5).sqrt().ceil().max(16.0) as usize;
        let edge = width / across as f32;
        let height = edge * squares.div_ceil(across) as f32;
        let (response, painter) = ui.allocate_painter(vec2(width, height.max(4.0)), Sense::hover());
        let stands = self
            .atlas
            .as_ref()
            .is_some_and(|(number, by, _)| (*number, *by) == (shown.number, self.by));
        if !stands {
            let mut mesh = Mesh::default();
            for square in 0..squares {
                let first = cache.slots.get(square * each..).unwrap_or_default();
                let brick = first.iter().take(each).flatten().next();
                let color = brick.map_or(FREE, |brick| self.by.color(brick, cache.round));
                let at = pos2((square % across) as f32 * edge, (square / across) as f32 * edge);
                let gap = if edge > 4.0 { 1.0 } else { 0.0 };
                mesh.add_colored_rect(Rect::from_min_size(at, vec2(edge - gap, edge - gap)), color);
            }
            self.atlas = Some((shown.number, self.by, mesh));
        }
        if let Some((_, _, mesh)) = &self.atlas {
            let mut mesh = mesh.clone();
            mesh.translate(response.rect.min.to_vec2());
            painter.add(Shape::mesh(mesh));
        }
        if let Some(pointer) = response.hover_pos() {
            let at: Pos2 = pointer - response.rect.min.to_vec2();
            let square = (at.y / edge) as usize * across + (at.x / edge) as usize;
            let what = match cache.slots.get(square * each) {
                Some(Some(brick)) => format!(
                    "slot {}: channel {}, level {}, came {} rounds ago",
                    square * each,
                    brick.brick.channel,
                    brick.brick.level,
                    cache.round.wrapping_sub(brick.since)
                ),
                _ => format!("slot {}: free", square * each),
            };
            response.on_hover_text(what);
        }
    }

    /// Rounds, the last picture's passes, and queues side by side.
    pub fn time(&mut self, ui: &mut Ui, doing: &Doing<'_>) -> Vec<Command> {
        let shown = doing.shown;
        let mut commands = Vec::new();
        ui.label(if shown.converged { "converged" } else { "drawing" });
        let [_, p95, _, worst] = percentiles(self.rounds.iter().map(|round| round.ms as f32));
        if let Some(last) = self.rounds.back() {
            ui.label(format!("round {:.0} ms, p95 {p95:.0} ms, worst {worst:.0} ms", last.ms));
            self.graph(ui, worst.into(), doing.frame_ms);
        }
        if let Some(statistics) = &shown.statistics {
            ui.label(format!(
                "finished: {} rounds, {:.0} ms, {} M samples",
                statistics.rounds,
                statistics.wall_ms,
                statistics.samples / 1_000_000
            ));
            let on_device = statistics.gpu_ms_total();
            ui.label(format!("of that by the device's clock {on_device:.0} ms:"));
            egui::Grid::new("passes").striped(true).show(ui, |ui| {
                for time in &statistics.gpu_ms {
                    ui.label(&time.pass);
                    ui.label(format!("{:.1} ms", time.ms));
                    ui.end_row();
                }
            });
        }
        lanes(ui, &self.spans.1);
        ui.horizontal(|ui| {
            let records = ui.button("trace").on_hover_text(
                "what happened lately, as a file for Perfetto: the window keeps the last 100,000 events",
            );
            if records.clicked() {
                commands.push(self.save());
            }
            ui.add(egui::TextEdit::singleline(&mut self.trace).desired_width(170.0));
        });
        commands
    }

    /// A column for each round, the newest on the right; below it, what it copied.
    fn graph(&self, ui: &mut Ui, worst: f64, target: f64) {
        let (response, painter) = ui.allocate_painter(vec2(WIDTH - 30.0, 76.0), Sense::hover());
        let area = response.rect;
        painter.rect_filled(area, 2.0, Color32::from_gray(20));
        let copied: Vec<u64> = (0..self.rounds.len()).map(|at| self.bytes_of_round(at)).collect();
        let most = copied.iter().copied().max().unwrap_or(0).max(1) as f64;
        let width = area.width() / ROUNDS_SHOWN as f32;
        let middle = area.top() + 0.7 * area.height();
        for (at, (round, bytes)) in self.rounds.iter().zip(&copied).rev().enumerate() {
            let right = area.right() - at as f32 * width;
            let column = |bottom: f32, height: f32, part: f64, color: Color32| {
                let top = bottom - height * part as f32;
                let from = pos2(right - width * 0.8, top);
                painter.rect_filled(Rect::from_min_max(from, pos2(right, bottom)), 0.0, color);
            };
            column(middle, 0.7 * area.height(), round.ms / worst.max(1e-3), COLORS[1]);
            let below = area.bottom() - middle - 3.0;
            column(area.bottom(), below, *bytes as f64 / most, COLORS[0]);
        }
        if target < worst {
            let y = middle - 0.7 * area.height() * (target / worst) as f32;
            let ends = [pos2(area.left(), y), pos2(area.right(), y)];
            painter.line_segment(ends, Stroke::new(1.0, COLORS[3]));
        }
        response
            .on_hover_text("above: milliseconds of the last rounds, and what one may take while something moves; below: bytes that each copied");
    }
}

impl ColoredBy {
    fn color(self, brick: &SlotBrick, round: u32) -> Color32 {
        match self {
            ColoredBy::Level => COLORS[usize::from(brick.brick.level) % COLORS.len()],
            ColoredBy::Channel => COLORS[usize::from(brick.brick.channel) % COLORS.len()],
            ColoredBy::Age => {
                let age = round.wrapping_sub(brick.since).min(OLD) as f32 / OLD as f32;
                let grey = |new: u8, old: u8| {
                    (f32::from(new) + age * (f32::from(old) - f32::from(new))) as u8
                };
                Color32::from_rgb(grey(253, 60), grey(231, 50), grey(37, 90))
            }
        }
    }
}

/// What colours say.
fn legend(ui: &mut Ui, by: ColoredBy, slots: &[Option<SlotBrick>]) {
    let mut counts = [0usize; COLORS.len()];
    for brick in slots.iter().flatten() {
        let of = if by == ColoredBy::Level {
            usize::from(brick.brick.level)
        } else {
            usize::from(brick.brick.channel)
        };
        counts[of % COLORS.len()] += 1;
    }
    ui.horizontal_wrapped(|ui| match by {
        ColoredBy::Age => {
            ui.weak(format!("yellow: new; dark: came {OLD} rounds ago or earlier"));
        }
        ColoredBy::Level | ColoredBy::Channel => {
            for (number, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
                ui.colored_label(COLORS[number], format!("{} {number}: {count}", by.name()));
            }
        }
    });
}

/// Host, loaders and queues over one stretch of time, and how much of the copies' time the rays' hid.
fn lanes(ui: &mut Ui, spans: &[Span]) {
    let Some(end) = spans.iter().map(|span| span.end_ns).max() else { return };
    let begin = end - LANES_NS;
    let mut tracks: Vec<Track> = spans.iter().map(|span| span.track).collect();
    tracks.sort();
    tracks.dedup();
    let height = 12.0 * tracks.len() as f32;
    let (response, painter) = ui.allocate_painter(vec2(WIDTH - 30.0, height), Sense::hover());
    let area = response.rect;
    painter.rect_filled(area, 2.0, Color32::from_gray(20));
    let across = |ns: i64| {
        let part = (ns - begin).clamp(0, LANES_NS) as f32 / LANES_NS as f32;
        area.left() + part * area.width()
    };
    let mut names: Vec<&str> = Vec::new();
    for span in spans {
        let row = tracks.iter().position(|track| *track == span.track).unwrap_or(0);
        let top = area.top() + 12.0 * row as f32 + 1.0;
        let number = names.iter().position(|name| *name == span.name).unwrap_or_else(|| {
            names.push(span.name);
            names.len() - 1
        });
        let ends = [across(span.begin_ns), across(span.end_ns)];
        let right = ends[1].max(ends[0] + 0.5);
        let bar = Rect::from_min_max(pos2(ends[0], top), pos2(right, top + 10.0));
        painter.rect_filled(bar, 0.0, COLORS[number % COLORS.len()].gamma_multiply(0.6));
    }
    for row in 1..tracks.len() {
        let y = area.top() + 12.0 * row as f32;
        painter.line_segment(
            [pos2(area.left(), y), pos2(area.right(), y)],
            Stroke::new(0.5, Color32::from_gray(60)),
        );
    }
    let under = response.hover_pos().and_then(|at| {
        let track = tracks.get(((at.y - area.top()) / 12.0) as usize)?;
        let ns = begin + ((at.x - area.left()) / area.width() * LANES_NS as f32) as i64;
        let within =
            |span: &&Span| span.track == *track && (span.begin_ns..=span.end_ns).contains(&ns);
        let span = spans.iter().filter(within).min_by_key(|span| span.end_ns - span.begin_ns);
        Some(match span {
            Some(span) => {
                let ms = (span.end_ns - span.begin_ns) as f64 * 1e-6;
                format!("{}: {} {ms:.2} ms", name_of(*track), span.name)
            }
            None => name_of(*track),
        })
    });
    if let Some(under) = under {
        response.on_hover_text(under);
    }
    let rows: Vec<String> = tracks.iter().map(|track| name_of(*track)).collect();
    ui.weak(format!("last {} ms: {}", LANES_NS / 1_000_000, rows.join(", ")));
    if let Some(hidden) = hidden_part(spans) {
        ui.label(format!("{:.0} % of the copies' time lay beside rendering", 100.0 * hidden));
    }
}

fn name_of(track: Track) -> String {
    match track {
        Track::Host => "drawing thread".to_owned(),
        Track::Loader(number) => format!("loader {number}"),
        Track::Queue(RoleKind::Render) => "render queue".to_owned(),
        Track::Queue(RoleKind::Transfer) => "transfer queue".to_owned(),
    }
}

/// Of the time in which the transfer queue copied, the part in which the render queue worked, too.
fn hidden_part(spans: &[Span]) -> Option<f64> {
    let busy = |role: RoleKind| {
        let of_role = spans.iter().filter(|span| span.track == Track::Queue(role));
        joined(of_role.map(|span| [span.begin_ns, span.end_ns].map(|ns| ns as f64)).collect())
    };
    overlap(&busy(RoleKind::Transfer), &busy(RoleKind::Render))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Details;

    #[test]
    fn overlap_is_the_part_of_copies_beside_rays() {
        let span = |role, begin_ns, end_ns| Span {
            track: Track::Queue(role),
            name: "it",
            begin_ns,
            end_ns,
            details: Details::None,
        };
        let (copy, rays) = (RoleKind::Transfer, RoleKind::Render);
        assert_eq!(hidden_part(&[span(rays, 0, 9)]), None);
        let spans = [span(copy, 0, 10), span(copy, 5, 20), span(rays, 15, 30), span(rays, 4, 6)];
        assert_eq!(hidden_part(&spans), Some(7.0 / 20.0));
        assert_eq!(hidden_part(&[span(copy, 0, 10), span(rays, 10, 20)]), Some(0.0));
    }
}
