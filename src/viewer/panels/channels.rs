//! Channels: shown or not, window over the histogram, transfer function, levels.

use egui::{DragValue, RichText, Ui};

use crate::scene::{Channel, ColorMap};
use crate::viewer::error_meter::Measured;
use crate::viewer::overview::Histogram;
use crate::viewer::panels::curve::Curve;

/// See the module.
pub struct ChannelsPanel {
    curves: Vec<Curve>,
    levels: u8,
}

impl ChannelsPanel {
    pub fn new(channels: usize, levels: u8) -> ChannelsPanel {
        ChannelsPanel { curves: (0..channels).map(|_| Curve::default()).collect(), levels }
    }

    /// Whether any has changed. `original`: as the scene was opened.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        (channels, original): (&mut [Channel], &[Channel]),
        hidden: &mut [bool],
        measured: &Measured,
    ) -> bool {
        let mut changed = false;
        let overview = measured.overview.as_ref().and_then(|read| read.as_ref().ok());
        for (at, (channel, original)) in channels.iter_mut().zip(original).enumerate() {
            let histogram = overview.and_then(|overview| overview.histograms.get(at));
            ui.push_id(at, |ui| {
                changed |= head(ui, channel, original, &mut hidden[at]);
                changed |= self.curves[at].show(ui, channel, histogram);
                changed |= window(ui, channel, original, histogram);
                changed |= levels(ui, channel, self.levels);
                ui.add_space(6.0);
            });
        }
        changed
    }
}

fn head(ui: &mut Ui, channel: &mut Channel, original: &Channel, hidden: &mut bool) -> bool {
    let mut changed = false;
    ui.horizontal(|ui| {
        let mut visible = !*hidden;
        let name = format!("channel {}", channel.index);
        if ui.checkbox(&mut visible, RichText::new(name).strong()).changed() {
            *hidden = !visible;
            changed = true;
        }
        if ui.small_button("reset").clicked() {
            *channel = original.clone();
            *hidden = false;
            changed = true;
        }
        ui.menu_button("colours", |ui| {
            for map in ColorMap::ALL {
                if ui.button(map.name()).clicked() {
                    channel.transfer = map.over(&channel.transfer);
                    changed = true;
                    ui.close_menu();
                }
            }
        });
    });
    changed
}

/// Both ends, and the same as level and width.
fn window(
    ui: &mut Ui,
    channel: &mut Channel,
    original: &Channel,
    histogram: Option<&Histogram>,
) -> bool {
    let [lo, hi] = original.window;
    let speed = (hi - lo) / 500.0;
    let mut changed = false;
    ui.horizontal(|ui| {
        ui.label("window");
        let [low, high] = &mut channel.window;
        let least = (*high - *low).abs().max(speed) * 1e-3;
        let from = DragValue::new(low).speed(speed).clamp_range(f64::MIN..=*high - least);
        changed |= ui.add(from).changed();
        let to = DragValue::new(high).speed(speed).clamp_range(*low + least..=f64::MAX);
        changed |= ui.add(to).changed();
        let range = histogram.map(|histogram| histogram.range).filter(|[lo, hi]| lo < hi);
        if let Some(range) = range
            && ui
                .small_button("all")
                .on_hover_text("from the least value to the greatest")
                .clicked()
        {
            channel.window = range;
            changed = true;
        }
    });
    ui.horizontal(|ui| {
        ui.label("level");
        let [low, high] = channel.window;
        let (mut level, mut width) = ((low + high) / 2.0, high - low);
        let moved = ui.add(DragValue::new(&mut level).speed(speed)).changed();
        ui.label("width");
        let least = speed.abs() * 1e-3;
        let widens = DragValue::new(&mut width).speed(speed).clamp_range(least..=f64::MAX);
        if ui.add(widens).changed() | moved {
            channel.window = [level - width / 2.0, level + width / 2.0];
            changed = true;
        }
    });
    changed
}

/// Finest and coarsest level at which it is drawn.
fn levels(ui: &mut Ui, channel: &mut Channel, levels: u8) -> bool {
    if levels < 2 {
        return false;
    }
    let last = levels - 1;
    let mut changed = false;
    ui.horizontal(|ui| {
        ui.label("levels");
        let coarsest = channel.level_max.unwrap_or(last).min(last);
        let finest = DragValue::new(&mut channel.level_min).speed(0.05);
        changed |= ui.add(finest.clamp_range(0..=coarsest)).changed();
        ui.label("to");
        let mut most = coarsest;
        let widest = DragValue::new(&mut most).speed(0.05).clamp_range(channel.level_min..=last);
        if ui.add(widest).changed() {
            channel.level_max = (most < last).then_some(most);
            changed = true;
        }
        ui.label("(0 is the finest)");
    });
    changed
}
