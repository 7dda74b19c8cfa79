//! Distances from click to click, in the volume.

use egui::{Color32, Painter, Rect, Stroke, pos2};

use crate::scene::View;
use crate::viewer::overview::Met;

/// See the module.
#[derive(Default)]
pub struct Distances {
    /// Whether clicks are taken.
    pub on: bool,
    first: Option<Met>,
    pairs: Vec<[Met; 2]>,
    /// A line for each pair.
    pub lines: Vec<String>,
}

const LINE: Color32 = Color32::from_rgb(240, 228, 66);

impl Distances {
    /// Takes a click: what its ray met, or nothing.
    pub fn take(&mut self, met: Option<Met>) {
        let Some(met) = met else {
            self.lines.push("that ray meets nothing that is shown".to_owned());
            return;
        };
        let Some(first) = self.first.take() else {
            self.first = Some(met);
            return;
        };
        let length = (met.at - first.at).length();
        // Both ends may be off, along their rays.
        let within = first.within + met.within;
        self.lines.push(format!("{length:.4}, within {within:.1e}, world units"));
        self.pairs.push([first, met]);
    }

    /// Takes no more clicks, and forgets.
    pub fn end(&mut self) {
        *self = Distances::default();
    }

    /// Lines and ends over a picture of `size` pixels that lies in `area`.
    pub fn draw(&self, painter: &Painter, area: Rect, view: &View, size: [u32; 2]) {
        let place = |met: &Met| {
            let [column, row] = view.pixel_of(met.at, size)?;
            let across = area.width() * (column / f64::from(size[0])) as f32;
            let down = area.height() * (row / f64::from(size[1])) as f32;
            Some(pos2(area.left() + across, area.top() + down))
        };
        let painter = painter.with_clip_rect(area);
        let ends = self.pairs.iter().flatten().chain(&self.first);
        for end in ends.filter_map(place) {
            painter.circle_stroke(end, 4.0, Stroke::new(1.5, LINE));
        }
        for [a, b] in &self.pairs {
            if let (Some(a), Some(b)) = (place(a), place(b)) {
                painter.line_segment([a, b], Stroke::new(1.5, LINE));
            }
        }
    }
}
