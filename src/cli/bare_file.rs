//! A file without a scene: the whole volume from a corner, every channel through its value range.

use std::path::Path;

use glam::DVec3;

use crate::cli::load::{Shown, open_file};
use crate::cli::output::say;
use crate::error::{Error, Result};
use crate::import::Options;
use crate::render::SceneData;
use crate::scene::{
    Channel, Overrides, Place, Projection, Scene, Source, TransferFunction, TransferPoint, View,
    Volume,
};
use crate::source::ChannelDescription;
use crate::volume::{Size3, WorldFromVoxel};

/// Channels drawn at once; a file's others need a scene.
const CHANNELS_MAX: u32 = 4;
/// Bright ends of the channels' colours: grey for one, else told apart by the colour-blind too.
const COLORS: [[f64; 3]; 4] =
    [[0.95, 0.6, 0.1], [0.35, 0.7, 0.9], [0.8, 0.45, 0.65], [0.1, 0.75, 0.5]];
/// Part of the window that stays invisible: background and noise.
const HIDDEN_PART: f64 = 0.15;
/// Optical depth of a ray through the whole volume at the window's top.
const DEPTH_AT_TOP: f64 = 16.0;
/// What the view shows beside the volume.
const MARGIN: f64 = 1.05;
const FOV_DEGREES: f64 = 35.0;

/// Opens a file and makes a scene of it.
///
/// # Errors
/// As `import::open`; exit code 3 when it must be read whole and does not fit `--ram-mib`.
pub fn load(path: &Path, options: &Options, overrides: &Overrides) -> Result<SceneData> {
    // What the flags say is checked as a scene's values are; volumes and views are put in after.
    let mut scene = Scene::from_toml(STAND_IN, path, overrides)?;
    let shown = Shown::First(CHANNELS_MAX);
    let (data, in_file) = open_file(path, options, shown, None, scene.memory.ram_mib)?;
    if in_file > CHANNELS_MAX {
        say(format_args!(
            "note: {} has {in_file} channels, the first {CHANNELS_MAX} are drawn: write a scene to choose",
            path.display(),
        ));
    }
    let volume = data.source.description();
    let world_from_voxel = match options.spacing {
        Some(spacing) => {
            WorldFromVoxel::from_spacing(spacing).map_err(|why| why.at(path.display()))?
        }
        None => volume.world_from_voxel,
    };
    let placed = Placed { size: volume.size(), world_from_voxel };
    let shown: Vec<_> = data.shown().collect();
    let channels = shown
        .iter()
        .enumerate()
        .map(|(index, channel)| look(index, shown.len(), channel, &placed))
        .collect::<Result<Vec<_>>>()
        .map_err(|why| why.at(path.display()))?;
    scene.volumes = vec![Volume {
        name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        source: Source::File { path: path.to_owned(), raw: options.raw },
        world_from_voxel: Some(world_from_voxel),
        channels,
        place: Place::Code,
    }];
    scene.views = vec![whole_view(&placed).map_err(|why| why.at(path.display()))?];
    SceneData::new(scene, vec![data])
}

/// Where the volume is.
struct Placed {
    size: Size3,
    world_from_voxel: WorldFromVoxel,
}

const STAND_IN: &str = r#"
format = 1
[[volume]]
source = { computed = "constant", size = [1, 1, 1] }
[[volume.channel]]
window = [0.0, 1.0]
transfer = [{ at = 0.0, color = [1.0, 1.0, 1.0], extinction = 1.0 }]
[[view]]
eye = [0.0, 0.0, -1.0]
target = [0.0, 0.0, 0.0]
up = [0.0, 1.0, 0.0]
height = 1.0
"#;

fn look(
    index: usize,
    channels: usize,
    channel: &ChannelDescription,
    placed: &Placed,
) -> Result<Channel> {
    let range = channel.range;
    let finite = |value: f32| f64::from(value.clamp(-f32::MAX, f32::MAX));
    let scaled = |value: f32| channel.slope * finite(value) + channel.intercept;
    let (a, b) = (scaled(range.least), scaled(range.greatest));
    // A channel of one value has no range: a window beside it shows it at full.
    let (lo, hi) = if a < b {
        (a, b)
    } else if b < a {
        (b, a)
    } else {
        (a - 1.0, a)
    };
    let most = f64::from(f32::MAX);
    let window = [lo.clamp(-most, most), hi.clamp(-most, most)];
    let extinction = DEPTH_AT_TOP / diagonal_world(placed);
    let bright = if channels == 1 { [1.0, 0.97, 0.9] } else { COLORS[index % 4] };
    let dark = bright.map(|part| part * 0.45);
    let point = |at, color, extinction| TransferPoint { at, color, extinction };
    let transfer = TransferFunction::new(vec![
        point(0.0, dark, 0.0),
        point(HIDDEN_PART, dark, 0.0),
        point(1.0, bright, extinction),
    ])
    .map_err(|(_, why)| Error::input(why))?;
    Ok(Channel {
        index: index as u32,
        window,
        transfer,
        level_min: 0,
        level_max: None,
        sample_every: 1,
    })
}

fn diagonal_world(placed: &Placed) -> f64 {
    let size = DVec3::from_array(placed.size.to_array().map(f64::from));
    placed.world_from_voxel.vector(size).length()
}

/// From the front, a little from the right and above, with z up: all of the box's sphere in view.
fn whole_view(placed: &Placed) -> Result<View> {
    let size = DVec3::from_array(placed.size.to_array().map(f64::from));
    let centre = placed.world_from_voxel.point(size * 0.5);
    let half_fov = (FOV_DEGREES / 2.0).to_radians();
    let distance = MARGIN * 0.5 * diagonal_world(placed) / half_fov.sin();
    let eye = centre + DVec3::new(0.55, -1.0, 0.45).normalize() * distance;
    let projection = Projection::Perspective { fov_degrees: FOV_DEGREES };
    View::looking_at("whole".to_owned(), eye, centre, DVec3::Z, projection)
        .map_err(|(_, why)| Error::input(format!("no view of the whole volume: {why}")))
}
