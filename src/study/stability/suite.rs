//! The suite as a table: which cases hold with which integrators, and how far each is from its bound.

use std::fmt::Write;
use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::study::stability::{Case, integrators, measure, themes};

/// What of the suite is drawn. An empty list means all of them.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Names of themes.
    pub themes: Vec<String>,
    /// Names of cases.
    pub cases: Vec<String>,
    /// Names of integrators.
    pub integrators: Vec<&'static str>,
}

/// A case with its theme and an integrator: one row to be.
pub struct Draw {
    theme: &'static str,
    case: Case,
    integrator: &'static str,
}

/// A case drawn with an integrator. Errors are in the suite's units; one that is not finite is no number.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What the case has in common with its neighbours.
    pub theme: &'static str,
    /// The case's name.
    pub case: &'static str,
    /// The integrator.
    pub integrator: &'static str,
    /// Greatest error of a component against the reference.
    pub error: f64,
    /// The same with half the step.
    pub error_halved: f64,
    /// Greatest difference of what is drawn in bricks from what is drawn directly.
    pub change_in_bricks: f64,
    /// What both errors keep to.
    pub bound: f64,
    /// Why the bound is what it is.
    pub reason: &'static str,
    /// Whether all that must hold does.
    pub holds: bool,
    /// What does not, one sentence each.
    pub complaints: Vec<String>,
}

/// All that was drawn, and with what.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityTable {
    /// "stability".
    pub suite: &'static str,
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// What every case's bound was multiplied by.
    pub bound_factor: f64,
    /// Rows that do not hold.
    pub not_holding: usize,
    /// Theme by theme, integrator by integrator.
    pub cases: Vec<Row>,
}

impl Draw {
    /// The case and the integrator, in words.
    pub fn key(&self) -> String {
        format!("{}, {}", self.case.name, self.integrator)
    }
}

impl Choice {
    /// What it stands for, in the suite's order.
    ///
    /// # Errors
    /// Exit code 2 when a name is not known, or when nothing is left.
    pub fn draws(&self) -> Result<Vec<Draw>> {
        let mut themes = themes();
        let of_themes: Vec<_> = themes.iter().map(|theme| theme.name).collect();
        known("--theme", &self.themes, &of_themes)?;
        themes.retain(|theme| chosen(&self.themes, theme.name));
        let cases = themes.iter().flat_map(|theme| &theme.cases);
        let of_cases: Vec<_> = cases.map(|case| case.name).collect();
        known("--case", &self.cases, &of_cases)?;
        let mut draws = Vec::new();
        for theme in &themes {
            for integrator in integrators() {
                if !(self.integrators.is_empty() || self.integrators.contains(&integrator)) {
                    continue;
                }
                let drawn = theme.cases.iter().filter(|case| case.is_drawn_by(integrator));
                let cases = drawn.filter(|case| chosen(&self.cases, case.name));
                draws.extend(cases.map(|case| Draw {
                    theme: theme.name,
                    case: case.clone(),
                    integrator,
                }));
            }
        }
        Ok(draws)
    }
}

fn chosen(names: &[String], name: &str) -> bool {
    names.is_empty() || names.iter().any(|chosen| chosen == name)
}

fn known(flag: &str, names: &[String], all: &[&str]) -> Result<()> {
    match names.iter().find(|name| !all.contains(&name.as_str())) {
        None => Ok(()),
        Some(name) => Err(Error::arguments(format!(
            "{flag}: there is no \"{name}\" here, choose among: \"{}\"",
            all.join("\", \"")
        ))),
    }
}

/// Draws them all; every case's bound is multiplied by `bound_factor` first. `progress` is told how many
/// are done, and which is next.
///
/// # Errors
/// When the device fails or cannot draw a case. What does not hold is no error: it is a row.
pub fn run(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    draws: &[Draw],
    bound_factor: f64,
    progress: &mut dyn FnMut(usize, &str),
) -> Result<StabilityTable> {
    let mut cases = Vec::new();
    for draw in draws {
        progress(cases.len(), &draw.key());
        let case = Case {
            bound: draw.case.bound * bound_factor,
            spans: draw.case.spans.map(|bound| bound * bound_factor),
            ..draw.case.clone()
        };
        let outcome =
            measure(gpu, compiler, &case, draw.integrator).map_err(|why| why.at(draw.key()))?;
        cases.push(Row {
            theme: draw.theme,
            case: case.name,
            integrator: draw.integrator,
            error: outcome.error,
            error_halved: outcome.error_halved,
            change_in_bricks: outcome.paged,
            bound: outcome.bound,
            reason: case.reason,
            holds: outcome.complaints.is_empty(),
            complaints: outcome.complaints,
        });
    }
    Ok(StabilityTable {
        suite: "stability",
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        bound_factor,
        not_holding: cases.iter().filter(|row| !row.holds).count(),
        cases,
    })
}

impl StabilityTable {
    /// As people read it.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{} ({})\n{} drawings; errors are the greatest of a component{}\n\n",
            self.device,
            self.driver,
            self.cases.len(),
            match self.bound_factor {
                1.0 => String::new(),
                factor => format!(", bounds times {factor}"),
            }
        );
        let head = ["theme", "case", "integrator", "error", "half step", "bricks", "bound"];
        let mut line = |[theme, case, integrator, error, halved, bricks, bound]: [&str; 7],
                        holds: &str| {
            // Writing into text does not fail.
            let _ = writeln!(
                text,
                "{theme:<10} {case:<31} {integrator:<13} {error:>9} {halved:>9} {bricks:>9} {bound:>9}  {holds}"
            );
        };
        line(head, "holds");
        for row in &self.cases {
            let figures = [row.error, row.error_halved, row.change_in_bricks, row.bound];
            let [error, halved, bricks, bound] = figures.map(|figure| format!("{figure:.1e}"));
            let figures = [&error[..], &halved, &bricks, &bound];
            let [error, halved, bricks, bound] = figures;
            let words = [row.theme, row.case, row.integrator, error, halved, bricks, bound];
            line(words, if row.holds { "yes" } else { "NO" });
        }
        let sentences = self.sentences();
        if !sentences.is_empty() {
            let _ = write!(text, "\nwhat does not hold\n  {}\n", sentences.join("\n  "));
        }
        text
    }

    /// One line for every row.
    pub fn csv(&self) -> String {
        let mut csv =
            "theme,case,integrator,error,error_halved,change_in_bricks,bound,holds\n".to_owned();
        for row in &self.cases {
            let _ = writeln!(
                csv,
                "{},\"{}\",{},{:e},{:e},{:e},{:e},{}",
                row.theme,
                row.case,
                row.integrator,
                row.error,
                row.error_halved,
                row.change_in_bricks,
                row.bound,
                row.holds
            );
        }
        csv
    }

    /// What does not hold.
    ///
    /// # Errors
    /// Exit code 6 when something does not.
    pub fn held(&self) -> Result<()> {
        match self.sentences().first() {
            None => Ok(()),
            Some(first) => Err(Error::difference(format!(
                "stability: {} of {} do not hold, first: {first}",
                self.not_holding,
                self.cases.len()
            ))),
        }
    }

    fn sentences(&self) -> Vec<String> {
        let of_row = |row: &Row| {
            let key = format!("{}, {}", row.case, row.integrator);
            row.complaints.iter().map(move |why| format!("{key}: {why}")).collect::<Vec<_>>()
        };
        self.cases.iter().flat_map(of_row).collect()
    }
}
