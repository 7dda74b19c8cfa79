//! A study as charts: error against time, and error against time while streaming.

use crate::study::chart::{Panel, Series, svg_of};
use crate::study::study_table::{Row, StudyTable};
use crate::study::sweep::Axis;

const SIZE: [f64; 2] = [860.0, 500.0];

/// RMSE against run time, one series for each thing that is swept, the Pareto front behind them.
pub fn study_svg(table: &StudyTable) -> String {
    let mut series: Vec<Series> = Vec::new();
    for row in &table.settings {
        let (Some(m), name) = (&row.measured, series_name(row)) else { continue };
        let Some(rmse) = m.error.whole.rmse.filter(|_| m.incomplete.is_none()) else { continue };
        let index = series.iter().position(|known| known.name == name).unwrap_or_else(|| {
            let apart = row.axis != Axis::Step;
            series.push(Series { name, apart, ..Series::default() });
            series.len() - 1
        });
        // A logarithmic axis has no place for equal pictures: they lie at its end.
        series[index].points.push((m.ms.median, Some(rmse.max(1e-9))));
        series[index].labels.push(label(row));
    }
    let mut front: Vec<(f64, f64)> = table
        .settings
        .iter()
        .filter(|row| row.pareto)
        .filter_map(|row| {
            let m = row.measured.as_ref()?;
            Some((m.ms.median, m.error.whole.rmse?.max(1e-9)))
        })
        .collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let header = &table.header;
    let panel = Panel {
        title: format!(
            "{}, view \"{}\", {} x {}, medians of {}",
            header.scene, header.view, header.size[0], header.size[1], header.repeats
        ),
        y_label: "RMSE over all pixels, linear rgb, peak 1".to_owned(),
        series,
        front,
        decibels: true,
        round_x: true,
        linear: false,
    };
    let title = format!("error against run time, {}", header.device);
    let x_label = format!("{} time of a picture, ms", header.clock);
    svg_of(&title, &x_label, "", 1, &[panel], SIZE)
}

/// RMSE of the picture of every round against the time on the wall.
pub fn streaming_svg(table: &StudyTable) -> String {
    let rounds = table.streaming.iter().flat_map(|streaming| &streaming.rounds);
    let mut series = Series { name: "picture of a round".to_owned(), ..Series::default() };
    for round in rounds {
        let rmse = round.error.whole.rmse.map(|rmse| rmse.max(1e-9));
        series.points.push((round.ms, rmse));
        series.labels.push(round.bricks_uploaded.to_string());
    }
    let header = &table.header;
    let panel = Panel {
        title: format!(
            "{}, view \"{}\", {} x {}; numbers: bricks on the device",
            header.scene, header.view, header.size[0], header.size[1]
        ),
        y_label: "RMSE over all pixels, linear rgb, peak 1".to_owned(),
        series: vec![series],
        decibels: true,
        round_x: true,
        linear: false,
        ..Panel::default()
    };
    let title = format!("error while streaming, {}", header.device);
    svg_of(&title, "time on the wall since the beginning, ms", "not comparable", 1, &[panel], SIZE)
}

fn series_name(row: &Row) -> String {
    let setting = &row.setting;
    match row.axis {
        Axis::Step if setting.early_stop == 0.0 => setting.integrator.to_owned(),
        Axis::Step => format!("{}, early stop {}", setting.integrator, setting.early_stop),
        axis => axis.name().replace('-', " "),
    }
}

/// Beside a point: what tells it from its neighbours.
fn label(row: &Row) -> String {
    let setting = &row.setting;
    match row.axis {
        // Beside the other curve of the same steps, once is enough.
        Axis::Step if setting.early_stop != 0.0 => String::new(),
        Axis::Step => setting.tolerance.map_or_else(|| fraction(setting.step), |t| format!("{t}")),
        Axis::Filter => setting.filter.to_owned(),
        Axis::EarlyStop => format!("{}", setting.early_stop),
        Axis::Level => format!("level {}", setting.level_min),
        Axis::LevelMax => setting.level_max.map_or("any".to_owned(), |most| format!("to {most}")),
        Axis::Atlas => format!("{} MiB", setting.atlas_mib),
    }
}

/// 1/8 for 0.125.
fn fraction(step: f64) -> String {
    let parts = 1.0 / step;
    if step < 1.0 && parts.fract() == 0.0 { format!("1/{parts}") } else { format!("{step}") }
}
