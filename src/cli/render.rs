//! `ashfall render`: a scene becomes pictures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use crate::cli::error_flags::{ErrorFlags, coverage_by, coverage_text, error_picture};
use crate::cli::output::{print, print_json, write_json};
use crate::cli::picture_file::{check_output, write_layers, write_picture};
use crate::cli::progress::Progress;
use crate::cli::replay_flags::{ReplayFlags, heed};
use crate::cli::scene_flags::{DeviceFlags, SceneFlags, WorkFlags, shader_compiler};
use crate::cli::trace_file::TraceFile;
use crate::cli::views_flags::{Pictures, ViewsFlags};
use crate::error::{Error, Exit, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::Replayed;
use crate::render::{Addressing, Plan, Renderer, SceneChange, SceneData, Settings, Statistics};
use crate::scene::{Scene, View};
use crate::study::error_estimate::{Coverage, Drawing, Drawn, DrawnBy, ErrorEstimate};
use crate::study::layout_price;

/// Draw a scene's views into picture files.
///
/// One file per view: with several views the view's name is put before the ending. PNG is 8 bit sRGB,
/// EXR holds R, G, B, A as linear f32, premultiplied; with --error, what each pixel may be off by.
#[derive(Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Picture file, .png or .exr; may be given several times. Default: the scene's name with .png.
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Draw this view; may be given several times. Default: all of them.
    #[arg(long, value_name = "NAME")]
    view: Vec<String>,
    /// Write statistics as JSON: times, samples, memory, device.
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
    /// Write a trace of what happened when, for Perfetto or chrome://tracing (JSON).
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    views: ViewsFlags,
    #[command(flatten)]
    replay: ReplayFlags,
    #[command(flatten)]
    error: ErrorFlags,
    #[command(flatten)]
    device: DeviceFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// Views that one renderer is planned for; of more, as many at a time. Even, for two eyes.
const VIEWS_AT_ONCE: usize = 128;

#[derive(Serialize)]
struct ViewResult {
    view: String,
    files: Vec<PathBuf>,
    #[serde(flatten)]
    statistics: Statistics,
    /// Of the picture's other half, where it is of two eyes.
    #[serde(skip_serializing_if = "Option::is_none")]
    right_eye: Option<Statistics>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<ErrorFigures>,
}

#[derive(Serialize)]
struct ErrorFigures {
    #[serde(flatten)]
    estimate: ErrorEstimate,
    /// Where a reference is at hand.
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<Coverage>,
}

#[derive(Serialize)]
struct Results {
    views: Vec<ViewResult>,
    /// What became of a recorded run that was done again.
    #[serde(skip_serializing_if = "Option::is_none")]
    replayed: Option<Replayed>,
}

/// Draws, writes and reports.
pub fn run(arguments: &Arguments) -> Result<()> {
    let settings = arguments.work.settings()?;
    let outputs = outputs(arguments);
    outputs.iter().try_for_each(|output| check_output(output))?;
    arguments.error.check()?;
    let trace_file = arguments.trace.as_deref().map(TraceFile::create).transpose()?;
    let replay = arguments.replay.ask()?;
    let mut data = arguments.scene.load()?;
    keep_views(&mut data.scene.views, &arguments.view)?;
    let pictures = arguments.views.apply(&mut data, arguments.scene.overrides().size)?;
    if !pictures.are_plain() && arguments.error.error {
        return Err(Error::arguments(
            "--error measures pictures as they are drawn, of one eye each and of no wall: use --stereo pair with it",
        ));
    }
    // What does not fit one plan comes after it.
    let at_once = data.scene.views.len().min(VIEWS_AT_ONCE);
    let later = data.scene.views.split_off(at_once);
    if !later.is_empty() && arguments.error.error {
        return Err(Error::arguments(format!(
            "--error takes {VIEWS_AT_ONCE} views at most: pick some with --view or --frames"
        )));
    }
    // Before a device is looked for: drawing directly takes every voxel.
    if settings.addressing == Addressing::Direct {
        data.check_memory()?;
    }
    let gpu = arguments.device.open()?;
    let compiler = shader_compiler();
    let plan = layout_price::plan(&gpu, &compiler, &data, &settings)?;
    let scene = &arguments.scene.scene;
    let trace = trace_file.as_ref().map(|file| file.begin(&gpu, scene));
    let mut renderer = Renderer::traced(&gpu, plan, &data, trace.as_ref())?;
    replay.begin(&mut renderer, &data)?;
    let results = Results { views: Vec::new(), replayed: None };
    let mut written = Written { arguments, outputs: &outputs, pictures, results };
    let drawn = written.draw_views(&mut renderer, later.chunks(at_once), &mut |before, views| {
        let data = data.again(Scene { views, ..data.scene.clone() })?;
        let change = data.again(data.scene.clone());
        match change.and_then(|data| SceneChange::new(&gpu, &compiler, before.plan(), data)) {
            Ok(change) => before.change(change),
            // Voxels drawn directly belong to their renderer.
            Err(_) => {
                let plan = Plan::new(&gpu, &compiler, &data, &settings)?;
                *before = Renderer::traced(&gpu, plan, &data, trace.as_ref())?;
                Ok(())
            }
        }
    });
    // Of a drawing that failed it is wanted most.
    let traced = match (trace_file, &trace) {
        (Some(file), Some(trace)) => file.write(trace),
        _ => Ok(()),
    };
    let replayed = replay.end(&mut renderer, !arguments.json && drawn.is_ok());
    let drawn = drawn?;
    traced?;
    let replayed = replayed?;
    let by = DrawnBy::plan(renderer.plan(), &data);
    drop(renderer);
    let estimated = match arguments.error.error {
        true => written.estimate(&gpu, &compiler, settings, (&mut data, &by, drawn)),
        false => Ok(()),
    };
    let results = Results { replayed, ..written.results };
    if let Some(stats) = &arguments.stats {
        write_stats(stats, &results)?;
    }
    if arguments.json {
        print_json(&results)?;
    }
    DeviceFlags::heed_validation(&gpu)?;
    estimated?;
    heed(results.replayed.as_ref())?;
    match results.views.iter().find_map(incomplete) {
        Some(why) => Err(Error { exit: Exit::Incomplete, message: why }),
        None => Ok(()),
    }
}

/// What a view's picture lacks, in a sentence.
fn incomplete(view: &ViewResult) -> Option<String> {
    let of_eyes = [Some(&view.statistics), view.right_eye.as_ref()];
    let lacks = of_eyes.into_iter().flatten().find_map(Statistics::lacks);
    lacks.map(|what| format!("view \"{}\" {what}", view.view))
}

/// What becomes of drawn views.
struct Written<'a> {
    arguments: &'a Arguments,
    outputs: &'a [PathBuf],
    pictures: Pictures,
    results: Results,
}

