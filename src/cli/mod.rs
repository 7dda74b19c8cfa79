//! The face: one file per command; arguments in, exit code out.
//!
//! What was typed is parsed by clap, turned into what it means, and run by one `match`. Results go to
//! stdout, progress and logs to stderr.

mod bench;
mod bench_store;
mod import;
mod info;
mod interrupt;
mod progress;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::Result;

#[derive(Parser)]
#[command(name = "ashfall", version, about, propagate_version = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a brick store of a volume in any format known.
    Import(import::Arguments),
    /// Say what a store or another readable file holds.
    Info(info::Arguments),
    /// Read every byte of a store and name what is damaged.
    Verify(verify::Arguments),
    /// Measure, and print the figures.
    #[command(subcommand)]
    Bench(bench::Bench),
}

/// Runs the command that was typed; the exit code is the contract's.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(why) => {
            // Help and version go to stdout and are no error; clap knows which is which.
            let _ = why.print();
            return ExitCode::from(if why.use_stderr() { 2 } else { 0 });
        }
    };
    match run(arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("ashfall: {why}");
            ExitCode::from(why.exit as u8)
        }
    }
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Import(arguments) => import::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Bench(bench) => bench::run(&bench),
    }
}
