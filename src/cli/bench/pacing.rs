//! `ashfall bench pacing`: whether frames keep to a target.

use std::path::PathBuf;

use clap::Args;

use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::{make_folder, print, write};
use crate::cli::scene_flags::SceneFlags;
use crate::error::{Error, Result};
use crate::render::{Addressing, Settings};
use crate::scene::Refine;
use crate::study::chart::{Panel, Series, svg_of};
use crate::study::pacing::{Effort, PacingTable, STEPS, StepRow, csv, measure};

/// Whether frames keep to a target, and what they give up for it: uploads, pixels, steps.
///
/// One path, drawn round by round while bricks come: everything from nothing, a sudden zoom, the side while the
/// disk is slow, a second view, and a camera that turns. "paced" is what `ashfall view` does with --frame-ms: uploads
/// by what rounds are measured to take, and coarser pictures while the camera turns. The others have constant
/// budgets of bricks a round and full pictures.
#[derive(Args)]
#[command(
    after_help = "\"over\" is the part of frames that took longer than the target; p95, p99 and worst are ms on the \
    wall. \"frames\" and \"ms\" are until the picture was finished, on average. dB is of frames that turn, against the \
    finished picture of the same view: what a frame in time costs in error."
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Milliseconds that a frame is to take.
    #[arg(long, value_name = "MS", default_value_t = 50.0)]
    frame_ms: f64,
    /// Constant budgets to compare with, bricks a round.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "8,32,128,512",
          value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    budgets: Vec<u32>,
    /// Milliseconds that the slow disk takes for a brick more.
    #[arg(long, value_name = "MS", default_value_t = 4.0)]
    disk_ms: f64,
    /// How often the path is gone along each way, in turns; all frames count.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Also write pacing.csv (every frame) and pacing.svg into this folder, which is made.
    #[arg(short, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Measures, prints and writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    for (flag, ms, most) in
        [("--frame-ms", arguments.frame_ms, 1e5), ("--disk-ms", arguments.disk_ms, 1e4)]
    {
        if !(ms > 0.0 && ms <= most) {
            return Err(Error::arguments(format!(
                "{flag}: must be above 0 and at most {most}, got {ms}"
            )));
        }
    }
    if let Some(folder) = &arguments.output {
        make_folder(folder)?;
    }
    let mut data = arguments.scene.load()?;
    data.scene.views.truncate(1);
    data.scene.quality.refine = Refine::Substitute;
    let [width, height] = data.scene.picture.size;
    let mut settings =
        Settings { addressing: Addressing::Paged, tile: [width, height], ..Settings::default() };
    settings.paging.lockstep = false;
    let settings = settings.checked()?;
    let effort = Effort {
        frame_ms: arguments.frame_ms,
        constants: arguments.budgets.clone(),
        disk_ms: arguments.disk_ms,
        repeats: arguments.repeats,
    };
    arguments.measuring.measure_under_bar(
        "bench pacing",
        |gpu, compiler, progress| {
            let table = measure(gpu, compiler, &data, settings, &effort, progress)?;
            if let Some(folder) = &arguments.output {
                write(&folder.join("pacing.csv"), &csv(&table))?;
                write(&folder.join("pacing.svg"), &chart(&table))?;
            }
            Ok(table)
        },
        describe,
    )?;
    Ok(())
}

fn describe(table: &PacingTable) -> Result<()> {
    let [width, height] = table.size;
    print(format_args!(
        "{} ({})\n{width} x {height}, a frame is to take {} ms; the path {} times each way\n",
        table.device, table.driver, table.target_ms, table.repeats,
    ))?;
    for step in STEPS {
        print(format_args!(
            "\n{step:<14} {:>8} {:>9} {:>7} {:>8} {:>8} {:>8} {:>7}\n",
            "frames", "ms", "over", "p95", "p99", "worst", "dB"
        ))?;
        for row in table.steps.iter().filter(|row| row.step == step) {
            let StepRow { way, frames, ms, over_target, p95_ms, p99_ms, worst_ms, .. } = row;
            let db = row.psnr_db.map_or("-".to_owned(), |db| format!("{db:.1}"));
            let over = format!("{:.0} %", 100.0 * over_target);
            print(format_args!(
                "{way:<14} {frames:>8.1} {ms:>9.0} {over:>7} {p95_ms:>8.1} {p99_ms:>8.1} {worst_ms:>8.1} {db:>7}\n"
            ))?;
        }
    }
    Ok(())
}

/// Frame times over the path, its first turn: a panel for each part.
fn chart(table: &PacingTable) -> String {
    let mut ways: Vec<&str> = Vec::new();
    for row in &table.steps {
        if !ways.contains(&row.way.as_str()) {
            ways.push(&row.way);
        }
    }
    let panel = |step: &'static str| {
        let of = |way: &str| -> Vec<(f64, Option<f64>)> {
            let rows = table
                .frames
                .iter()
                .filter(|row| row.turn == 0 && row.step == step && row.way == way);
            let mut at = 0.0;
            rows.map(|row| {
                at += row.frame_ms;
                (at, Some(row.frame_ms))
            })
            .collect()
        };
        let mut series: Vec<Series> = ways
            .iter()
            .map(|way| Series { name: (*way).to_owned(), points: of(way), ..Series::default() })
            .collect();
        let end = series.iter().flat_map(|series| &series.points).map(|(at, _)| *at);
        let end = end.fold(1.0, f64::max);
        series.push(Series {
            name: "target".to_owned(),
            points: vec![(0.0, Some(table.target_ms)), (end, Some(table.target_ms))],
            ..Series::default()
        });
        Panel {
            title: step.to_owned(),
            y_label: "frame, ms".to_owned(),
            series,
            round_x: true,
            linear: true,
            ..Panel::default()
        }
    };
    let panels: Vec<Panel> = STEPS.into_iter().map(panel).collect();
    let title = format!("Frames that are to take {} ms, on {}", table.target_ms, table.device);
    svg_of(&title, "ms since the step began", "none", 2, &panels, [470.0, 250.0])
}
