//! The face: one file per command; arguments in, exit code out.
//!
//! What was typed is parsed by clap, turned into what it means, and run by one `match`. Results go to
//! stdout, progress and logs to stderr.
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "`output` has the doors to both, which do not panic when nobody reads or a disk is full"
)]

mod bare_file;
mod bench;
mod compare;
mod cores;
mod devices;
mod error_flags;
mod import;
mod info;
mod interrupt;
mod load;
mod measuring;
mod output;
mod paging_flags;
mod picture_file;
mod plan;
mod progress;
mod reading;
mod reference;
mod render;
mod replay_flags;
mod scene_flags;
mod stereo_flags;
mod study;
mod trace;
mod trace_file;
mod verify;
#[cfg(feature = "viewer")]
mod view;
mod views_flags;
mod whole_file;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::{Exit, Result};

pub use load::load_scene;
pub use picture_file::{read_exr, write_picture};

/// Draws volumes that fit in no memory, and says how far from the truth each picture is.
///
/// A scene is a TOML file; start with `ashfall render scene.toml -o picture.png`. Every command
/// prints results on stdout (with --json: one object) and progress on stderr, and ends with 0: done,
/// 1: a bug, 2: wrong arguments, 3: unusable input, 4: the machine lacks something, 5: finished but
/// incomplete, 6: a difference was found.
#[derive(Parser)]
#[command(name = "ashfall", version, propagate_version = true, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<render::Arguments>),
    #[cfg(feature = "viewer")]
    View(Box<view::Arguments>),
    Plan(plan::Arguments),
    Compare(compare::Arguments),
    Reference(reference::Arguments),
    Devices(devices::Arguments),
    Import(import::Arguments),
    Info(info::Arguments),
    Verify(verify::Arguments),
    Study(Box<study::Arguments>),
    Trace(trace::Arguments),
    Bench(bench::Arguments),
}

/// Runs the command that was typed; the exit code is the contract's.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(why) => {
            // Help and version go to stdout and are no error; clap knows which is which.
            if why.use_stderr() {
                let _ = why.print();
                return ExitCode::from(Exit::Arguments as u8);
            }
            return ended(output::printed(why.print()));
        }
    };
    ended(run(arguments.command))
}

fn ended(result: Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            output::say(&why);
            ExitCode::from(why.exit as u8)
        }
    }
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Render(arguments) => render::run(&arguments),
        #[cfg(feature = "viewer")]
        Command::View(arguments) => view::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Reference(arguments) => reference::run(&arguments),
        Command::Devices(arguments) => devices::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Study(arguments) => study::run(&arguments),
        Command::Trace(arguments) => trace::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
    }
}
