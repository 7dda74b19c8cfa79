//! A scene as the text of a scene file, which reads as the same scene again.

use std::fmt::Write as _;
use std::path::Path;

use crate::scene::{
    CameraPath, Channel, Projection, Quality, Refine, Scene, Source, TransferPoint, View, Volume,
};

impl Scene {
    /// The text of a scene file in `folder`. Files of volumes below it are named from there, others by their
    /// whole path, so that the text means the same wherever the program runs. Views come back to about 1e-15 of
    /// their distance from the origin, everything else exactly.
    pub fn to_toml(&self, folder: &Path) -> String {
        let mut text = "format = 1\n".to_owned();
        let Scene { picture, quality, memory, volumes, views, path } = self;
        let background = picture.background.map(f64::from);
        line(&mut text, format_args!("\n[picture]"));
        line(&mut text, format_args!("size = {:?}", picture.size));
        line(&mut text, format_args!("background = {background:?}"));
        write_quality(&mut text, quality);
        line(&mut text, format_args!("\n[memory]"));
        line(&mut text, format_args!("atlas_mib = {}", memory.atlas_mib));
        line(&mut text, format_args!("ram_mib = {}", memory.ram_mib));
        line(&mut text, format_args!("staging_mib = {}", memory.staging_mib));
        volumes.iter().for_each(|volume| write_volume(&mut text, volume, folder));
        views.iter().for_each(|view| write_view(&mut text, view));
        path.iter().for_each(|path| write_path(&mut text, path));
        text
    }
}

fn line(text: &mut String, words: std::fmt::Arguments<'_>) {
    // Strings take whatever is written.
    let _ = writeln!(text, "{words}");
}

/// With its quotes.
fn quoted(words: &str) -> String {
    toml::Value::String(words.to_owned()).to_string()
}

fn write_quality(text: &mut String, quality: &Quality) {
    let Quality { integrator, step, filter, refine, level_max, level_loss, early_stop, tolerance } =
        quality;
    line(text, format_args!("\n[quality]"));
    line(text, format_args!("integrator = \"{}\"", integrator.name()));
    line(text, format_args!("step = {step:?}"));
    if integrator.has_tolerance() {
        line(text, format_args!("tolerance = {tolerance:?}"));
    }
    line(text, format_args!("filter = \"{}\"", filter.name()));
    let refine = match refine {
        Refine::Exact => "exact",
        Refine::Substitute => "substitute",
    };
    line(text, format_args!("refine = \"{refine}\""));
    if let Some(level) = level_max {
        line(text, format_args!("level_max = {level}"));
    }
    if let Some(loss) = level_loss {
        line(text, format_args!("level_loss = {loss:?}"));
    }
    line(text, format_args!("early_stop = {early_stop:?}"));
}

fn write_volume(text: &mut String, volume: &Volume, folder: &Path) {
    line(text, format_args!("\n[[volume]]"));
    line(text, format_args!("name = {}", quoted(&volume.name)));
    match &volume.source {
        Source::Computed { kind, size } => {
            let (kind, size) = (quoted(kind), size.to_array());
            line(text, format_args!("source = {{ computed = {kind}, size = {size:?} }}"));
        }
        Source::File { path, raw } => {
            // A folder that is gone has no absolute path; the path then stays as it is.
            let whole = std::path::absolute(path).unwrap_or_else(|_| path.clone());
            let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
            let named = whole.strip_prefix(&folder).unwrap_or(&whole);
            line(text, format_args!("source = {}", quoted(&named.to_string_lossy())));
            if let Some(raw) = raw {
                let endian = if raw.big_endian { "big" } else { "little" };
                line(
                    text,
                    format_args!(
                        "raw = {{ size = {:?}, type = \"{}\", endian = \"{endian}\" }}",
                        raw.size.to_array(),
                        raw.format.name()
                    ),
                );
            }
        }
    }
    if let Some(map) = &volume.world_from_voxel {
        line(text, format_args!("transform = {:?}", map.rows()));
    }
    volume.channels.iter().for_each(|channel| write_channel(text, channel));
}

fn write_channel(text: &mut String, channel: &Channel) {
    let Channel { index, window, transfer, level_min, level_max, sample_every } = channel;
    line(text, format_args!("\n[[volume.channel]]"));
    line(text, format_args!("index = {index}"));
    line(text, format_args!("window = {window:?}"));
    line(text, format_args!("transfer = ["));
    for TransferPoint { at, color, extinction } in transfer.points() {
        let point = format!("at = {at:?}, color = {color:?}, extinction = {extinction:?}");
        line(text, format_args!("  {{ {point} }},"));
    }
    line(text, format_args!("]"));
    if *level_min > 0 {
        line(text, format_args!("level_min = {level_min}"));
    }
    if let Some(level) = level_max {
        line(text, format_args!("level_max = {level}"));
    }
    if *sample_every > 1 {
        line(text, format_args!("sample_every = {sample_every}"));
    }
}

fn write_view(text: &mut String, view: &View) {
    line(text, format_args!("\n[[view]]"));
    line(text, format_args!("name = {}", quoted(&view.name)));
    // Far enough that the direction keeps its digits beside the eye's.
    let target = view.eye + view.forward * view.eye.length().max(1.0);
    let triple = |of: glam::DVec3| of.to_array();
    line(text, format_args!("eye = {:?}", triple(view.eye)));
    line(text, format_args!("target = {:?}", triple(target)));
    line(text, format_args!("up = {:?}", triple(view.up)));
    match view.projection {
        Projection::Perspective { fov_degrees } => {
            line(text, format_args!("fov_degrees = {fov_degrees:?}"));
        }
        Projection::Orthographic { height } => line(text, format_args!("height = {height:?}")),
        Projection::Frustum { bounds } => line(text, format_args!("frustum = {bounds:?}")),
    }
}

fn write_path(text: &mut String, path: &CameraPath) {
    let CameraPath { through, frames, closed } = path;
    line(text, format_args!("\n[path]"));
    if !through.is_empty() {
        let names: Vec<_> = through.iter().map(|name| quoted(name)).collect();
        line(text, format_args!("through = [{}]", names.join(", ")));
    }
    line(text, format_args!("frames = {frames}"));
    line(text, format_args!("closed = {closed}"));
}
