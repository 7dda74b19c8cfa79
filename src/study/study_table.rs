//! What a study found as one object, as rows, and in words.

use std::fmt::Write;

use serde::Serialize;

use crate::study::error_time::{Found, Measurement, Outcome, StreamingRound};
use crate::study::figures::Figures;
use crate::study::front::{Order, STEP_MAX, cheapest, order, pareto};
use crate::study::sweep::{Axis, Setting};

/// Qualities for which the cheapest setting is named, dB over all pixels.
pub const GOALS_DB: [f64; 3] = [40.0, 50.0, 60.0];

/// What was studied, and with what.
#[derive(Clone, Debug, Serialize)]
pub struct Header {
    /// The scene as it was named.
    pub scene: String,
    /// The view that was drawn.
    pub view: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Whose time `ms` counts: "processor" or "wall".
    pub clock: &'static str,
    /// Runs that count.
    pub repeats: u32,
    /// Greatest absolute error of a pixel of the reference.
    pub reference_error_max: f64,
}

/// One setting.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The setting in words.
    pub key: String,
    /// What it was measured for.
    pub axis: Axis,
    /// The setting.
    pub setting: Setting,
    /// Figures; nothing where it was refused.
    pub measured: Option<Measurement>,
    /// Why it was refused.
    pub refused: Option<String>,
    /// Whether it is nearer to the truth, by 1% of the RMSE at least, than all that cost no more.
    pub pareto: bool,
}

/// How fast an integrator converges.
#[derive(Clone, Debug, Serialize)]
pub struct OrderRow {
    /// The integrator.
    pub integrator: &'static str,
    /// What is made finer: "step" or "tolerance".
    pub parameter: &'static str,
    /// Nothing where fewer than two points lie above the floor.
    pub observed: Option<Order>,
}

/// The cheapest setting for a quality.
#[derive(Clone, Debug, Serialize)]
pub struct CheapestRow {
    /// PSNR over all pixels at least, dB.
    pub psnr_db: f64,
    /// The setting in words; nothing where none reaches.
    pub key: Option<String>,
    /// Its median time by the study's clock.
    pub ms: Option<f64>,
}

/// Errors of a level apart from each other.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRow {
    /// The level.
    pub level: u8,
    /// The reference of the level against that of level 0.
    pub level_of_detail: Figures,
    /// The picture of the level against the reference of the level.
    pub integration: Option<Figures>,
    /// The picture of the level against the reference of level 0.
    pub total: Option<Figures>,
}

/// Refinement by substitution.
#[derive(Clone, Debug, Serialize)]
pub struct StreamingTable {
    /// Whether the last picture is the exact one.
    pub converged: bool,
    /// Why not.
    pub incomplete: Option<String>,
    /// Round by round.
    pub rounds: Vec<StreamingRound>,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub struct StudyTable {
    /// What was studied.
    #[serde(flatten)]
    pub header: Header,
    /// Measurements made in this run; the others were there before.
    pub measured_now: usize,
    /// Every setting.
    pub settings: Vec<Row>,
    /// By integrator.
    pub orders: Vec<OrderRow>,
    /// For 40, 50 and 60 dB.
    pub cheapest: Vec<CheapestRow>,
    /// By level, if levels were drawn alone.
    pub levels: Vec<LevelRow>,
    /// If asked for.
    pub streaming: Option<StreamingTable>,
}

impl StudyTable {
    /// Puts together what was found.
    pub fn new(header: Header, found: Found) -> StudyTable {
        let mut rows: Vec<Row> = Vec::new();
        for measured in found.settings {
            let (figures, refused) = match measured.outcome {
                Outcome::Measured(figures) => (Some(*figures), None),
                Outcome::Refused(why) => (None, Some(why)),
            };
            rows.push(Row {
                key: measured.setting.key(),
                axis: measured.axis,
                setting: measured.setting,
                measured: figures,
                refused,
                pareto: false,
            });
        }
        let points: Vec<_> = rows.iter().map(Row::point).collect();
        for (row, on_front) in rows.iter_mut().zip(pareto(&points)) {
            row.pareto = on_front;
        }
        let levels = found.levels_of_detail.into_iter().map(|(level, level_of_detail)| {
            let drawn = |row: &&Row| row.axis == Axis::Level && row.setting.level_min == level;
            let row = rows.iter().find(drawn).and_then(|row| row.measured.as_ref());
            LevelRow {
                level,
                level_of_detail,
                integration: row.map(|row| row.integration.unwrap_or(row.error)),
                total: row.map(|row| row.error),
            }
        });
        StudyTable {
            levels: levels.collect(),
            orders: orders(&rows),
            cheapest: GOALS_DB.iter().map(|goal| cheapest_for(*goal, &rows)).collect(),
            streaming: found.streaming.map(|streaming| StreamingTable {
                converged: streaming.converged,
                incomplete: streaming.incomplete,
                rounds: streaming.rounds,
            }),
            measured_now: found.measured_now,
            settings: rows,
            header,
        }
    }

