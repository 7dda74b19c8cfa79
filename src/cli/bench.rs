//! `ashfall bench`: prices, as ratios within one run.

mod sample;
mod store;

use clap::{Args, Subcommand};

use crate::error::Result;

/// Measure prices on this machine, as ratios within one run.
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Subcommand)]
enum Bench {
    Sample(sample::Arguments),
    Store(store::Arguments),
}

/// Runs one bench.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.bench {
        Bench::Sample(arguments) => sample::run(arguments),
        Bench::Store(arguments) => store::run(arguments),
    }
}
