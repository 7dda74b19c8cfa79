//! The transfer function as a curve over the histogram, with points to drag.

use egui::{Color32, DragValue, Pos2, Rect, Sense, Shape, Stroke, Ui, pos2, vec2};

use crate::render::srgb_byte;
use crate::scene::{Channel, TransferFunction, TransferPoint};
use crate::viewer::overview::Histogram;
use crate::viewer::panels::WIDTH;

/// Which point of a channel's curve is held, and how high the curve is.
#[derive(Default)]
pub struct Curve {
    selected: Option<usize>,
    dragged: bool,
    /// Extinction at the upper edge; nothing: a little above the greatest.
    top: Option<f64>,
}

const HEIGHT: f32 = 110.0;
/// Points are held from so far, points of the screen.
const HELD_WITHIN: f32 = 9.0;
/// Extinctions span many decades: their cube root is drawn.
const POWER: f64 = 1.0 / 3.0;

/// Where the curve is drawn.
struct Frame {
    area: Rect,
    top: f64,
}

impl Frame {
    fn place(&self, point: &TransferPoint) -> Pos2 {
        let height = (point.extinction / self.top).clamp(0.0, 1.0).powf(POWER) as f32;
        let across = self.area.width() * point.at as f32;
        pos2(self.area.left() + across, self.area.bottom() - self.area.height() * height)
    }

    /// `at` and extinction of a place on the screen.
    fn values(&self, at: Pos2) -> (f64, f64) {
        let across = f64::from((at.x - self.area.left()) / self.area.width()).clamp(0.0, 1.0);
        let height = f64::from((self.area.bottom() - at.y) / self.area.height()).clamp(0.0, 1.0);
        (across, self.top * height.powf(1.0 / POWER))
    }
}

impl Curve {
    /// Whether the transfer function has changed.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        channel: &mut Channel,
        histogram: Option<&Histogram>,
    ) -> bool {
        let mut points = channel.transfer.points().to_vec();
        let greatest = points.iter().map(|point| point.extinction).fold(0.0, f64::max);
        if !self.dragged {
            self.top = Some(if greatest > 0.0 { 1.3 * greatest } else { 1.0 });
        }
        let size = vec2(WIDTH - 30.0, HEIGHT);
        let (response, painter) = ui.allocate_painter(size, Sense::click_and_drag());
        let frame = Frame { area: response.rect.shrink(6.0), top: self.top.unwrap_or(1.0) };
        painter.rect_filled(response.rect, 2.0, Color32::from_gray(20));
        if let Some(histogram) = histogram {
            bars(&painter, frame.area, histogram, channel.window);
        }
        let mut changed = false;
        if let Some(at) = response.interact_pointer_pos() {
            changed = self.touch(&frame, at, &response, &mut points);
        }
        self.dragged = response.dragged() && self.selected.is_some();
        draw(&painter, &frame, &points, self.selected);
        response.on_hover_text(
            "drag points; double-click adds one; right-click takes one away; height is the cube root of extinction",
        );
        changed |= self.fields(ui, &mut points);
        if changed && let Ok(transfer) = TransferFunction::new(points) {
            channel.transfer = transfer;
            return true;
        }
        false
    }

    /// What a hand does at a place of the curve.
    fn touch(
        &mut self,
        frame: &Frame,
        at: Pos2,
        response: &egui::Response,
        points: &mut Vec<TransferPoint>,
    ) -> bool {
        let near = || {
            let distance = |point: &TransferPoint| frame.place(point).distance(at);
            let places = points.iter().map(distance).enumerate();
            places.filter(|(_, far)| *far < HELD_WITHIN).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let near = near().map(|(index, _)| index);
        if response.drag_started() || response.clicked() {
            self.selected = near;
        }
        if response.secondary_clicked()
            && let Some(index) = near.filter(|_| points.len() > 1)
        {
            points.remove(index);
            self.selected = None;
            return true;
        }
        let (place, extinction) = frame.values(at);
        if response.double_clicked() && near.is_none() {
            let Ok(function) = TransferFunction::new(points.clone()) else { return false };
            let new = TransferPoint { at: place, extinction, ..function.at(place) };
            let index = points.partition_point(|point| point.at <= place);
            points.insert(index, new);
            self.selected = Some(index);
            return true;
        }
        let Some(index) = self.selected.filter(|index| *index < points.len()) else { return false };
        if !(response.dragged_by(egui::PointerButton::Primary)
            && response.drag_delta() != vec2(0.0, 0.0))
        {
            return false;
        }
        let before = index.checked_sub(1).map_or(0.0, |before| points[before].at);
        let after = points.get(index + 1).map_or(1.0, |after| after.at);
        points[index].at = place.clamp(before, after);
        points[index].extinction = extinction;
        true
    }

    /// The selected point in numbers.
    fn fields(&mut self, ui: &mut Ui, points: &mut [TransferPoint]) -> bool {
        let Some(index) = self.selected.filter(|index| *index < points.len()) else {
            ui.weak("click a point to set its colour");
            return false;
        };
        let before = index.checked_sub(1).map_or(0.0, |before| points[before].at);
        let after = points.get(index + 1).map_or(1.0, |after| after.at);
        let point = &mut points[index];
        let mut changed = false;
        ui.horizontal(|ui| {
            let place = DragValue::new(&mut point.at).speed(0.002).clamp_range(before..=after);
            changed |= ui.add(place.max_decimals(3)).changed();
            let mut color = point.color.map(|part| part as f32);
            if ui.color_edit_button_rgb(&mut color).changed() {
                point.color = color.map(f64::from);
                changed = true;
            }
            let speed = 0.02 * point.extinction.max(0.01);
            let extinction = DragValue::new(&mut point.extinction).speed(speed);
            changed |= ui.add(extinction.clamp_range(0.0..=f64::from(f32::MAX))).changed();
            ui.label("extinction");
        });
        changed
    }
}