    /// The first thing that a picture lacks.
    pub fn incomplete(&self) -> Option<String> {
        let lacking = self.settings.iter().find_map(|row| {
            let why = row.measured.as_ref()?.incomplete.as_ref()?;
            Some(format!("{}: {why}", row.key))
        });
        let streaming = self.streaming.as_ref().and_then(|s| s.incomplete.as_ref());
        lacking.or_else(|| streaming.map(|why| format!("streaming: {why}")))
    }

    /// Every setting as comma-separated values, with a line of names.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "axis,integrator,step,tolerance,filter,early_stop,level_min,level_max,addressing,atlas_mib,\
             ms,ms_least,ms_most,wall_ms,wall_ms_least,wall_ms_most,gpu_ms,gpu_ms_least,gpu_ms_most,\
             samples,rounds,bricks_needed,bricks_uploaded,bytes_uploaded,slots,pareto,",
        );
        text += FIGURE_NAMES;
        text += ",refused,incomplete\n";
        for row in &self.settings {
            let Setting { integrator, step, filter, early_stop, level_min, atlas_mib, .. } =
                row.setting;
            let tolerance = or_empty(row.setting.tolerance);
            let level_max = row.setting.level_max.map(|l| l.to_string()).unwrap_or_default();
            let _ = write!(
                text,
                "{},{integrator},{step},{tolerance},{filter},{early_stop},{level_min},{level_max},",
                row.axis.name(),
            );
            let spread = |spread: Option<&crate::study::repeated::Spread>| {
                let [a, b, c] =
                    [spread.map(|s| s.median), spread.map(|s| s.least), spread.map(|s| s.most)];
                [a, b, c].map(|ms| ms.map(|ms| format!("{ms:.3}")).unwrap_or_default()).join(",")
            };
            let m = row.measured.as_ref();
            let count =
                |of: fn(&Measurement) -> u64| m.map(|m| of(m).to_string()).unwrap_or_default();
            let fields = [
                m.map(|m| m.addressing.clone()).unwrap_or_default(),
                atlas_mib.to_string(),
                spread(m.map(|m| &m.ms)),
                spread(m.map(|m| &m.wall_ms)),
                spread(m.and_then(|m| m.gpu_ms.as_ref())),
                count(|m| m.samples),
                count(|m| m.rounds),
                count(|m| m.bricks_needed),
                count(|m| m.bricks_uploaded),
                count(|m| m.bytes_uploaded),
                count(|m| m.slots),
                row.pareto.to_string(),
                figure_values(m.map(|m| &m.error)),
                quoted(row.refused.as_deref()),
                quoted(m.and_then(|m| m.incomplete.as_deref())),
            ];
            text += &fields.join(",");
            text.push('\n');
        }
        text
    }

    /// Streaming's rounds as comma-separated values, with a line of names.
    pub fn streaming_csv(&self) -> String {
        let mut text = format!("round,ms,bricks_uploaded,{FIGURE_NAMES}\n");
        for round in self.streaming.iter().flat_map(|streaming| &streaming.rounds) {
            let figures = figure_values(Some(&round.error));
            let _ = writeln!(
                text,
                "{},{:.3},{},{figures}",
                round.round, round.ms, round.bricks_uploaded
            );
        }
        text
    }

    /// The table in words.
    pub fn text(&self) -> String {
        let Header { scene, view, size, device, driver, clock, repeats, .. } = &self.header;
        let mut text = format!(
            "{scene}, view \"{view}\", {} x {}\n{device} ({driver})\nms: {clock} time, medians of {repeats}; *: Pareto front\n\n",
            size[0], size[1]
        );
        let width = self.settings.iter().map(|row| row.key.chars().count()).max().unwrap_or(0);
        let _ = writeln!(
            text,
            "  {:<width$} {:>9} {:>15} {:>9} {:>9} {:>9} {:>6} {:>7} {:>9} {:>7}",
            "setting",
            "ms",
            "least to most",
            "wall ms",
            "samples M",
            "RMSE",
            "dB",
            "covered",
            "SSIM",
            "FLIP"
        );
        for row in &self.settings {
            let star = if row.pareto { '*' } else { ' ' };
            let _ = write!(text, "{star} {:<width$} ", row.key);
            let Some(m) = &row.measured else {
                let _ = writeln!(text, "refused: {}", row.refused.as_deref().unwrap_or(""));
                continue;
            };
            let short = |value: Option<f64>, digits: usize| {
                value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
            };
            let _ = writeln!(
                text,
                "{:>9.1} {:>15} {:>9.1} {:>9.1} {:>9} {:>6} {:>7} {:>9} {:>7}{}",
                m.ms.median,
                format!("{:.1} to {:.1}", m.ms.least, m.ms.most),
                m.wall_ms.median,
                m.samples as f64 * 1e-6,
                scientific(m.error.whole.rmse),
                short(m.error.whole.psnr_db, 1),
                short(m.error.covered.psnr_db, 1),
                short(m.error.ssim, 6),
                short(m.error.flip, 4),
                m.incomplete.as_ref().map(|why| format!("  {why}")).unwrap_or_default(),
            );
        }
        text.push('\n');
        for row in &self.orders {
            let found = match &row.observed {
                Some(Order { order, over: [from, to], points }) => format!(
                    "error falls as {}^{order:.2} ({points} points, {from} to {to})",
                    row.parameter
                ),
                None => "too few points above the floor of f32 for an order".to_owned(),
            };
            let _ = writeln!(text, "{}: {found}", row.integrator);
        }
        for row in &self.cheapest {
            let found = match (&row.key, row.ms) {
                (Some(key), Some(ms)) => format!("{key} ({ms:.1} ms)"),
                _ => "none of these settings".to_owned(),
            };
            let _ = writeln!(text, "cheapest for {} dB: {found}", row.psnr_db);
        }
        for row in &self.levels {
            let rmse = |figures: Option<&Figures>| scientific(figures.and_then(|f| f.whole.rmse));
            let _ = writeln!(
                text,
                "level {}: RMSE {} of the level, {} of integration, {} together",
                row.level,
                rmse(Some(&row.level_of_detail)),
                rmse(row.integration.as_ref()),
                rmse(row.total.as_ref()),
            );
        }
        if let Some(streaming) = &self.streaming
            && let [first, .., last] = &streaming.rounds[..]
        {
            let ends = if streaming.converged { "converged" } else { "ended" };
            let _ = writeln!(
                text,
                "streaming: first picture after {:.1} ms with RMSE {}, {ends} after {:.1} ms and {} rounds with {}",
                first.ms,
                scientific(first.error.whole.rmse),
                last.ms,
                last.round,
                scientific(last.error.whole.rmse)
            );
        }
        text
    }
}

