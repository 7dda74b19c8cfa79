//! `ashfall verify`: reads every byte of a store and names what is damaged.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use crate::cli::output::print_line;
use crate::cli::{cores, progress};
use crate::error::{Error, Exit, Result};
use crate::store::{Damage, Store, verify};

/// Read every byte of a store and name what is damaged.
///
/// Every brick is read, checked against its checksum, decoded, and compared with its value range. Ends
/// with exit code 6 when something is damaged, naming channel, level, x, y and z of the brick.
#[derive(Args)]
pub struct Arguments {
    /// The store.
    file: PathBuf,
    /// Threads that work; absent: one per core.
    #[arg(long, value_name = "THREADS", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.file;
    let bar = progress::bricks("verifying");
    let report = cores::pool(arguments.jobs)?.install(|| {
        verify(path, &|done, total| {
            bar.set_length(total);
            bar.set_position(done);
        })
    });
    bar.finish_and_clear();
    let report = match report {
        // A store that does not open is one damaged as a whole; what never was one is bad input.
        Err(why) if why.exit == Exit::Input && Store::is_store(path) => {
            if arguments.json {
                let damages = [json!({ "message": why.message })];
                print_line(json!({ "format": 1, "whole": false, "damages": damages }))?;
            }
            return Err(Error::difference(why.message));
        }
        report => report?,
    };
    let whole = report.damaged_bricks == 0;
    if arguments.json {
        let damages: Vec<Value> = report.damages.iter().map(damage_json).collect();
        print_line(json!({ "format": 1, "whole": whole, "bricks": report.bricks,
                    "stored_bytes": report.stored_bytes,
                    "damaged_bricks": report.damaged_bricks, "damages": damages }))?;
    } else {
        for damage in &report.damages {
            print_line(format_args!(
                "{} (from {}, {} brick(s))",
                damage.message, damage.brick, damage.bricks
            ))?;
        }
    }
    if whole {
        if !arguments.json {
            print_line(format_args!("{}: whole, {} bricks", path.display(), report.bricks))?;
        }
        return Ok(());
    }
    let first = &report.damages[0];
    Err(Error::difference(format!(
        "{}: {} of {} bricks are damaged, first {}; import the volume again or fetch a whole copy",
        path.display(),
        report.damaged_bricks,
        report.bricks,
        first.brick,
    )))
}

fn damage_json(damage: &Damage) -> Value {
    let id = damage.brick;
    json!({
        "channel": id.channel, "level": id.level, "x": id.x, "y": id.y, "z": id.z,
        "bricks": damage.bricks, "message": damage.message,
    })
}
