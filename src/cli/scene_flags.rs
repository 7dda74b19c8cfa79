//! Flags that several commands share: a scene, what wins over it, and the device.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ArgMatches, Args, Command, FromArgMatches};

use crate::cli::bare_file;
use crate::cli::load::{load_scene, load_scene_for_reference};
use crate::cli::paging_flags::PagingFlags;
use crate::cli::reading::Reading;
use crate::error::{Error, Exit, Result};
use crate::gpu::{DeviceRequest, Gpu, Instance, QueueTopology, ShaderCompiler, Validation};
use crate::passes::SOURCES;
use crate::render::{Layout, LayoutChoice, SceneData, Settings};
use crate::scene::Overrides;

/// A scene and what wins over it.
#[derive(Args)]
pub struct SceneFlags {
    /// Scene (.toml); or a store or any readable file, drawn whole with a plain look.
    pub scene: PathBuf,
    #[command(flatten, next_help_heading = "A file without a scene")]
    reading: Reading,
    /// Picture size in pixels, across x down.
    #[arg(long, value_name = "WxH", value_parser = pixels, help_heading = "Over the scene")]
    size: Option<[u32; 2]>,
    /// Linear colour behind everything: R,G,B.
    #[arg(long, value_name = "R,G,B", value_parser = color, allow_hyphen_values = true, help_heading = "Over the scene")]
    background: Option<[f64; 3]>,
    /// Quadrature along a ray: riemann.
    #[arg(long, help_heading = "Over the scene")]
    integrator: Option<String>,
    /// Sample distance, in smallest voxel edges. Halving it gains about 12 dB and doubles the time.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    step: Option<f64>,
    /// Greatest error of a pixel, for the integrator "adaptive".
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    tolerance: Option<f64>,
    /// Values between voxels: exact (1e-6 of the value range) or hardware (whatever the sampler gives).
    #[arg(long, help_heading = "Over the scene")]
    filter: Option<String>,
    /// At a missing brick: exact (wait) or substitute (take the best resident level).
    #[arg(long, help_heading = "Over the scene")]
    refine: Option<String>,
    /// Coarsest level allowed; 0 is the finest.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    level_max: Option<i64>,
    /// With refine substitute: how much drawing a channel coarser may lose, as a part of the greatest it shows
    /// (root mean square over any brick), such as 0.02. Smooth channels then take far fewer bricks.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    level_loss: Option<f64>,
    /// A ray ends when less than this is transmitted; 0: never. Costs at most this times the brightest colour.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    early_stop: Option<f64>,
    /// Hard limit on device memory for voxels, MiB.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    atlas_mib: Option<i64>,
    /// Limit on host memory for voxels, MiB.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    ram_mib: Option<i64>,
    /// Upload memory, both halves together, MiB.
    #[arg(long, allow_hyphen_values = true, help_heading = "Over the scene")]
    staging_mib: Option<i64>,
}

impl SceneFlags {
    /// Reads the scene and opens its volumes.
    pub fn load(&self) -> Result<SceneData> {
        if is_scene(&self.scene) {
            return load_scene(&self.scene, &self.overrides());
        }
        bare_file::load(&self.scene, &self.reading.options(), &self.overrides())
    }

    /// As [`SceneFlags::load`], for what the reference alone can draw: several volumes.
    pub fn load_for_reference(&self) -> Result<SceneData> {
        if is_scene(&self.scene) {
            return load_scene_for_reference(&self.scene, &self.overrides());
        }
        self.load()
    }

    /// The flags as the scene takes them.
    pub fn overrides(&self) -> Overrides {
        Overrides {
            size: self.size,
            background: self.background,
            integrator: self.integrator.clone(),
            step: self.step,
            tolerance: self.tolerance,
            filter: self.filter.clone(),
            refine: self.refine.clone(),
            level_max: self.level_max,
            level_loss: self.level_loss,
            early_stop: self.early_stop,
            atlas_mib: self.atlas_mib,
            ram_mib: self.ram_mib,
            staging_mib: self.staging_mib,
        }
    }
}

/// [`SceneFlags`] of a command that may do without a scene.
pub struct OptionalScene(pub Option<SceneFlags>);

impl Args for OptionalScene {
    fn augment_args(command: Command) -> Command {
        // An update asks for nothing.
        SceneFlags::augment_args_for_update(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        SceneFlags::augment_args_for_update(command)
    }
}

impl FromArgMatches for OptionalScene {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let named = matches.contains_id("scene");
        let flags = named.then(|| SceneFlags::from_arg_matches(matches)).transpose();
        flags.map(OptionalScene)
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = OptionalScene::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The device and how it is used.
#[derive(Args)]
pub struct DeviceFlags {
    /// Index in `ashfall devices`, or part of the name; default: the most capable one.
    #[arg(long, env = "ASHFALL_DEVICE", help_heading = "Device")]
    device: Option<String>,
    /// Which queues rendering and copies get: one-queue, two-queues (of one family), transfer-family (shared
    /// concurrently), ownership (the upload buffer is handed over; needs the placed copy path), auto (a family that
    /// only copies, else a second queue, else the same). `ashfall devices` says what a device offers.
    #[arg(long, value_name = "TOPOLOGY", default_value = "auto", value_parser = topology, help_heading = "Device")]
    queues: QueueTopology,
    /// Upload buffers that staging_mib is cut into, which the host fills in turns: 2 or 3.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=3), help_heading = "Device")]
    staging_halves: u8,
    /// Let the validation layers watch, synchronization included; any message ends with exit code 1.
    #[arg(long, help_heading = "Device")]
    pub validate: bool,
}

fn topology(text: &str) -> std::result::Result<QueueTopology, String> {
    let all = std::iter::once(QueueTopology::Auto).chain(QueueTopology::ALL);
    all.into_iter().find(|of| of.name() == text).ok_or_else(|| {
        "expected auto, one-queue, two-queues, transfer-family or ownership".to_owned()
    })
}

impl DeviceFlags {
    /// Opens the device.
    pub fn open(&self) -> Result<Arc<Gpu>> {
        let validation = if self.validate { Validation::On } else { Validation::Off };
        let request = self.request(false);
        Gpu::open(&Instance::new(validation)?, &request)
    }

