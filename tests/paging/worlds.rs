//! Volumes made by code, cameras, and settings: what the tests of paging draw.

use std::path::Path;
use std::sync::Arc;

use ashfall::import::DenseVolume;
use ashfall::render::paging::PagingSettings;
use ashfall::render::{Addressing, Picture, SceneData, Settings, VolumeData};
use ashfall::scene::{Overrides, Scene};
use ashfall::source::BrickSource;
use ashfall::study::error_metrics::picture_error;
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, VoxelFormat, Voxels, WorldFromVoxel};

use crate::common::drawing::{Device, Drawn};

/// Value, 0 to 1, at a place of the unit cube.
pub type Field = fn([f64; 3]) -> f64;

/// A hill in the middle, nothing beyond it.
pub fn hill(at: [f64; 3]) -> f64 {
    ball(at, [0.5; 3], 0.48)
}

/// A hill off the middle.
pub fn other_hill(at: [f64; 3]) -> f64 {
    ball(at, [0.35, 0.6, 0.55], 0.4)
}

/// Something everywhere, of one value nowhere.
pub fn waves([x, y, z]: [f64; 3]) -> f64 {
    0.5 + 0.2 * (9.0 * x + 2.0 * z).sin()
        + 0.2 * (8.0 * y - 3.0 * x).sin()
        + 0.09 * (25.0 * z).sin()
}

/// Thin fog before a dense rear, so that rays go deep.
pub fn fog([x, y, z]: [f64; 3]) -> f64 {
    0.2 + 0.1 * (20.0 * x).sin() * (17.0 * y).cos() + 0.3 * z
}

/// A hill on a plateau: many bricks of one visible value, many of none.
pub fn plateau(at: [f64; 3]) -> f64 {
    match at[2] {
        z if z < 0.45 => 0.4,
        _ => ball(at, [0.5, 0.5, 0.6], 0.3),
    }
}

fn ball(at: [f64; 3], centre: [f64; 3], radius: f64) -> f64 {
    let square: f64 = (0..3).map(|axis| (at[axis] - centre[axis]).powi(2)).sum();
    (1.0 - square.sqrt() / radius).max(0.0)
}

/// A channel of a made volume.
pub fn channel(size: [u32; 3], format: VoxelFormat, field: Field) -> ChannelVoxels {
    let longest = f64::from(size.into_iter().max().unwrap_or(1));
    let [width, height, depth] = size;
    let rows = (0..depth).flat_map(|z| (0..height).map(move |y| (y, z)));
    let voxels = rows.flat_map(|(y, z)| (0..width).map(move |x| [x, y, z]));
    let values = voxels.map(|voxel| field(voxel.map(|at| (f64::from(at) + 0.5) / longest)));
    let voxels = match format {
        VoxelFormat::U8 => Voxels::U8(values.map(|v| (v * 255.0) as u8).collect()),
        VoxelFormat::U16 => Voxels::U16(values.map(|v| (v * 65535.0) as u16).collect()),
        VoxelFormat::I16 => Voxels::I16(values.map(|v| (v * 65535.0 - 32768.0) as i16).collect()),
        VoxelFormat::F32 => Voxels::F32(values.map(|v| v as f32).collect()),
        VoxelFormat::Rgba8 => {
            let color = |v: f64| [v, 1.0 - v, v * v, v].map(|part| (part * 255.0) as u8);
            Voxels::Rgba8(values.map(color).collect())
        }
    };
    ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 }
}

/// A volume whose longest edge is one world unit.
pub fn volume(size: [u32; 3], channels: Vec<ChannelVoxels>) -> VolumeVoxels {
    let longest = f64::from(size.into_iter().max().unwrap_or(1));
    let world_from_voxel = WorldFromVoxel::from_spacing([1.0 / longest; 3]).expect("a spacing");
    VolumeVoxels { size: Size3::from_array(size), world_from_voxel, channels }
}

/// One channel of bytes in bricks of 16.
pub fn bytes_volume(edge: u32, field: Field) -> Arc<DenseVolume> {
    bricks(volume([edge; 3], vec![channel([edge; 3], VoxelFormat::U8, field)]), 16)
}

/// Cuts a volume.
pub fn bricks(voxels: VolumeVoxels, payload: u32) -> Arc<DenseVolume> {
    Arc::new(DenseVolume::new("made", Arc::new(voxels), Size3::cube(payload)))
}

/// Where from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// All of the unit cube, in perspective.
    Corner,
    /// From within, so that several levels are in use where they may be.
    Inside,
    /// All of it, along parallel rays.
    Parallel,
}

/// Seen at level 0 alone, small, from a corner.
pub fn at_level_0() -> Overrides {
    Overrides { size: Some([64, 64]), level_max: Some(0), step: Some(0.5), ..Overrides::default() }
}

/// A scene of all channels of a source.
pub fn scene(source: Arc<dyn BrickSource>, look: Look, overrides: &Overrides) -> SceneData {
    let data = VolumeData::new(source.clone(), all_channels(&*source));
    SceneData::new(parsed(&*source, look, overrides), vec![data]).expect("drawable")
}

