//! `ashfall reference`: the truth, in f64 on the CPU.

use std::path::PathBuf;

use clap::Args;

use crate::cli::cores::all_cores;
use crate::cli::output::print;
use crate::cli::picture_file::{check_output, write_picture};
use crate::cli::progress::Progress;
use crate::cli::render::{file_of_view, keep_views};
use crate::cli::scene_flags::SceneFlags;
use crate::error::{Error, Result};
use crate::reference::{Truth, VolumeLevel};
use crate::render::Picture;
use crate::volume::VolumeVoxels;

/// Integrate a scene in f64 on the CPU, to a stated tolerance: the truth that pictures are measured
/// against.
///
/// Step, filter, integrator, early stop and level-max have no effect: the integral has none of them.
#[derive(Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneFlags,
    /// Picture file, .exr or .png; with several views the view's name is put before the ending.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Draw this view; may be given several times. Default: all of them.
    #[arg(long, value_name = "NAME")]
    view: Vec<String>,
    /// Greatest absolute error of a pixel.
    #[arg(long, default_value_t = 1e-9)]
    error_max: f64,
    /// Integrate this level of every volume in place of level 0; a volume with fewer has its coarsest.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(..32))]
    level: u8,
    /// Threads; default: all cores.
    #[arg(long)]
    jobs: Option<usize>,
}

/// Integrates and writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    if !(arguments.error_max > 0.0 && arguments.error_max < 1.0) {
        return Err(Error::arguments(format!(
            "--error-max: must be above 0 and below 1, got {}",
            arguments.error_max
        )));
    }
    check_output(&arguments.output)?;
    let mut data = arguments.scene.load_for_reference()?;
    keep_views(&mut data.scene.views, &arguments.view)?;
    data.check_memory()?;
    let level_of = |volume: usize| {
        let levels = data.volumes[volume].source.description().levels.count();
        arguments.level.min((levels - 1) as u8)
    };
    let voxels = (0..data.volumes.len()).map(|volume| data.level(volume, level_of(volume)));
    let voxels = voxels.collect::<Result<Vec<_>>>()?;
    let scene = &data.scene;
    let level = |(index, volume): (usize, _)| VolumeLevel {
        volume,
        voxels: &voxels[index] as &VolumeVoxels,
        extent_voxel: data.volumes[index].extent_voxel(level_of(index)),
    };
    let levels: Vec<_> = scene.volumes.iter().enumerate().map(level).collect();
    let threads = arguments.jobs.unwrap_or_else(all_cores).max(1);
    for view in &scene.views {
        let start = std::time::Instant::now();
        let progress = Progress::start(&view.name);
        let size = scene.picture.size;
        let background = scene.picture.background;
        let truth = Truth::of_levels(view, size, background, &levels, arguments.error_max)
            .picture(threads, &|part| progress.set(part));
        drop(progress);
        let pixels = truth.rgba.iter().map(|pixel| pixel.map(|part| part as f32)).collect();
        let file = file_of_view(&arguments.output, &view.name, scene.views.len());
        write_picture(&file, &Picture { size: truth.size, pixels })?;
        print(format_args!(
            "{}: {} in {:.1} s, error at most {:e}\n",
            view.name,
            file.display(),
            start.elapsed().as_secs_f64(),
            arguments.error_max
        ))?;
    }
    Ok(())
}
