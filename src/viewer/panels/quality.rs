//! Quality: how well the integral is approximated, and the error that it costs.

use egui::{Slider, Ui};

use crate::scene::{Filter, Integrator, Quality};
use crate::viewer::panels::{Doing, WARNS};

/// Whether anything has changed.
pub fn show(ui: &mut Ui, quality: &mut Quality, original: &Quality, doing: &Doing<'_>) -> bool {
    let mut changed = false;
    egui::ComboBox::from_label("integrator").selected_text(quality.integrator.name()).show_ui(
        ui,
        |ui| {
            // Those that work to a tolerance are not built for bricks.
            for integrator in Integrator::ALL.iter().filter(|of| !of.has_tolerance()) {
                let value = &mut quality.integrator;
                changed |= ui.selectable_value(value, *integrator, integrator.name()).changed();
            }
        },
    );
    let step = Slider::new(&mut quality.step, 0.05..=4.0).logarithmic(true).text("step, voxels");
    changed |= ui.add(step).changed();
    let stop = Slider::new(&mut quality.early_stop, 0.0..=0.1)
        .logarithmic(true)
        .smallest_positive(1e-5)
        .text("early stop");
    changed |= ui.add(stop).changed();
    ui.horizontal(|ui| {
        let mut exact = quality.filter == Filter::Exact;
        if ui.checkbox(&mut exact, "exact filter").changed() {
            quality.filter = if exact { Filter::Exact } else { Filter::Hardware };
            changed = true;
        }
        if ui.small_button("reset").clicked() {
            *quality = original.clone();
            changed = true;
        }
    });
    error(ui, doing);
    changed
}

/// Error beside time: what the settings above cost and buy.
fn error(ui: &mut Ui, doing: &Doing<'_>) {
    let took = doing.shown.statistics.as_ref().filter(|_| doing.shown.converged);
    let took = took.map_or(String::new(), |of| format!(" for {:.0} ms", of.wall_ms));
    if !doing.one_screen {
        ui.weak(format!("error: measured of one picture alone, without eyes or walls{took}"));
        return;
    }
    match (&doing.measured.error, &doing.measured.unmeasured) {
        (_, Some(why)) => _ = ui.colored_label(WARNS, format!("error not measured: {why}")),
        (Some(error), _) if error.pixels > 0 => {
            ui.label(format!(
                "{:.1} dB, at most {:.1e} off{took}",
                error.psnr_db.min(999.0),
                error.max
            ))
            .on_hover_text(
                "pixels all over the picture against the reference at level 0, linear rgb, peak 1",
            );
            if error.pixels < error.of_pixels {
                ui.weak(format!("{} of {} pixels compared", error.pixels, error.of_pixels));
            }
        }
        (Some(_), _) => _ = ui.weak(format!("comparing with the reference{took}")),
        (None, _) => _ = ui.weak("error: measured when the picture rests"),
    }
}
