//! `ashfall render`: a scene becomes pictures.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::cli::output::{print, print_json, write_json};
use crate::cli::picture_file::{check_output, write_picture};
use crate::cli::progress::Progress;
use crate::cli::scene_flags::{DeviceFlags, SceneFlags, WorkFlags, shader_compiler};
use crate::cli::trace_file::TraceFile;
use crate::error::{Error, Exit, Result};
use crate::render::{Addressing, Renderer, SceneData, Statistics};
use crate::study::layout_price;

/// Draw a scene's views into picture files.
///
/// One file per view: with several views the view's name is put before the ending. PNG is 8 bit sRGB,
/// EXR holds R, G, B, A as linear f32, premultiplied.
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
    device: DeviceFlags,
    #[command(flatten)]
    work: WorkFlags,
}

#[derive(Serialize)]
struct ViewResult {
    view: String,
    files: Vec<PathBuf>,
    #[serde(flatten)]
    statistics: Statistics,
}

#[derive(Serialize)]
struct Results {
    views: Vec<ViewResult>,
}

/// Draws, writes and reports.
pub fn run(arguments: &Arguments) -> Result<()> {
    let settings = arguments.work.settings()?;
    let outputs = outputs(arguments);
    outputs.iter().try_for_each(|output| check_output(output))?;
    let trace_file = arguments.trace.as_deref().map(TraceFile::create).transpose()?;
    let mut data = arguments.scene.load()?;
    keep_views(&mut data.scene.views, &arguments.view)?;
    // Before a device is looked for: drawing directly takes every voxel.
    if settings.addressing == Addressing::Direct {
        data.check_memory()?;
    }
    let gpu = arguments.device.open()?;
    let plan = layout_price::plan(&gpu, &shader_compiler(), &data, &settings)?;
    let scene = &arguments.scene.scene;
    let trace = trace_file.as_ref().map(|file| file.begin(&gpu, scene));
    let mut renderer = Renderer::traced(&gpu, plan, &data, trace.as_ref())?;
    let drawn = draw_views(arguments, &outputs, &data, &mut renderer);
    // Of a drawing that failed it is wanted most.
    let traced = match (trace_file, &trace) {
        (Some(file), Some(trace)) => file.write(trace),
        _ => Ok(()),
    };
    let results = drawn?;
    traced?;
    if let Some(stats) = &arguments.stats {
        write_stats(stats, &results)?;
    }
    if arguments.json {
        print_json(&results)?;
    }
    DeviceFlags::heed_validation(&gpu)?;
    match results.views.iter().find_map(incomplete) {
        Some(why) => Err(Error { exit: Exit::Incomplete, message: why }),
        None => Ok(()),
    }
}

/// What a view's picture lacks, in a sentence.
fn incomplete(view: &ViewResult) -> Option<String> {
    let statistics = &view.statistics;
    if let Some(reason) = &statistics.unfinished {
        return Some(format!(
            "view \"{}\" is unfinished, {} rays wait: {reason}",
            view.view, statistics.rays_waiting
        ));
    }
    (statistics.bricks_failed > 0).then(|| {
        format!(
            "view \"{}\" lacks {} bricks that could not be read{}",
            view.view,
            statistics.bricks_failed,
            statistics
                .first_failure
                .as_ref()
                .map_or(String::new(), |why| format!(", the first: {why}"))
        )
    })
}

/// Draws every view and writes its files.
fn draw_views(
    arguments: &Arguments,
    outputs: &[PathBuf],
    data: &SceneData,
    renderer: &mut Renderer,
) -> Result<Results> {
    let mut results = Results { views: Vec::new() };
    let names: Vec<String> = data.scene.views.iter().map(|view| view.name.clone()).collect();
    for (index, name) in names.iter().enumerate() {
        let progress = Progress::start(name);
        let (picture, statistics) = renderer.draw(index, &mut |part| progress.set(part))?;
        drop(progress);
        let of_view = |output: &PathBuf| file_of_view(output, name, names.len());
        let files: Vec<PathBuf> = outputs.iter().map(of_view).collect();
        files.iter().try_for_each(|file| write_picture(file, &picture))?;
        if !arguments.json {
            report(name, &files, &statistics)?;
        }
        results.views.push(ViewResult { view: name.clone(), files, statistics });
    }
    Ok(results)
}

/// Statistics of one view stand alone; of several, in a list.
fn write_stats(path: &Path, results: &Results) -> Result<()> {
    match &results.views[..] {
        [only] => write_json(path, only),
        _ => write_json(path, results),
    }
}

fn report(name: &str, files: &[PathBuf], statistics: &Statistics) -> Result<()> {
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
    if let Some(loading) = &statistics.loading {
        print(format_args!(
            "{}: {} rounds, {} bricks needed, {} uploaded ({:.1} MiB), {} hidden, {} of one value, {} absent, {} failed, {} read\n",
            " ".repeat(name.len()),
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
                " ".repeat(name.len()),
                statistics.constants_overflow,
            ))?;
        }
    }
    Ok(())
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
