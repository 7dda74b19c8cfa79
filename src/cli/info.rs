//! `ashfall info`: what a store or another readable file holds.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use crate::cli::output::{print, print_line};
use crate::cli::reading::Reading;
use crate::error::Result;
use crate::import::{Header, open};
use crate::source::{BrickSource, Description};
use crate::store::Store;
use crate::volume::WorldFromVoxel;

/// Say what a store or another readable file holds.
///
/// Reads headers alone, so it is quick whatever the size.
#[derive(Args)]
pub struct Arguments {
    /// A store or a file that `ashfall import` reads.
    file: PathBuf,
    #[command(flatten)]
    reading: Reading,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.file;
    if Store::is_store(path) {
        let store = Store::open(path)?;
        let description = store.description();
        if arguments.json {
            let bricks = store.numbering().count();
            print_line(json!({ "format": 1, "kind": "store", "bricks": bricks,
                        "volume": description_json(description) }))?;
        } else {
            print(store_text(&store))?;
        }
    } else {
        let input = open(path, &arguments.reading.options())?;
        let header = input.header();
        if arguments.json {
            print_line(header_json(header))?;
        } else {
            print(header_text(header))?;
        }
    }
    Ok(())
}

/// A description as JSON: the `volume` of `info`, `import` and `verify`.
pub fn description_json(description: &Description) -> Value {
    let channels: Vec<Value> = description
        .channels
        .iter()
        .map(|row| {
            // JSON has no infinity: a channel without a value has no range.
            let range = (!row.range.is_empty()).then_some([row.range.least, row.range.greatest]);
            json!({
                "type": row.format.name(), "slope": row.slope, "intercept": row.intercept,
                "range": range, "nan_voxels": row.nan_voxels,
                "infinite_voxels": row.infinite_voxels, "absent_voxels": row.absent_voxels,
            })
        })
        .collect();
    let levels: Vec<Value> = description
        .levels
        .iter()
        .map(|level| json!({ "size": level.size.to_array(), "scale": level.scale }))
        .collect();
    json!({
        "name": description.name,
        "size": description.size().to_array(),
        "brick": description.payload.to_array(),
        "transform": description.world_from_voxel.rows(),
        "unit": description.unit,
        "provenance": description.provenance,
        "channels": channels,
        "levels": levels,
    })
}

fn header_json(header: &Header) -> Value {
    json!({
        "format": 1,
        "kind": header.format_name,
        "size": header.size.to_array(),
        "channels": header.channels,
        "times": header.times,
        "type": header.format.name(),
        "transform": header.world_from_voxel.rows(),
        "unit": header.unit,
        "scaling": header.scaling,
        "absent_voxels": header.absent_voxels,
        "notes": header.notes,
    })
}

fn transform_text(map: &WorldFromVoxel) -> String {
    let [x, y, z] = map.spacing().to_array();
    let [a, b, c] = map.rows();
    format!(
        "voxel        {x} x {y} x {z}\ntransform    {a:?}\n             {b:?}\n             {c:?}\n"
    )
}

fn unit_text(unit: Option<&str>) -> String {
    unit.map_or_else(
        || "unit         not known\n".to_owned(),
        |unit| format!("unit         {unit}\n"),
    )
}

fn store_text(store: &Store) -> String {
    let description = store.description();
    let mut text = format!(
        "store        \"{}\"\nsize         {}\nbrick        {} (and an apron of 1)\nbricks       {}\n",
        description.name,
        description.size(),
        description.payload,
        store.numbering().count(),
    );
    text += &transform_text(&description.world_from_voxel);
    text += &unit_text(description.unit.as_deref());
    for (number, level) in description.levels.iter().enumerate() {
        let [x, y, z] = level.scale;
        text += &format!("level {number:<6} {} (each voxel {x} x {y} x {z})\n", level.size);
    }
    for (number, row) in description.channels.iter().enumerate() {
        text += &format!("channel {number:<4} {}", row.format);
        if row.range.is_empty() {
            text += ", no value";
        } else {
            text += &format!(", stored values {} to {}", row.range.least, row.range.greatest);
        }
        if (row.slope, row.intercept) != (1.0, 0.0) {
            text += &format!(", scaled by {} plus {}", row.slope, row.intercept);
        }
        let counts = [
            ("NaN", row.nan_voxels),
            ("infinite", row.infinite_voxels),
            ("absent", row.absent_voxels),
        ];
        for (what, count) in counts.iter().filter(|(_, count)| *count > 0) {
            text += &format!(", {count} {what}");
        }
        text += "\n";
    }
    for line in description.provenance.lines() {
        text += &format!("from         {line}\n");
    }
    text
}

fn header_text(header: &Header) -> String {
    let mut text = format!(
        "format       {}\nsize         {}\nchannels     {} of {}\ntime steps   {}\n",
        header.format_name, header.size, header.channels, header.format, header.times,
    );
    text += &transform_text(&header.world_from_voxel);
    text += &unit_text(header.unit.as_deref());
    for (channel, (slope, intercept)) in header.scaling.iter().enumerate() {
        text += &format!("channel {channel:<4} scaled by {slope} plus {intercept}\n");
    }
    if header.absent_voxels > 0 {
        text += &format!("absent       {} voxels\n", header.absent_voxels);
    }
    for note in &header.notes {
        text += &format!("note         {note}\n");
    }
    text
}
