//! `ashfall study`: error against run time, over settings of one scene; or a suite of scenes of its own.

mod suite;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use indicatif::ProgressBar;

use crate::cli::cores::all_cores;
use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::{make_folder, print, write, write_json};
use crate::cli::progress;
use crate::cli::render::keep_views;
use crate::cli::scene_flags::{OptionalScene, SceneFlags, WorkFlags, shader_compiler};
use crate::error::{Error, Exit, Result};
use crate::gpu::Gpu;
use crate::render::SceneData;
use crate::scene::{Filter, Integrator, Quality};
use crate::study::error_time::{Effort, PICTURE_EDGE_MAX, Study, Watcher, levels_by_footprint};
use crate::study::study_chart::{streaming_svg, study_svg};
use crate::study::study_table::{Header, StudyTable};
use crate::study::sweep::{Axes, Axis, Setting, settings};

/// Measure error against run time: draw one view of a scene with many settings, each several times, and
/// compare every picture with the reference.
///
/// Writes study.json, study.csv, study.svg, and streaming.csv and streaming.svg, into a folder. Every
/// finished measurement is kept there, so that the same command goes on after it was stopped.
///
/// With --suite stability no scene is named: scenes at the edges of what numbers allow are drawn every
/// way, and what must hold of each is looked at.
#[derive(Args)]
#[command(
    override_usage = "ashfall study [OPTIONS] <SCENE> --output <DIR>\n       \
        ashfall study --suite stability [--theme NAME] [--case NAME] [--json] [--output DIR]",
    after_help = "What is swept: steps of every integrator, with the scene's early stop and with none; filters and \
    early stops one at a time at a fine step; levels drawn alone, which tells level-of-detail error from \
    that of integration; atlas sizes, in pages; refinement by substitution, round by round. The scene's \
    flags make the setting that the others differ from, at level 0.\n\
    Errors are on linear rgb with peak 1 (RMSE, greatest, PSNR over all and over covered pixels), SSIM on \
    linear luminance, FLIP on what a PNG shows. docs/STUDY.md explains every figure.\n\
    Ends with 5 when a picture lacks something. An atlas that is too small is a line of the table.\n\
    --suite stability draws fields, transfer functions, voxels, places and cameras at their extremes with \
    every integrator, directly, with half the step, in bricks, through atlases of two sizes, with twice \
    the extinction. Of each must hold: no NaN, alpha within 0 and 1, the error within a bound that has \
    its reason, no change with bricks or atlas, and more extinction lets no more through. Ends with 6 \
    when something does not hold, and says what. Some minutes on a CPU; try --theme cameras."
)]
pub struct Arguments {
    #[command(flatten)]
    scene: OptionalScene,
    /// Folder for everything that is written; it is made, and holds one study. A suite may do without.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    suite: suite::Flags,
    /// The view that is drawn. Default: the first.
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Runs of which the median time counts; one more warms up.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Greatest absolute error of a pixel of the reference.
    #[arg(long, default_value_t = 1e-9, value_name = "X")]
    error_max: f64,
    /// Threads that integrate the reference; default: all cores.
    #[arg(long)]
    jobs: Option<usize>,
    /// Sweep these alone: step, filter, early-stop, level, level-max, atlas, streaming.
    #[arg(long, value_name = "AXIS", value_delimiter = ',', value_parser = part, help_heading = "What is swept",
          default_value = "step,filter,early-stop,level,level-max,atlas,streaming")]
    only: Vec<Part>,
    /// Integrators. Default: all that are built.
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = integrator, help_heading = "What is swept")]
    integrators: Vec<Integrator>,
    /// Sample distances, in smallest voxel edges.
    #[arg(
        long,
        value_name = "STEP",
        value_delimiter = ',',
        allow_hyphen_values = true,
        default_value = "4,2,1,0.5,0.25,0.125,0.0625",
        help_heading = "What is swept"
    )]
    steps: Vec<f64>,
    /// Tolerances, in place of steps, of integrators that have one.
    #[arg(
        long,
        value_name = "X",
        value_delimiter = ',',
        allow_hyphen_values = true,
        default_value = "0.1,0.01,0.001,0.0001,0.00001",
        help_heading = "What is swept"
    )]
    tolerances: Vec<f64>,
    /// The step at which filters and early stops are swept.
    #[arg(
        long,
        value_name = "STEP",
        default_value_t = 0.125,
        allow_hyphen_values = true,
        help_heading = "What is swept"
    )]
    axis_step: f64,
    /// Filters: exact, hardware.
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = filter,
          default_value = "exact,hardware", help_heading = "What is swept")]
    filters: Vec<Filter>,
    /// Early stops.
    #[arg(
        long,
        value_name = "X",
        value_delimiter = ',',
        allow_hyphen_values = true,
        default_value = "0,0.0001,0.0005,0.002,0.01,0.05",
        help_heading = "What is swept"
    )]
    early_stops: Vec<f64>,
    /// Levels drawn alone, and coarsest levels allowed; those that the volume lacks are left out.
    #[arg(
        long,
        value_name = "LEVEL",
        value_delimiter = ',',
        default_value = "0,1,2,3",
        help_heading = "What is swept"
    )]
    levels: Vec<u8>,
    /// Sizes of the atlas in MiB, up to the first that holds all bricks or the scene's atlas_mib.
    #[arg(
        long,
        value_name = "MIB",
        value_delimiter = ',',
        default_value = "1,2,4,8,16,32,64,128,256",
        help_heading = "What is swept"
    )]
    atlas_sizes: Vec<u64>,
    /// Bricks that each round of refinement by substitution brings.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..),
          help_heading = "What is swept")]
    streaming_bricks: u32,
    #[command(flatten)]
    measuring: MeasuringFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// An axis, or refinement by substitution.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Axis(Axis),
    Streaming,
}