/// The same, whose voxels are there whole, so that it can be drawn directly too.
pub fn scene_of_whole(dense: &Arc<DenseVolume>, look: Look, overrides: &Overrides) -> SceneData {
    let data = VolumeData::of_whole(dense.clone(), dense.voxels().clone());
    SceneData::new(parsed(&**dense, look, overrides), vec![data]).expect("drawable")
}

fn all_channels(source: &dyn BrickSource) -> Vec<u16> {
    (0..source.description().channels.len() as u16).collect()
}

/// Channels differ in colour; low values are invisible.
pub fn scene_text(formats: &[VoxelFormat], look: Look) -> String {
    let mut text = "format = 1\n[[volume]]\nname = \"made\"\nsource = \"made.bricks\"\n".to_owned();
    for (number, format) in formats.iter().enumerate() {
        let window = match format {
            VoxelFormat::U8 | VoxelFormat::Rgba8 => [0.0, 255.0],
            VoxelFormat::U16 => [0.0, 65535.0],
            VoxelFormat::I16 => [-32768.0, 32767.0],
            VoxelFormat::F32 => [0.0, 1.0],
        };
        let part = |at: usize| if number % 3 == at { 0.9 } else { 0.25 };
        let color = format!("[{}, {}, {}]", part(0), part(1), part(2));
        text += &format!(
            "[[volume.channel]]\nwindow = {window:?}\ntransfer = [\n\
             {{ at = 0.0, color = {color}, extinction = 0.0 }},\n\
             {{ at = 0.12, color = {color}, extinction = 0.0 }},\n\
             {{ at = 0.5, color = {color}, extinction = 3.0 }},\n\
             {{ at = 1.0, color = [1.0, 0.9, 0.8], extinction = 9.0 }},\n]\n"
        );
    }
    text += match look {
        Look::Corner => {
            "[[view]]\neye = [1.9, -1.1, 1.4]\ntarget = [0.5, 0.5, 0.5]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 36.0\n"
        }
        Look::Inside => {
            "[[view]]\neye = [0.11, 0.17, 0.23]\ntarget = [0.8, 0.7, 0.6]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 70.0\n"
        }
        Look::Parallel => {
            "[[view]]\neye = [0.5, 0.5, -2.0]\ntarget = [0.5, 0.5, 0.5]\nup = [0.0, 1.0, 0.0]\nheight = 1.1\n"
        }
    };
    text
}

/// A scene's text with another transfer function in its only channel.
pub fn with_transfer(text: &str, transfer: &str) -> String {
    let (begin, end) = (text.find("transfer = ["), text.find("[[view]]"));
    let (begin, end) = (begin.expect("a transfer"), end.expect("a view"));
    format!("{}{transfer}{}", &text[..begin], &text[end..])
}

fn parsed(source: &dyn BrickSource, look: Look, overrides: &Overrides) -> Scene {
    let channels = &source.description().channels;
    let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
    let text = scene_text(&formats, look);
    Scene::from_toml(&text, Path::new("made.toml"), overrides).unwrap_or_else(|why| panic!("{why}"))
}

/// Paged, with what `change` says.
pub fn paged(change: impl FnOnce(&mut PagingSettings)) -> Settings {
    let mut paging = PagingSettings::default();
    change(&mut paging);
    Settings { addressing: Addressing::Paged, paging, ..Settings::default() }
}

/// Paged, with so many slots.
pub fn slots(count: u32) -> Settings {
    paged(|paging| paging.atlas_slots = Some(count))
}

/// The first view, which must be finished.
pub fn finished(device: &Device, data: &SceneData, settings: &Settings) -> Drawn {
    let drawn = device.draw_with(data, 0, settings);
    let statistics = &drawn.statistics;
    assert!(statistics.converged, "{settings:?}: {statistics:?}");
    assert_eq!(statistics.unfinished, None, "{settings:?}");
    assert_eq!(statistics.rays_waiting, 0, "{settings:?}");
    assert_eq!(statistics.bricks_failed, 0, "{settings:?}");
    drawn
}

/// As compared.
pub fn pixel_bytes(picture: &Picture) -> &[u8] {
    bytemuck::cast_slice(&picture.pixels)
}

/// Fails with the count of pixels that differ and the largest difference.
#[track_caller]
pub fn assert_same(got: &Picture, want: &Picture, what: &str) {
    if pixel_bytes(got) != pixel_bytes(want) {
        let pairs = || got.pixels.iter().zip(&want.pixels);
        let differ = pairs().filter(|(a, b)| a != b).count();
        let parts = pairs().flat_map(|(a, b)| (0..4).map(move |part| (a[part] - b[part]).abs()));
        let most = parts.fold(0.0, f32::max);
        panic!("{what}: {differ} of {} pixels differ, by {most:e} at most", got.pixels.len());
    }
}

/// PSNR of one picture against another, dB.
pub fn psnr_db(got: &Picture, want: &Picture) -> f64 {
    let truth: Vec<[f64; 4]> = want.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    picture_error(&got.pixels, &truth).whole.psnr_db
}

/// Pixels in which something is seen.
pub fn covered(picture: &Picture) -> usize {
    picture.pixels.iter().filter(|pixel| pixel[3] > 0.01).count()
}
