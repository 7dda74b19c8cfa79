//! `ashfall bench`: prices, as ratios within one run.

mod features;
mod interaction;
mod octree;
mod overhead;
mod overlap;
mod pacing;
mod paging;
mod sample;
mod store;
mod trace;
mod upload;

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
    Overhead(overhead::Arguments),
    Overlap(Box<overlap::Arguments>),
    Octree(octree::Arguments),
    Upload(upload::Arguments),
    Paging(paging::Arguments),
    Pacing(Box<pacing::Arguments>),
    Sample(sample::Arguments),
    Features(features::Arguments),
    Interaction(Box<interaction::Arguments>),
    Store(store::Arguments),
    Trace(Box<trace::Arguments>),
}

/// Runs one bench.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.bench {
        Bench::Overhead(arguments) => overhead::run(arguments),
        Bench::Overlap(arguments) => overlap::run(arguments),
        Bench::Octree(arguments) => octree::run(arguments),
        Bench::Upload(arguments) => upload::run(arguments),
        Bench::Paging(arguments) => paging::run(arguments),
        Bench::Pacing(arguments) => pacing::run(arguments),
        Bench::Sample(arguments) => sample::run(arguments),
        Bench::Features(arguments) => features::run(arguments),
        Bench::Interaction(arguments) => interaction::run(arguments),
        Bench::Store(arguments) => store::run(arguments),
        Bench::Trace(arguments) => trace::run(arguments),
    }
}
