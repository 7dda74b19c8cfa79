//! A file without a scene: the whole volume from a corner, every channel through its value range.

use std::path::Path;

use glam::DVec3;

use crate::cli::load::check_memory;
use crate::error::{Error, Result};
use crate::import::{self, Options};
use crate::scene::{
    Channel, Overrides, Place, Projection, Scene, Source, TransferFunction, TransferPoint, View,
    Volume,
};
use crate::volume::{ChannelVoxels, VolumeVoxels};

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

/// Reads a file and makes a scene of it.
///
/// # Errors
/// As `import::open`; exit code 3 when it does not fit `--ram-mib`.
pub fn load(
    path: &Path,
    options: &Options,
    overrides: &Overrides,
) -> Result<(Scene, VolumeVoxels)> {
    let mut input = import::open(path, options)?;
    let header = input.header();
    let shown: Vec<u32> = (0..header.channels.min(CHANNELS_MAX)).collect();
    if header.channels > CHANNELS_MAX {
        eprintln!(
            "ashfall: note: {} has {} channels, the first {CHANNELS_MAX} are drawn: write a scene to choose",
            path.display(),
            header.channels
        );
    }
    // What the flags say is checked as a scene's values are; volumes and views are put in after.
    let mut scene = Scene::from_toml(STAND_IN, path, overrides)?;
    check_memory(header.size, header.format, shown.len(), &scene)
        .map_err(|why| why.at(path.display()))?;
    let voxels = import::read_whole(&mut *input, &shown, scene.memory.ram_mib << 20)?;
    let channels = voxels
        .channels
        .iter()
        .enumerate()
        .map(|(index, channel)| look(index, channel, &voxels))
        .collect::<Result<Vec<_>>>()
        .map_err(|why| why.at(path.display()))?;
    scene.volumes = vec![Volume {
        name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        source: Source::File { path: path.to_owned(), raw: options.raw },
        world_from_voxel: None,
        channels,
        place: Place::Code,
    }];
    scene.views = vec![whole_view(&voxels).map_err(|why| why.at(path.display()))?];
    Ok((scene, voxels))
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

fn look(index: usize, channel: &ChannelVoxels, voxels: &VolumeVoxels) -> Result<Channel> {
    let range = channel.voxels.range();
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
    let extinction = DEPTH_AT_TOP / diagonal_world(voxels);
    let bright = if voxels.channels.len() == 1 { [1.0, 0.97, 0.9] } else { COLORS[index % 4] };
    let dark = bright.map(|part| part * 0.45);
    let point = |at, color, extinction| TransferPoint { at, color, extinction };
    let transfer = TransferFunction::new(vec![
        point(0.0, dark, 0.0),
        point(HIDDEN_PART, dark, 0.0),
        point(1.0, bright, extinction),
    ])
    .map_err(|(_, why)| Error::input(why))?;
    Ok(Channel { index: index as u32, window, transfer })
}

fn diagonal_world(voxels: &VolumeVoxels) -> f64 {
    let size = DVec3::from_array(voxels.size.to_array().map(f64::from));
    voxels.world_from_voxel.vector(size).length()
}

/// From the front, a little from the right and above, with z up: all of the box's sphere in view.
fn whole_view(voxels: &VolumeVoxels) -> Result<View> {
    let size = DVec3::from_array(voxels.size.to_array().map(f64::from));
    let centre = voxels.world_from_voxel.point(size * 0.5);
    let half_fov = (FOV_DEGREES / 2.0).to_radians();
    let distance = MARGIN * 0.5 * diagonal_world(voxels) / half_fov.sin();
    let eye = centre + DVec3::new(0.55, -1.0, 0.45).normalize() * distance;
    let projection = Projection::Perspective { fov_degrees: FOV_DEGREES };
    View::looking_at("whole".to_owned(), eye, centre, DVec3::Z, projection)
        .map_err(|(_, why)| Error::input(format!("no view of the whole volume: {why}")))
}
