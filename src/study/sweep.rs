//! Which settings a study takes: not every combination, but what tells each error apart.
//!
//! - *step*: every integrator with every step (or tolerance, where it has one), without early stop and
//!   with the scene's: the product from which orders and most of the front come.
//! - *filter*, *early stop*: one changed at a time, at a step so fine that its own error hides nothing.
//! - *level*: the volume as if a coarser level were all there is; what levels cost stands apart from what
//!   integration does.
//! - *level max*: levels by the pixel's footprint, coarser and coarser ones allowed. Only where the view
//!   has pixels larger than voxels.
//! - *atlas*: the scene's setting through atlases of several sizes, in pages, each run from nothing.
//!
//! All but *level* and *level max* draw level 0.

use serde::Serialize;

use crate::error::Result;
use crate::scene::{Filter, Integrator, Overrides, Quality};

/// One point of the study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// As in scenes.
    pub integrator: &'static str,
    /// Sample distance, in smallest voxel edges of the level in use.
    pub step: f64,
    /// Greatest error of a pixel, of an integrator that works to one.
    pub tolerance: Option<f64>,
    /// As in scenes.
    pub filter: &'static str,
    /// A ray ends when less than this is transmitted.
    pub early_stop: f64,
    /// Finest level drawn.
    pub level_min: u8,
    /// Coarsest level allowed; nothing: by the pixel's footprint alone.
    pub level_max: Option<u8>,
    /// Whether bricks are paged in any case, and each run begins with nothing loaded.
    pub paged: bool,
    /// Hard limit on device memory for voxels, MiB.
    pub atlas_mib: u64,
}

impl Setting {
    /// The setting in words, the same for the same setting and no other.
    pub fn key(&self) -> String {
        let mut words = format!("{}, step {}", self.integrator, self.step);
        if let Some(tolerance) = self.tolerance {
            words += &format!(", tolerance {tolerance}");
        }
        words += &format!(", {} filter, early stop {}", self.filter, self.early_stop);
        match (self.level_min, self.level_max) {
            (0, Some(0)) => {}
            (least, Some(most)) if least == most => words += &format!(", level {least}"),
            (least, Some(most)) => words += &format!(", levels {least} to {most}"),
            (least, None) => words += &format!(", levels from {least}"),
        }
        if self.paged {
            words += &format!(", paged in {} MiB", self.atlas_mib);
        }
        words
    }

    /// As a scene with such flags has it.
    ///
    /// # Errors
    /// Exit code 2 where a value is out of range.
    pub fn quality(&self) -> Result<Quality> {
        Quality::of_flags(&Overrides {
            integrator: Some(self.integrator.to_owned()),
            step: Some(self.step),
            tolerance: self.tolerance,
            filter: Some(self.filter.to_owned()),
            early_stop: Some(self.early_stop),
            level_max: self.level_max.map(i64::from),
            ..Overrides::default()
        })
    }

    /// The one level that is drawn, where it is one.
    pub fn level(&self) -> Option<u8> {
        self.level_max.filter(|most| *most == self.level_min)
    }
}

/// What a setting is measured for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Integrator and step or tolerance.
    Step,
    /// Values between voxels.
    Filter,
    /// Where rays end.
    EarlyStop,
    /// One level alone.
    Level,
    /// Coarsest level allowed.
    LevelMax,
    /// Cache budget.
    Atlas,
}

impl Axis {
    /// Every one, in the order in which they are measured.
    pub const ALL: [Axis; 6] =
        [Axis::Step, Axis::Filter, Axis::EarlyStop, Axis::Level, Axis::LevelMax, Axis::Atlas];

    /// The word in tables and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Axis::Step => "step",
            Axis::Filter => "filter",
            Axis::EarlyStop => "early-stop",
            Axis::Level => "level",
            Axis::LevelMax => "level-max",
            Axis::Atlas => "atlas",
        }
    }
}

/// How far each axis goes.
#[derive(Clone, Debug)]
pub struct Axes {
    /// Those that are swept.
    pub swept: Vec<Axis>,
    /// Quadratures.
    pub integrators: Vec<Integrator>,
    /// Steps of the product.
    pub steps: Vec<f64>,
    /// In place of steps.
    pub tolerances: Vec<f64>,
    /// Values between voxels.
    pub filters: Vec<Filter>,
    /// Early stops.
    pub early_stops: Vec<f64>,
    /// The step at which filters and early stops are swept.
    pub axis_step: f64,
    /// Levels drawn alone; those that the volume lacks are left out.
    pub levels: Vec<u8>,
    /// Coarsest levels allowed; nothing in the list: no bound.
    pub levels_max: Vec<Option<u8>>,
    /// Sizes of the atlas.
    pub atlas_mibs: Vec<u64>,
}

/// All settings, each once, with the axis that it is first measured for. `base` is what the scene says,
/// drawn at level 0.
pub fn settings(base: &Setting, axes: &Axes) -> Vec<(Axis, Setting)> {
    let mut found: Vec<(Axis, Setting)> = Vec::new();
    let mut add = |axis: Axis, setting: Setting| {
        let swept = axes.swept.contains(&axis);
        if swept && !found.iter().any(|(_, known)| known.key() == setting.key()) {
            found.push((axis, setting));
        }
    };
    for early_stop in [0.0, base.early_stop] {
        for integrator in &axes.integrators {
            let of = Setting {
                integrator: integrator.name(),
                early_stop,
                tolerance: None,
                ..base.clone()
            };
            if integrator.has_tolerance() {
                for tolerance in &axes.tolerances {
                    add(Axis::Step, Setting { tolerance: Some(*tolerance), ..of.clone() });
                }
            } else {
                for step in &axes.steps {
                    add(Axis::Step, Setting { step: *step, ..of.clone() });
                }
            }
        }
    }
    let fine = Setting { step: axes.axis_step, early_stop: 0.0, ..base.clone() };
    for filter in &axes.filters {
        add(Axis::Filter, Setting { filter: filter.name(), ..fine.clone() });
    }
    for early_stop in &axes.early_stops {
        add(Axis::EarlyStop, Setting { early_stop: *early_stop, ..fine.clone() });
    }
    let endless = Setting { early_stop: 0.0, paged: true, ..base.clone() };
    for level in &axes.levels {
        add(Axis::Level, Setting { level_min: *level, level_max: Some(*level), ..endless.clone() });
    }
    for level_max in &axes.levels_max {
        add(Axis::LevelMax, Setting { level_max: *level_max, ..endless.clone() });
    }
    for atlas_mib in &axes.atlas_mibs {
        add(Axis::Atlas, Setting { paged: true, atlas_mib: *atlas_mib, ..base.clone() });
    }
    found
}
