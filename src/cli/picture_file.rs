//! Pictures in files: PNG for looking, EXR for measuring.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ReadChannels, ReadLayers, Vec2,
    WritableImage,
};

use crate::error::{Error, Result};
use crate::render::{Picture, srgb_byte};

/// Writes a picture under a temporary name and renames it when whole; `.png` or `.exr` by the name.
///
/// # Errors
/// Exit code 2 for another ending, 4 when it cannot be written.
pub fn write_picture(path: &Path, picture: &Picture) -> Result<()> {
    write_layers(path, picture, &[])
}

/// As [`write_picture`], with more channels by name, a value per pixel each; `.png` leaves them out.
///
/// # Errors
/// As [`write_picture`].
pub fn write_layers(path: &Path, picture: &Picture, layers: &[(String, &[f32])]) -> Result<()> {
    let failed = |why: String| not_written(path, &why);
    let bytes = match kind_of(path)? {
        Kind::Png => png_bytes(picture).map_err(failed)?,
        Kind::Exr => exr_bytes(picture, layers).map_err(failed)?,
    };
    written_whole(path, &bytes)
}

/// Writes a text, as [`write_picture`] does.
///
/// # Errors
/// Exit code 4 when it cannot be written.
pub fn write_whole(path: &Path, text: &str) -> Result<()> {
    written_whole(path, text.as_bytes())
}

fn not_written(path: &Path, why: &str) -> Error {
    let path = path.display();
    Error::machine(format!("{path}: cannot be written: {why}; check folder and disk"))
}

/// Whole under its name, or not at all.
fn written_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let partial = partial_name(path);
    let written = File::create(&partial).and_then(|file| {
        let mut file = BufWriter::new(file);
        file.write_all(bytes)?;
        file.into_inner()?.sync_all()?;
        std::fs::rename(&partial, path)
    });
    written.map_err(|why| {
        // What is left of it is of no use.
        let _ = std::fs::remove_file(&partial);
        not_written(path, &why.to_string())
    })
}

/// Refuses an output name that [`write_picture`] would refuse, before any work is done.
///
/// # Errors
/// Exit code 2 for an unknown ending, 4 when the folder is not there.
pub fn check_output(path: &Path) -> Result<()> {
    kind_of(path)?;
    folder_is_there(path)
}

/// Refuses a file in a folder that is not there.
///
/// # Errors
/// Exit code 4 when the folder is not there.
pub(super) fn folder_is_there(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.is_dir() => Err(Error::machine(format!(
            "{}: folder {} is not there: make it first",
            path.display(),
            folder.display()
        ))),
        _ => Ok(()),
    }
}

/// Reads the first RGBA layer of an EXR file as linear f32.
///
/// # Errors
/// Exit code 3 when it cannot be read.
pub fn read_exr(path: &Path) -> Result<Picture> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| Picture {
                size: [size.width() as u32, size.height() as u32],
                pixels: vec![[0.0; 4]; size.width() * size.height()],
            },
            |picture: &mut Picture, Vec2(x, y), (r, g, b, a): (f32, f32, f32, f32)| {
                picture.pixels[y * picture.size[0] as usize + x] = [r, g, b, a];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|why| {
            Error::input(format!(
                "{}: cannot be read as an EXR picture with channels R, G, B and A: {why}",
                path.display()
            ))
        })?;
    Ok(image.layer_data.channel_data.pixels)
}

/// Reads one channel of an EXR file by name, where it has one.
///
/// # Errors
/// As [`read_exr`].
pub fn read_layer(path: &Path, name: &str) -> Result<Option<Vec<f32>>> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|why| {
            Error::input(format!("{}: cannot be read as an EXR picture: {why}", path.display()))
        })?;
    let channels = image.layer_data.channel_data.list;
    let found = channels.into_iter().find(|channel| channel.name == *name);
    Ok(found.map(|channel| channel.sample_data.values_as_f32().collect()))
}

enum Kind {
    Png,
    Exr,
}

fn kind_of(path: &Path) -> Result<Kind> {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("");
    match ending.to_ascii_lowercase().as_str() {
        "png" => Ok(Kind::Png),
        "exr" => Ok(Kind::Exr),
        _ => Err(Error::arguments(format!(
            "{}: a picture's name ends in .png (to look at) or .exr (to measure)",
            path.display()
        ))),
    }
}

/// The name of a file until it is whole.
pub(super) fn partial_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".partial-{}", std::process::id()));
    path.with_file_name(name)
}

/// 8 bit sRGB of the picture over its background; the nearest code, no dither.
fn png_bytes(picture: &Picture) -> std::result::Result<Vec<u8>, String> {
    let bytes: Vec<u8> =
        picture.pixels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b].map(srgb_byte)).collect();
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.size[0], picture.size[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|why| why.to_string())?;
    writer.write_image_data(&bytes).map_err(|why| why.to_string())?;
    writer.finish().map_err(|why| why.to_string())?;
    Ok(out)
}

fn exr_bytes(
    picture: &Picture,
    layers: &[(String, &[f32])],
) -> std::result::Result<Vec<u8>, String> {
    let [width, height] = picture.size.map(|edge| edge as usize);
    let part = |part: usize| picture.pixels.iter().map(|pixel| pixel[part]).collect();
    let own = ["R", "G", "B", "A"].into_iter().enumerate();
    let own = own.map(|(at, name)| AnyChannel::new(name, FlatSamples::F32(part(at))));
    let more = layers
        .iter()
        .map(|(name, values)| AnyChannel::new(name.as_str(), FlatSamples::F32(values.to_vec())));
    let channels = AnyChannels::sort(own.chain(more).collect());
    let image = Image::from_encoded_channels((width, height), Encoding::FAST_LOSSLESS, channels);
    let mut out = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut out).map_err(|why| why.to_string())?;
    Ok(out.into_inner())
}