/// Measures, writes and prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.suite.named() {
        let integrators = arguments.integrators.iter().map(|integrator| integrator.name());
        return suite::run(
            &arguments.suite,
            integrators.collect(),
            arguments.output.as_deref(),
            &arguments.measuring,
        );
    }
    match (&arguments.scene.0, &arguments.output) {
        (Some(scene), Some(folder)) => sweep(arguments, scene, folder),
        (None, _) => Err(Error::arguments(
            "study: no SCENE: name one whose settings are swept, or --suite stability, which brings its own",
        )),
        (_, None) => Err(Error::arguments(
            "study: no --output: name a folder for study.json and all the rest, as in -o study",
        )),
    }
}

fn sweep(arguments: &Arguments, flags: &SceneFlags, folder: &Path) -> Result<()> {
    let error_max = arguments.error_max;
    if !(error_max > 0.0 && error_max < 1.0) {
        return Err(Error::arguments(format!(
            "--error-max: must be above 0 and below 1, got {error_max}"
        )));
    }
    let work = arguments.work.settings()?;
    if work.paging.show_states {
        return Err(Error::arguments(
            "--show-states: tints pictures, so that their errors mean nothing: leave it out",
        ));
    }
    let data = scene(arguments, flags)?;
    let base = base(flags, &data);
    let effort = Effort {
        axes: axes(arguments, &data, &base),
        base,
        repeats: arguments.repeats,
        error_max,
        threads: arguments.jobs.unwrap_or_else(all_cores).max(1),
        streaming: arguments.only.contains(&Part::Streaming).then_some(arguments.streaming_bricks),
        work,
    };
    // Before anything is measured, so that a bad value costs no time.
    effort.base.quality()?;
    let all = settings(&effort.base, &effort.axes);
    all.iter().try_for_each(|(_, setting)| setting.quality().map(|_| ()))?;
    if all.is_empty() && effort.streaming.is_none() {
        return Err(Error::arguments(
            "--only: this volume has nothing of that to sweep: name another axis",
        ));
    }
    make_folder(folder)?;
    let measured = |gpu: &Arc<Gpu>| {
        let table = measured(flags, folder, gpu, data, effort)?;
        write_table(folder, &table)?;
        Ok(table)
    };
    let table = arguments.measuring.measure(measured, |table| print(table.text()))?;
    let lacking = table.incomplete();
    lacking.map_or(Ok(()), |message| Err(Error { exit: Exit::Incomplete, message }))
}

fn write_table(folder: &Path, table: &StudyTable) -> Result<()> {
    write_json(&folder.join("study.json"), table)?;
    write(&folder.join("study.csv"), &table.csv())?;
    write(&folder.join("study.svg"), &study_svg(table))?;
    if table.streaming.is_some() {
        write(&folder.join("streaming.csv"), &table.streaming_csv())?;
        write(&folder.join("streaming.svg"), &streaming_svg(table))?;
    }
    Ok(())
}

/// The scene with one view, whose voxels fit memory.
fn scene(arguments: &Arguments, flags: &SceneFlags) -> Result<SceneData> {
    let mut data = flags.load()?;
    keep_views(&mut data.scene.views, arguments.view.as_slice())?;
    data.scene.views.truncate(1);
    data.check_memory()?;
    let [width, height] = data.scene.picture.size;
    if width.max(height) > PICTURE_EDGE_MAX {
        return Err(Error::arguments(format!(
            "--size: a study draws at most {PICTURE_EDGE_MAX} pixels a side, got {width} x {height}: choose a smaller one"
        )));
    }
    Ok(data)
}

/// What the scene says, at level 0.
fn base(flags: &SceneFlags, data: &SceneData) -> Setting {
    let Quality { integrator, step, filter, early_stop, .. } = data.scene.quality;
    Setting {
        integrator: integrator.name(),
        step,
        tolerance: flags.overrides().tolerance.filter(|_| integrator.has_tolerance()),
        filter: filter.name(),
        early_stop,
        level_min: 0,
        level_max: Some(0),
        paged: false,
        atlas_mib: data.scene.memory.atlas_mib,
    }
}

