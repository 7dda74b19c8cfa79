//! What takes minutes and gigabytes: volumes far beyond every limit, and random use that must grow
//! nothing. Each test prints its figures in one line.
//!
//! `./tools/test --long`, or `cargo test --release --test long_paging -- --include-ignored --nocapture`.

mod binary;
mod common;
mod folder;
mod random;

#[path = "long_paging/chance.rs"]
mod chance;
#[path = "long_paging/drawn.rs"]
mod drawn;
#[path = "long_paging/mandelbulb.rs"]
mod mandelbulb;
#[path = "long_paging/on_disk.rs"]
mod on_disk;
#[path = "long_paging/process.rs"]
mod process;
#[path = "long_paging/random_use.rs"]
mod random_use;
#[path = "long_paging/scenes.rs"]
mod scenes;
#[path = "long_paging/uses.rs"]
mod uses;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// One test at a time: they measure this process, the disk and the clock.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}