impl Written<'_> {
    /// Draws every picture; writes it at once, unless its error is still to be estimated. `go_on` makes the
    /// renderer ready for the `later` views.
    fn draw_views<'v>(
        &mut self,
        renderer: &mut Renderer,
        mut later: impl Iterator<Item = &'v [View]>,
        go_on: &mut dyn FnMut(&mut Renderer, Vec<View>) -> Result<()>,
    ) -> Result<Vec<Drawn>> {
        let mut waiting = Vec::new();
        let each = self.pictures.views_each();
        let mut next_view = 0;
        for index in 0..self.pictures.names.len() {
            if next_view == renderer.plan().views.len()
                && let Some(views) = later.next()
            {
                // A renderer goes on with as many views as it had; the last are drawn once all the same.
                let last = &views[views.len() - 1];
                let filled = views.iter().chain(std::iter::repeat(last)).take(next_view);
                go_on(renderer, filled.cloned().collect())?;
                next_view = 0;
            }
            let progress = Progress::start(&self.pictures.names[index]);
            let mut drawn = Vec::new();
            for eye in 0..each {
                let mut told = |part| progress.set((eye as f64 + part) / each as f64);
                drawn.push(renderer.draw(next_view, &mut told)?);
                next_view += 1;
            }
            drop(progress);
            let right_eye = (each == 2).then(|| drawn.pop()).flatten();
            let Some((picture, statistics)) = drawn.pop() else { unreachable!("one at least") };
            let right = right_eye.as_ref().map(|(picture, _)| picture);
            let picture = self.pictures.made(index, picture, right);
            let drawn = Drawn { picture, statistics };
            match self.arguments.error.error {
                true => waiting.push(drawn),
                false => self.finish(drawn, right_eye.map(|(_, of)| of), None)?,
            }
        }
        Ok(waiting)
    }

    /// Estimates the errors of all views and writes them. Where that cannot be done, what was drawn is
    /// written without.
    fn estimate(
        &mut self,
        gpu: &Arc<Gpu>,
        compiler: &ShaderCompiler,
        settings: Settings,
        (data, by, drawn): (&mut SceneData, &DrawnBy, Vec<Drawn>),
    ) -> Result<()> {
        let progress = Progress::start("error");
        let mut told = |what: &str, part: f64| {
            progress.name(&format!("error, by {what}"));
            progress.set(part);
        };
        let mut drawing = Drawing { gpu, compiler, settings, progress: &mut told };
        let estimated = drawing.estimate(data, by, &drawn);
        drop(progress);
        let (estimates, failed) = match estimated {
            Ok(estimates) => (estimates.into_iter().map(Some).collect(), Ok(())),
            Err(why) => (vec![None; drawn.len()], Err(why)),
        };
        for (drawn, estimate) in drawn.into_iter().zip(estimates) {
            self.finish(drawn, None, estimate)?;
        }
        failed
    }

    /// Writes the files of the next view and says what it cost.
    fn finish(
        &mut self,
        drawn: Drawn,
        right_eye: Option<Statistics>,
        estimate: Option<ErrorEstimate>,
    ) -> Result<()> {
        let names = &self.pictures.names;
        let (name, views) = (&names[self.results.views.len()], names.len());
        let of_view = |output: &PathBuf| file_of_view(output, name, views);
        let Drawn { picture, statistics } = drawn;
        let files: Vec<PathBuf> = self.outputs.iter().map(of_view).collect();
        let layers = estimate.as_ref().map_or(Vec::new(), ErrorEstimate::layers);
        files.iter().try_for_each(|file| write_layers(file, &picture, &layers))?;
        drop(layers);
        let flags = &self.arguments.error;
        let error = match estimate {
            None => None,
            Some(estimate) => {
                if let Some(file) = flags.error_picture.as_ref().map(of_view) {
                    write_picture(&file, &error_picture(&estimate.total, picture.size))?;
                }
                let reference = flags.reference.as_ref().map(of_view);
                let truth = reference.map(|file| coverage_by(&file, &estimate, &picture));
                Some(ErrorFigures { truth: truth.transpose()?, estimate })
            }
        };
        let result = ViewResult { view: name.clone(), files, statistics, right_eye, error };
        if !self.arguments.json {
            report(&result)?;
        }
        self.results.views.push(result);
        Ok(())
    }
}