    /// Opens the device to show windows.
    #[cfg(feature = "viewer")]
    pub fn open_for_windows(&self) -> Result<Arc<Gpu>> {
        let validation = if self.validate { Validation::On } else { Validation::Off };
        let request = self.request(true);
        Gpu::open(&Instance::for_windows(validation)?, &request)
    }

    fn request(&self, presents: bool) -> DeviceRequest {
        DeviceRequest {
            choice: self.device.clone(),
            presents,
            queues: self.queues,
            three_halves: self.staging_halves == 3,
        }
    }

    /// Whatever validation said is a bug of ours.
    pub fn heed_validation(gpu: &Gpu) -> Result<()> {
        let messages = gpu.messages();
        let Some(first) = messages.first() else { return Ok(()) };
        let message =
            format!("validation had {} message(s), the first: {}", messages.len(), first.text);
        Err(Error { exit: Exit::Bug, message })
    }
}

/// What never changes a finished picture.
#[derive(Args)]
pub struct WorkFlags {
    /// Largest tile in pixels; a view is drawn tile by tile.
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1024x1024", help_heading = "Work")]
    tile: [u32; 2],
    /// Samples of one ray in one dispatch, at most 32768.
    #[arg(long, default_value_t = 4096, help_heading = "Work")]
    steps_per_dispatch: u32,
    /// Milliseconds that marching may take in one submit, as it is measured, 0: any; default: 250, and any on a
    /// processor, which no driver's watchdog sees to.
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u32).range(..=60_000), help_heading = "Work")]
    submit_ms: Option<u32>,
    /// How voxels lie on the device: plain, quads (4 x the memory, two loads a sample in place of eight),
    /// auto (quads where they fit atlas_mib and the device, measured at the start, samples them for less).
    #[arg(long, default_value = "auto", value_parser = layout, help_heading = "Work")]
    layout: LayoutChoice,
    /// Load and sample what shows nothing too: bricks, and where voxels are addressed directly, boxes
    /// of 4 cubed.
    #[arg(long, help_heading = "Work")]
    no_skipping: bool,
    #[command(flatten)]
    paging: PagingFlags,
}

impl WorkFlags {
    /// Whether each round is to wait for what it asked.
    #[cfg(feature = "viewer")]
    pub fn asks_lockstep(&self) -> bool {
        self.paging.asks_lockstep()
    }

    /// The settings, checked.
    pub fn settings(&self) -> Result<Settings> {
        let settings = Settings {
            tile: self.tile,
            steps_per_dispatch: self.steps_per_dispatch,
            submit_ms: self.submit_ms,
            layout: self.layout,
            addressing: self.paging.addressing(),
            level_min: 0,
            level_shift: 0,
            steps_longer: 0,
            skipping: !self.no_skipping,
            paging: self.paging.settings(),
        };
        settings.checked()
    }
}

/// The compiler for our shaders, with the user's cache.
pub fn shader_compiler() -> ShaderCompiler {
    ShaderCompiler::new(SOURCES, ShaderCompiler::user_cache())
}

/// Everything that ends in .toml is a scene; everything else is for import to recognise.
fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"))
}

/// Parses `512x512`.
pub(super) fn pixels(text: &str) -> std::result::Result<[u32; 2], String> {
    let parts: Vec<_> = text.split('x').map(str::parse).collect();
    match parts[..] {
        [Ok(width), Ok(height)] => Ok([width, height]),
        _ => Err("expected two whole numbers as 512x512".to_owned()),
    }
}

fn color(text: &str) -> std::result::Result<[f64; 3], String> {
    let parts: Vec<_> = text.split(',').map(|part| part.trim().parse()).collect();
    match parts[..] {
        [Ok(r), Ok(g), Ok(b)] => Ok([r, g, b]),
        _ => Err("expected three numbers as 0.2,0.2,0.2".to_owned()),
    }
}

fn layout(text: &str) -> std::result::Result<LayoutChoice, String> {
    match text {
        "auto" => Ok(LayoutChoice::Auto),
        "plain" => Ok(LayoutChoice::Only(Layout::Plain)),
        "quads" => Ok(LayoutChoice::Only(Layout::Quads)),
        _ => Err("expected auto, plain or quads".to_owned()),
    }
}