/// Counts of the values in the window, logarithms.
fn bars(painter: &egui::Painter, area: Rect, histogram: &Histogram, [low, high]: [f64; 2]) {
    let most = histogram.bins.iter().copied().max().unwrap_or(0);
    let [first, last] = histogram.range;
    if most == 0 || !(low < high && first < last) {
        return;
    }
    let full = f64::from(most).ln_1p();
    let width = (last - first) / histogram.bins.len() as f64;
    for (index, count) in histogram.bins.iter().enumerate().filter(|(_, count)| **count > 0) {
        let ends = [0.0, 1.0].map(|end| {
            let value = first + (index as f64 + end) * width;
            area.left() + area.width() * ((value - low) / (high - low)) as f32
        });
        let ends = ends.map(|x| x.clamp(area.left(), area.right()));
        if ends[0] >= ends[1] {
            continue;
        }
        let height = area.height() * (f64::from(*count).ln_1p() / full) as f32;
        let top = area.bottom() - height;
        let bar = Rect::from_min_max(pos2(ends[0], top), pos2(ends[1], area.bottom()));
        painter.rect_filled(bar, 0.0, Color32::from_gray(58));
    }
}

fn draw(painter: &egui::Painter, frame: &Frame, points: &[TransferPoint], selected: Option<usize>) {
    let places: Vec<Pos2> = points.iter().map(|point| frame.place(point)).collect();
    if let (Some(first), Some(last)) = (places.first(), places.last()) {
        let ends = [pos2(frame.area.left(), first.y), pos2(frame.area.right(), last.y)];
        let mut line = vec![ends[0]];
        // Cube roots bend straight pieces.
        for (pair, between) in points.windows(2).zip(places.windows(2)) {
            line.push(between[0]);
            line.extend((1..8).map(|step| {
                let part = f64::from(step) / 8.0;
                let mix = |a: f64, b: f64| a + part * (b - a);
                frame.place(&TransferPoint {
                    at: mix(pair[0].at, pair[1].at),
                    color: pair[0].color,
                    extinction: mix(pair[0].extinction, pair[1].extinction),
                })
            }));
        }
        line.extend([*last, ends[1]]);
        painter.add(Shape::line(line, Stroke::new(1.5, Color32::from_gray(200))));
    }
    for (index, (point, place)) in points.iter().zip(&places).enumerate() {
        let [r, g, b] = point.color.map(|part| srgb_byte(part.min(1.0) as f32));
        let ring = if selected == Some(index) { Color32::WHITE } else { Color32::from_gray(140) };
        painter.circle(*place, 5.0, Color32::from_rgb(r, g, b), Stroke::new(1.5, ring));
    }
}