/// Statistics of one view stand alone; of several, in a list.
fn write_stats(path: &Path, results: &Results) -> Result<()> {
    match &results.views[..] {
        [only] => write_json(path, only),
        _ => write_json(path, results),
    }
}

fn report(result: &ViewResult) -> Result<()> {
    let ViewResult { view: name, files, statistics, right_eye, error } = result;
    let files: Vec<_> = files.iter().map(|file| file.display().to_string()).collect();
    let passes: Vec<_> =
        statistics.gpu_ms.iter().map(|time| format!("{} {:.1}", time.pass, time.ms)).collect();
    print(format_args!(
        "{name}: {} in {:.0} ms (device ms: {}), {:.1} million samples, {:.0} MiB on {}\n",
        files.join(", "),
        statistics.wall_ms,
        passes.join(", "),
        statistics.samples as f64 * 1e-6,
        statistics.device_bytes as f64 / f64::from(1 << 20),
        statistics.device,
    ))?;
    let indent = " ".repeat(name.len());
    if let Some(right) = right_eye {
        print(format_args!(
            "{indent}: right eye in {:.0} ms, {:.1} million samples, {} bricks uploaded beside the left eye's\n",
            right.wall_ms,
            right.samples as f64 * 1e-6,
            right.bricks_uploaded,
        ))?;
    }
    if let Some(loading) = &statistics.loading {
        print(format_args!(
            "{}: {} rounds, {} bricks needed, {} uploaded ({:.1} MiB), {} hidden, {} of one value, {} absent, {} failed, {} read\n",
            indent,
            statistics.rounds,
            statistics.bricks_needed,
            statistics.bricks_uploaded,
            statistics.bytes_uploaded as f64 / f64::from(1 << 20),
            statistics.bricks_hidden,
            statistics.bricks_constant,
            statistics.bricks_absent,
            statistics.bricks_failed,
            loading.reads,
        ))?;
        if statistics.constants_overflow > 0 {
            print(format_args!(
                "{}: {} bricks of one value travel: the table of values is full\n",
                indent, statistics.constants_overflow,
            ))?;
        }
    }
    if let Some(error) = error {
        report_error(&indent, error)?;
    }
    Ok(())
}

fn report_error(indent: &str, error: &ErrorFigures) -> Result<()> {
    let estimate = &error.estimate;
    print(format_args!(
        "{indent}: error at most about {:.1e}, RMS {:.1e}, {:.1} dB; compared with {:.1} million samples more\n",
        estimate.max,
        estimate.rms,
        estimate.psnr_db,
        estimate.control_samples as f64 * 1e-6,
    ))?;
    for part in &estimate.parts {
        let how = part.how.name();
        print(format_args!(
            "{indent}: {} ({how}, {}): greatest {:.1e}, RMS {:.1e}\n",
            part.name.replace('_', " "),
            part.from,
            part.max,
            part.rms,
        ))?;
    }
    match &error.truth {
        Some(covered) => print(format_args!("{indent}: {}\n", coverage_text(covered))),
        None => Ok(()),
    }
}

fn outputs(arguments: &Arguments) -> Vec<PathBuf> {
    if !arguments.output.is_empty() {
        return arguments.output.clone();
    }
    let stem = arguments.scene.scene.file_stem().unwrap_or_default();
    vec![Path::new(stem).with_extension("png")]
}

/// Keeps the views asked for, in the scene's order.
pub fn keep_views(views: &mut Vec<crate::scene::View>, wanted: &[String]) -> Result<()> {
    if wanted.is_empty() {
        return Ok(());
    }
    if let Some(unknown) = wanted.iter().find(|name| !views.iter().any(|view| view.name == **name))
    {
        let names: Vec<_> = views.iter().map(|view| format!("\"{}\"", view.name)).collect();
        return Err(Error::arguments(format!(
            "--view: \"{unknown}\" is not in the scene, which has {}",
            names.join(", ")
        )));
    }
    views.retain(|view| wanted.contains(&view.name));
    Ok(())
}

/// `out.png` for one view, `out-NAME.png` for several.
pub fn file_of_view(output: &Path, view: &str, views: usize) -> PathBuf {
    if views == 1 {
        return output.to_owned();
    }
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let ending = output.extension().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{stem}-{view}.{ending}"))
}
