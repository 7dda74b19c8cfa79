//! `ashfall bench`: measurements as commands, one file per subject.

use clap::Subcommand;

use crate::cli::bench_store;
use crate::error::Result;

/// Measure, and print the figures.
#[derive(Subcommand)]
pub enum Bench {
    /// Import against `lz4 -1`, brick reads against one file per brick, opening, decoding, memory.
    Store(bench_store::Arguments),
}

/// Runs the bench that was named.
pub fn run(bench: &Bench) -> Result<()> {
    match bench {
        Bench::Store(arguments) => bench_store::run(arguments),
    }
}
