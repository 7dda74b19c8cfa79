//! `ashfall bench store` runs small here, so that it cannot rot; a large index opens at once.

mod folder;
mod random;
mod support;

use std::process::Command;

use folder::Folder;
use serde_json::Value;

fn bench(folder: &Folder, arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_ashfall"))
        .args(["bench", "store", "--json", "--folder", folder.as_ref().to_str().unwrap()])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(folder.names().is_empty(), "the bench cleans up");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_part_gives_its_figures() {
    let folder = Folder::in_memory();
    let all = ["--edge", "64", "--repeats", "1", "--open-bricks", "1000"];
    let figures = bench(&folder, &all);
    assert_eq!(figures["format"], 1);
    assert!(figures["import"]["import"]["wall_s"].as_f64().unwrap() > 0.0);
    assert_eq!(figures["reads"].as_array().unwrap().len(), 2, "bricks of 16 and 32 fit in 64");
    assert!(figures["reads"][0]["warm"]["store_against_files"].as_f64().unwrap() > 0.0);
    assert!(figures["decode"]["decode_time_against_memcpy"].as_f64().unwrap() > 0.0);
    assert!(figures["memory"][0]["peak_rss_mib"].as_f64().unwrap() > 0.0);
    assert!(figures["open"]["bricks"].as_u64().unwrap() >= 1000);
}

#[test]
fn twelve_million_bricks_open_within_50_ms_and_20_mb() {
    let folder = Folder::in_memory();
    let figures = bench(&folder, &["--part", "open", "--repeats", "3"]);
    let open = &figures["open"];
    assert!(open["bricks"].as_u64().unwrap() >= 12_000_000);
    let [open_ms, first_ms, peak_mib] =
        ["open_ms", "first_brick_ms", "peak_rss_mib"].map(|key| open[key].as_f64().unwrap());
    assert!(open_ms + first_ms < 50.0, "{open}");
    assert!(peak_mib < 20.0, "{open}");
}

#[test]
fn an_unknown_part_is_a_wrong_argument() {
    let output = Command::new(env!("CARGO_BIN_EXE_ashfall"))
        .args(["bench", "store", "--part", "nothing"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
}
