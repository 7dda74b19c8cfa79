//! `ashfall bench store`: what the store costs, as ratios measured in one run.

mod data;
mod memory;
mod open;
mod reads;
mod speed;

use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value, json};

use crate::cli::output::{print_line, say};
use crate::error::{Error, Result};

/// Import against `lz4 -1`, brick reads against one file per brick, opening, decoding, memory.
///
/// Files are made in a folder of their own and removed at the end; a run at the default size needs
/// about 3 GB there. Figures are medians.
#[derive(Args)]
#[command(
    after_help = "The parts are import, reads, decode, memory and open; without --part all run.\n\
    Reads are warm (from the page cache) and, where `dd` can drop a file from it, cold."
)]
pub struct Arguments {
    /// Where to make files.
    #[arg(long, default_value = ".", value_name = "FOLDER")]
    folder: PathBuf,
    /// Voxels along each axis of the volume (u8).
    #[arg(long, default_value_t = 512, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(64..=4096))]
    edge: u32,
    /// Times that each import and each series of reads is repeated.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Bricks of the large store that is only opened.
    #[arg(long, default_value_t = 12_000_000, value_name = "BRICKS",
          value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    open_bricks: u64,
    /// Run this part alone; may be given more than once.
    #[arg(long, value_name = "PART")]
    part: Vec<String>,
    /// Only open this store, read one brick, and print time and memory: a process of its own for the
    /// part `open`.
    #[arg(long, value_name = "FILE", conflicts_with = "part")]
    open: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// A folder that goes when the bench ends.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

type Part = fn(&Arguments, &Folder) -> Result<Value>;

const PARTS: [(&str, Part); 5] = [
    ("import", speed::import_against_lz4),
    ("reads", reads::against_files),
    ("decode", reads::decode_against_memcpy),
    ("memory", memory::against_size),
    ("open", open::large_store),
];

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(file) = &arguments.open {
        return print_line(open::once(file)?);
    }
    if let Some(part) =
        arguments.part.iter().find(|part| PARTS.iter().all(|(name, _)| name != part))
    {
        let names = PARTS.map(|(name, _)| name).join(", ");
        return Err(Error::arguments(format!(
            "--part: there is no part {part}; choose of {names}"
        )));
    }
    let folder = Folder(arguments.folder.join(format!("ashfall-bench-{}", std::process::id())));
    std::fs::create_dir(&folder.0).map_err(|why| disk(&folder, &why))?;
    let mut results = Map::new();
    results.insert("format".to_owned(), json!(1));
    results.insert("cores".to_owned(), json!(crate::cli::cores::all_cores()));
    for (name, part) in PARTS {
        if arguments.part.is_empty() || arguments.part.iter().any(|wanted| wanted == name) {
            say(format_args!("measuring {name}"));
            results.insert(name.to_owned(), part(arguments, &folder)?);
        }
    }
    let results = Value::Object(results);
    if arguments.json { print_line(&results) } else { print_line(format_args!("{results:#}")) }
}

fn disk(folder: &Folder, why: &std::io::Error) -> Error {
    Error::machine(format!("{}: cannot write ({why}); choose another --folder", folder.0.display()))
}

/// The middle value.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
