//! What several tests need.

// Each test file uses its own part of this.
#![allow(dead_code)]

pub mod created;
pub mod device;
pub mod drawing;
pub mod texels;

use std::path::PathBuf;

/// The folder of test volumes and scenes: `ASHFALL_SHARED`, else `../shared`, where its `data` is.
/// Says out loud when there is none, so that a skipped test is seen.
pub fn shared_data() -> Option<PathBuf> {
    let shared = std::env::var_os("ASHFALL_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let data = shared.join("data");
    if data.is_dir() {
        return Some(data);
    }
    eprintln!("SKIPPED: {} is missing; set ASHFALL_SHARED to run this test", data.display());
    None
}