fn axes(arguments: &Arguments, data: &SceneData, base: &Setting) -> Axes {
    let swept = arguments.only.iter().filter_map(|part| match part {
        Part::Axis(axis) => Some(*axis),
        Part::Streaming => None,
    });
    let count = data.volumes[0].source.description().levels.count();
    let levels = arguments.levels.iter().copied().filter(|level| usize::from(*level) < count);
    // Where pixels are smaller than voxels, no coarser level is used whatever is allowed.
    let [_, coarsest] = levels_by_footprint(data);
    let below = arguments.levels.iter().copied().filter(|level| *level < coarsest).map(Some);
    let any = (coarsest > 0).then_some(None);
    let all = || Integrator::ALL.to_vec();
    let given = &arguments.integrators;
    Axes {
        swept: swept.collect(),
        integrators: if given.is_empty() { all() } else { given.clone() },
        steps: arguments.steps.clone(),
        tolerances: arguments.tolerances.clone(),
        filters: arguments.filters.clone(),
        early_stops: arguments.early_stops.clone(),
        axis_step: arguments.axis_step,
        levels: levels.collect(),
        levels_max: below.chain(any).collect(),
        atlas_mibs: arguments
            .atlas_sizes
            .iter()
            .copied()
            .filter(|mib| (1..=base.atlas_mib).contains(mib))
            .collect(),
    }
}

fn measured(
    flags: &SceneFlags,
    folder: &Path,
    gpu: &Arc<Gpu>,
    data: SceneData,
    effort: Effort,
) -> Result<StudyTable> {
    let scene = &data.scene;
    let header = Header {
        scene: flags.scene.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        view: scene.views[0].name.clone(),
        size: scene.picture.size,
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: crate::study::repeated::Timer::of(gpu).name("wall"),
        repeats: effort.repeats,
        reference_error_max: effort.error_max,
    };
    let compiler = shader_compiler();
    let mut study = Study::open(gpu, &compiler, data, effort, folder.to_owned())?;
    let bars = Bars::start();
    let found = study.run(&bars);
    bars.settings.finish_and_clear();
    bars.reference.finish_and_clear();
    Ok(StudyTable::new(header, found?))
}

/// Progress on stderr: a bar for settings, another while a reference is integrated.
struct Bars {
    settings: ProgressBar,
    reference: ProgressBar,
}

/// Steps of the reference's bar.
const PARTS: f64 = 1000.0;

impl Bars {
    fn start() -> Bars {
        Bars { settings: progress::settings("study"), reference: progress::parts("reference") }
    }
}

impl Watcher for Bars {
    fn integrates(&self, level: u8, part: f64) {
        if self.reference.length() != Some(PARTS as u64) {
            self.reference.set_length(PARTS as u64);
        }
        self.reference.set_message(format!("reference of level {level}"));
        self.reference.set_position((part * PARTS) as u64);
    }

    fn measures(&self, done: usize, all: usize, key: &str) {
        self.reference.reset();
        self.settings.set_length(all as u64);
        self.settings.set_message(key.to_owned());
        self.settings.set_position(done as u64);
    }
}

fn part(text: &str) -> std::result::Result<Part, String> {
    let axis = Axis::ALL.into_iter().find(|axis| axis.name() == text).map(Part::Axis);
    axis.or((text == "streaming").then_some(Part::Streaming)).ok_or_else(|| {
        let names = Axis::ALL.map(Axis::name).join(", ");
        format!("expected {names} or streaming")
    })
}

fn integrator(text: &str) -> std::result::Result<Integrator, String> {
    let known = Integrator::ALL.into_iter().find(|known| known.name() == text);
    known.ok_or_else(|| format!("expected {}", Integrator::ALL.map(Integrator::name).join(", ")))
}

fn filter(text: &str) -> std::result::Result<Filter, String> {
    let known = [Filter::Exact, Filter::Hardware].into_iter().find(|known| known.name() == text);
    known.ok_or_else(|| "expected exact or hardware".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::{Args as _, Command};

    use super::{Arguments, suite};

    /// A new flag is either one of a scene, which a suite refuses, or one that a suite heeds.
    #[test]
    fn every_flag_belongs_to_a_scene_or_to_a_suite() {
        let command = Arguments::augment_args(Command::new("study"));
        let of_a_suite =
            ["output", "suite", "theme", "case", "bound_factor", "integrators", "json"];
        let of_both = ["device", "queues", "staging_halves", "validate"];
        let wanted = of_a_suite.iter().chain(&of_both).chain(&suite::OF_A_SCENE);
        let mut wanted: Vec<_> = wanted.map(|id| id.to_string()).collect();
        let mut found: Vec<_> =
            command.get_arguments().map(|argument| argument.get_id().to_string()).collect();
        wanted.sort();
        found.sort();
        assert_eq!(found, wanted);
    }
}