impl Row {
    /// Cost and error, of finished pictures.
    fn point(&self) -> Option<(f64, f64)> {
        let measured = self.measured.as_ref().filter(|m| m.incomplete.is_none())?;
        Some((measured.ms.median, measured.error.whole.rmse?))
    }
}

fn orders(rows: &[Row]) -> Vec<OrderRow> {
    let product = |row: &&Row| row.axis == Axis::Step && row.setting.early_stop == 0.0;
    let mut found: Vec<OrderRow> = Vec::new();
    for row in rows.iter().filter(product) {
        let integrator = row.setting.integrator;
        if found.iter().any(|known| known.integrator == integrator) {
            continue;
        }
        let parameter = if row.setting.tolerance.is_some() { "tolerance" } else { "step" };
        let of = rows.iter().filter(product).filter(|row| row.setting.integrator == integrator);
        let points = of.filter_map(|row| {
            Some((row.setting.tolerance.unwrap_or(row.setting.step), row.point()?.1))
        });
        let points: Vec<(f64, f64)> = points.collect();
        found.push(OrderRow { integrator, parameter, observed: order(&points, STEP_MAX) });
    }
    found
}

fn cheapest_for(psnr_db: f64, rows: &[Row]) -> CheapestRow {
    let point = |row: &Row| {
        let reaches = |m: &Measurement| m.incomplete.is_none() && m.error.reaches(psnr_db);
        let cost = row.measured.as_ref().map_or(f64::INFINITY, |m| m.ms.median);
        (cost, row.measured.as_ref().is_some_and(reaches))
    };
    let row = cheapest(rows.iter().map(point)).map(|index| &rows[index]);
    CheapestRow {
        psnr_db,
        key: row.map(|row| row.key.clone()),
        ms: row.and_then(|row| row.measured.as_ref()).map(|m| m.ms.median),
    }
}

const FIGURE_NAMES: &str =
    "rmse,max,psnr_db,covered_rmse,covered_max,covered_psnr_db,alpha_max,ssim,flip";

fn figure_values(figures: Option<&Figures>) -> String {
    let of = |part: fn(&Figures) -> Option<f64>| or_empty(figures.and_then(part));
    [
        of(|f| f.whole.rmse),
        of(|f| f.whole.max),
        of(|f| f.whole.psnr_db),
        of(|f| f.covered.rmse),
        of(|f| f.covered.max),
        of(|f| f.covered.psnr_db),
        of(|f| f.alpha_max),
        of(|f| f.ssim),
        of(|f| f.flip),
    ]
    .join(",")
}

fn or_empty(value: Option<f64>) -> String {
    value.map(|value| format!("{value}")).unwrap_or_default()
}

fn quoted(words: Option<&str>) -> String {
    words.map(|words| format!("\"{}\"", words.replace('"', "\"\""))).unwrap_or_default()
}

fn scientific(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.2e}"))
}
