//! `ashfall bench overhead`, `octree`, `upload`, `paging`, `features` and `trace` run small here, so that they cannot
//! rot. What they count is held to; what they time is not.

mod folder;
mod random;
mod support;

use std::process::{Command, Output};

use folder::Folder;
use serde_json::Value;

fn bench(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ashfall")).arg("bench").args(arguments).output().unwrap()
}

fn figures(arguments: &[&str]) -> Value {
    let output = bench(&[arguments, &["--json", "--validate"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(figures["format"], 1);
    for key in ["device", "driver", "clock"] {
        assert!(figures[key].is_string(), "{key}");
    }
    figures
}

/// Whether median, least and most are there and in order.
fn is_spread(value: &Value) -> bool {
    let parts = ["least", "median", "most"].map(|key| value[key].as_f64());
    let [Some(least), Some(median), Some(most)] = parts else { return false };
    least <= median && median <= most
}

#[test]
fn overhead_compares_equal_pictures_without_loading() {
    let small = ["--edge", "64", "--payload", "16", "--size", "48x48", "--repeats", "1"];
    let table = figures(&[&["overhead"], &small[..]].concat());
    let cases = table["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 6, "two scenes, three filters");
    for case in cases {
        assert_eq!(case["bricks_uploaded"], 0, "{case}");
        let psnr = &case["psnr_db"];
        assert!(psnr.is_null() || psnr.as_f64().unwrap() >= 90.0, "{case}");
        for key in ["direct_ms", "paged_ms", "ratio", "march_ratio", "management_share"] {
            assert!(is_spread(&case[key]), "{key} of {case}");
        }
        assert!(is_spread(&case["marks_share"]) && case["ratio_goal"].is_number());
        let [direct, paged] =
            ["direct_samples", "paged_samples"].map(|key| case[key].as_u64().unwrap());
        match case["scene"].as_str() {
            Some("dense") => {
                assert_eq!(direct, paged, "nothing is skipped");
                assert_eq!(case["bricks_hidden"], 0);
                assert_eq!(case["bricks_resident"], 64, "all of them");
            }
            _ => assert!(paged < direct, "hidden bricks are crossed: {case}"),
        }
    }
}

#[test]
fn octree_compares_traversals_of_equal_pictures() {
    let folder = Folder::in_memory();
    let output = folder.as_ref().to_str().unwrap();
    let small = ["--edge", "64", "--payload", "16", "--size", "24x24"];
    let turns = ["--views", "2", "--repeats", "1", "--only", "computed-x4,sparse,dense"];
    let figure = ["--figure", output, "--channels", "1,2"];
    let table = figures(&[&["octree"], &small[..], &turns, &figure].concat());
    let cases = table["cases"].as_array().unwrap();
    let names: Vec<_> = cases.iter().map(|case| case["case"].as_str().unwrap()).collect();
    assert_eq!(names, ["computed-x4", "sparse", "dense"]);
    for case in cases {
        let rows = case["rows"].as_array().unwrap();
        let words = ["page-table-of-paper", "page-table", "octree", "residency-octree", "auto"];
        let traversals: Vec<_> =
            rows.iter().map(|row| row["traversal"].as_str().unwrap()).collect();
        assert_eq!(traversals, words, "{case}");
        let number = |row: usize, key: &str| rows[row][key].as_f64().unwrap();
        for row in rows {
            let psnr = &row["psnr_db"];
            assert!(psnr.is_null() || psnr.as_f64().unwrap() >= 60.0, "{row}");
            for key in ["ms", "over_page_table_of_paper", "over_page_table", "march_ms"] {
                assert!(is_spread(&row[key]), "{key} of {row}");
            }
            assert!(row["bricks_needed"].as_f64().unwrap() > 0.0, "{row}");
        }
        assert_eq!(number(0, "bricks_ratio"), 1.0, "over itself");
        assert!(number(3, "bricks_needed") <= number(1, "bricks_needed"), "{case}");
        assert!(number(3, "samples") <= number(1, "samples"), "{case}");
        assert!(number(1, "samples") <= number(0, "samples"), "{case}");
        assert!(number(3, "octree_bytes") > 0.0 && number(1, "octree_bytes") == 0.0, "{case}");
    }
    assert_eq!(cases[2]["rows"][4]["time_goal"], 1.03);
    assert!(cases[1]["rows"][4]["time_goal"].is_null(), "a goal of 1024 voxels");
    let leaves = table["leaves"]["rows"].as_array().unwrap();
    assert_eq!(leaves.len(), 10, "five leaf sizes, two counts of channels");
    let csv = std::fs::read_to_string(folder.path("octree_leaves.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + leaves.len());
    assert!(csv.starts_with("channels,leaf,ms,") && csv.contains("\n2,8x8x4,"), "{csv}");
    let svg = std::fs::read_to_string(folder.path("octree_leaves.svg")).unwrap();
    for words in ["<svg", "</svg>", "leaf 8x8x4", "page-table-of-paper", "fan-out 4"] {
        assert!(svg.contains(words), "{words}");
    }
}

/// Two windows of one volume, and what a missing file says.
#[test]
fn octree_draws_scene_files_by_name() {
    let folder = Folder::in_memory();
    let scene = r#"format = 1
[[volume]]
name = "bonsai"
source = { computed = "shells", size = [32, 32, 32] }
[[volume.channel]]
window = [0.0, 255.0]
transfer = [{ at = 0.3, color = [0.5, 0.5, 0.5], extinction = 0.0 }, { at = 1.0, color = [1.0, 1.0, 1.0], extinction = 0.5 }]
[[view]]
name = "front"
eye = [16.0, 20.0, 80.0]
target = [16.0, 16.0, 16.0]
up = [0.0, 1.0, 0.0]
fov_degrees = 36.0
"#;
    std::fs::write(folder.path("bonsai.toml"), scene).unwrap();
    let scenes = folder.as_ref().to_str().unwrap();
    let small = ["--payload", "8", "--size", "16x16", "--views", "2", "--repeats", "1"];
    let only = ["--scenes", scenes, "--only", "bonsai,bonsai-x4"];
    let table = figures(&[&["octree"], &small[..], &only].concat());
    let cases = table["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 2);
    let channels: Vec<_> = cases.iter().map(|case| case["channels"].as_u64().unwrap()).collect();
    assert_eq!(channels, [1, 4]);
    assert_eq!(cases[1]["rows"][4]["bricks_goal"], 0.27);
    assert!(table["leaves"].is_null());
    let missing = bench(&["octree", "--scenes", scenes, "--only", "dna"]);
    assert_eq!(missing.status.code(), Some(3));
}

#[test]
fn upload_gives_every_rate_and_says_what_it_left_out() {
    let table = figures(&[
        "upload",
        "--payload",
        "8,14",
        "--mib",
        "1",
        "--staging-mib",
        "1",
        "--repeats",
        "1",
    ]);
    let rows = table["rows"].as_array().unwrap();
    let straight: Vec<_> = rows.iter().filter(|row| row["path"] == "straight").collect();
    assert_eq!(straight.len(), 8, "two payloads, four formats");
    let left_out = table["left_out"].as_array().unwrap();
    let placed: Vec<_> = rows.iter().filter(|row| row["path"] == "placed").collect();
    assert_eq!(placed.len() + 2 * left_out.len(), 8, "measured, or left out for both payloads");
    assert_eq!(rows.len(), straight.len() + placed.len());
    for placed in &placed {
        let same = |row: &&&Value| {
            ["payload", "voxels", "layout", "bricks", "brick_bytes"]
                .iter()
                .all(|key| row[*key] == placed[*key])
        };
        assert_eq!(straight.iter().filter(same).count(), 1, "as many bytes go straight: {placed}");
    }
    assert_eq!(straight[0]["brick_bytes"], 1000, "apron included");
    for row in rows {
        assert!(row["bricks"].as_u64().unwrap() >= 1, "{row}");
        for part in ["memcpy", "host", "copy", "together", "one_region"] {
            for key in ["gb_per_second", "over_memcpy", "wall_over_memcpy"] {
                assert!(is_spread(&row[part][key]), "{part}.{key} of {row}");
            }
        }
    }
    for left in left_out {
        assert_eq!(left["path"], "placed", "{left}");
        assert!(left["why"].as_str().unwrap().contains("cannot store"), "{left}");
    }
}

#[test]
fn paging_loads_each_brick_of_one_channel_about_once() {
    let folder = Folder::in_memory();
    let output = folder.as_ref().to_str().unwrap();
    let small = ["paging", "--edge", "48", "--size", "40x40", "--repeats", "1", "--slots", "8,all"];
    let table = figures(&[&small[..], &["--order", "guarded", "-o", output]].concat());
    let rows = table["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 6, "three scenes, two atlases");
    for row in rows {
        assert_eq!(row["converged"], true, "{row}");
        assert_eq!(row["repeats_agree"], true, "{row}");
        assert!(row["never_ends"].is_null() && is_spread(&row["ms"]), "{row}");
        let factor = row["factor"].as_f64().unwrap();
        assert!(factor >= 1.0, "each needed brick was uploaded: {row}");
        if row["scene"] != "4 channels" {
            assert!(factor <= 1.05, "{row}");
        }
    }
    let csv = std::fs::read_to_string(folder.path("paging.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + rows.len());
    assert!(csv.starts_with("scene,order,slots,"));
    let svg = std::fs::read_to_string(folder.path("paging.svg")).unwrap();
    for words in ["<svg", "</svg>", "slots of the atlas", "uploaded over needed", "rounds"] {
        assert!(svg.contains(words), "{words}");
    }
}

/// Bricks go by count and least recent use: whether such pictures end is theirs to say, not an error.
#[test]
fn an_unfinished_picture_in_the_papers_order_is_a_row() {
    let table = figures(&[
        "paging",
        "--edge",
        "48",
        "--size",
        "40x40",
        "--repeats",
        "1",
        "--slots",
        "8",
        "--order",
        "papers",
    ]);
    for row in table["rows"].as_array().unwrap() {
        assert_eq!(row["order"], "papers");
        assert_eq!(row["never_ends"].is_null(), row["converged"] == true, "{row}");
    }
}

#[test]
fn features_are_priced_by_taking_them_away() {
    let small = ["--edge", "40", "--payload", "8", "--size", "32x32", "--repeats", "1"];
    let table = figures(&[&["features"], &small[..]].concat());
    let rows = table["features"].as_array().unwrap();
    assert_eq!(rows.len(), 16);
    let row = |feature: &str| rows.iter().find(|row| row["feature"] == feature).unwrap();
    let count = |counts: &Value, key: &str| counts[key].as_u64().unwrap();
    let saved = |feature: &str, key: &str| {
        count(&table["fullest"], key) as i64 - count(&row(feature)["without"], key) as i64
    };
    for row in rows {
        assert!(is_spread(&row["ms"]) && is_spread(&row["time_ratio"]), "{row}");
        assert!(row["samples"].as_u64().unwrap() > 0, "{row}");
        let kinds = row["without"]["objects_of_kind"].as_object().unwrap();
        let sum: u64 = kinds.values().map(|count| count.as_u64().unwrap()).sum();
        assert_eq!(sum, count(&row["without"], "objects"), "{row}");
    }
    // What paging brings goes with it, and with the voxels that it pages.
    assert_eq!(row("paging")["and"].as_array().unwrap().len(), 5);
    assert_eq!(row("voxels that vary")["and"].as_array().unwrap().len(), 13);
    assert_eq!(row("voxels that vary")["without"]["passes"], 1);
    assert_eq!(row("voxels that vary")["without"]["images"], 0);
    assert!(saved("paging", "buffers") > 20 && saved("paging", "passes") > 5);
    // Three formats: a pass that places for each, and the buffers that all share.
    assert_eq!((saved("placed copies", "passes"), saved("placed copies", "buffers")), (3, 2));
    assert_eq!(saved("second channel", "images"), 1);
    assert!(saved("NaN voxels", "spirv_instructions") > 0);
    assert_eq!(saved("NaN voxels", "objects"), 0);
    assert_eq!(row("NaN voxels")["gone"], serde_json::json!(["macro NAN_VOXELS"]));
    assert!(saved("tiles", "memory_bytes") < 0, "a larger tile takes more");
}

/// Two views of a small computed volume.
const SHELLS: &str = r#"format = 1
[[volume]]
name = "shells"
source = { computed = "shells", size = [64, 64, 64] }
[[volume.channel]]
window = [0.0, 255.0]
transfer = [{ at = 0.3, color = [0.5, 0.5, 0.5], extinction = 0.0 }, { at = 1.0, color = [1.0, 1.0, 1.0], extinction = 0.1 }]
[[view]]
name = "front"
eye = [32.0, 40.0, 160.0]
target = [32.0, 32.0, 32.0]
up = [0.0, 1.0, 0.0]
fov_degrees = 36.0
[[view]]
name = "side"
eye = [160.0, 40.0, 32.0]
target = [32.0, 32.0, 32.0]
up = [0.0, 1.0, 0.0]
fov_degrees = 36.0
"#;

#[test]
fn every_way_of_travel_draws_the_same_bytes() {
    let folder = Folder::in_memory();
    let scene = folder.path("shells.toml");
    std::fs::write(&scene, SHELLS).unwrap();
    let small = ["--size", "24x20", "--level-max", "0", "--views", "3", "--repeats", "1"];
    let table = figures(&[&["overlap", scene.to_str().unwrap()], &small[..]].concat());
    let rows = table["rows"].as_array().unwrap();
    assert!(rows.len() >= 6, "two or three halves, three paths: {table}");
    for row in rows {
        assert!(is_spread(&row["ms"]) && is_spread(&row["over_first"]), "{row}");
        assert!(row["bricks"].as_u64().unwrap() > 3, "{row}");
        if row["queues"] == "one-queue" && !row["overlap"].is_null() {
            assert_eq!(row["overlap"]["median"], 0.0, "one queue has no overlap: {row}");
        }
    }
    assert_eq!(table["pictures"].as_str().unwrap().len(), 16);
    let not_run = table["not_run"].as_array().unwrap();
    let lavapipe = table["driver"].as_str().unwrap().contains("llvmpipe");
    assert!(!not_run.is_empty() && (!lavapipe || not_run.len() == 4), "{table}");
}

#[test]
fn pacing_says_what_frames_took_and_gave_up() {
    let folder = Folder::in_memory();
    let scene = folder.path("shells.toml");
    std::fs::write(&scene, SHELLS).unwrap();
    let out = folder.path("out");
    let small = ["--size", "24x20", "--budgets", "4,64", "--repeats", "1", "--disk-ms", "0.5"];
    let more = [scene.to_str().unwrap(), "-o", out.to_str().unwrap()];
    let table = figures(&[&["pacing"], &more[..], &small[..]].concat());
    let steps = table["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 15, "three ways, five parts of the path");
    for step in steps {
        let number = |key: &str| step[key].as_f64().unwrap_or_else(|| panic!("{key} of {step}"));
        assert!(number("frames") >= 1.0 && number("ms") > 0.0, "{step}");
        assert!(number("p95_ms") <= number("p99_ms") && number("p99_ms") <= number("worst_ms"));
        assert!((0.0..=1.0).contains(&number("over_target")), "{step}");
    }
    let csv = std::fs::read_to_string(out.join("pacing.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().count() > 80 && csv.lines().all(|line| line.split(',').count() == columns));
    let svg = std::fs::read_to_string(out.join("pacing.svg")).unwrap();
    assert!(svg.contains("sudden zoom") && svg.contains("paced") && !svg.contains("NaN"));
}

#[test]
fn a_trace_is_priced_by_equal_pictures() {
    let folder = Folder::in_memory();
    let scene = folder.path("shells.toml");
    std::fs::write(&scene, SHELLS).unwrap();
    let small = ["--size", "24x20", "--level-max", "0", "--atlas-slots", "4", "--repeats", "2"];
    let price = figures(&[&["trace", scene.to_str().unwrap()], &small[..]].concat());
    for key in ["off_ms", "on_ms", "ratio", "wall_ratio", "noise"] {
        assert!(is_spread(&price[key]), "{key} of {price}");
    }
    let number = |key: &str| price[key].as_f64().unwrap_or_else(|| panic!("{key} of {price}"));
    assert_eq!((number("views"), number("repeats"), number("ratio_goal")), (2.0, 2.0, 1.03));
    // Four slots: bricks come and go in every frame, and each tells its way.
    assert!(number("bricks_uploaded") >= 4.0 && number("rounds") > 1.0, "{price}");
    assert!(number("events") > 10.0 * number("rounds"), "{price}");
    assert!(number("places") > 0.3 * number("events"), "{price}");
    assert!(number("memory_bytes") > 40.0 * number("events"), "{price}");
    assert!(number("file_bytes") > number("memory_bytes"), "{price}");
    let share =
        number("places") * number("place_ns") * 1e-6 / price["off_ms"]["median"].as_f64().unwrap();
    assert!((number("off_share") / share - 1.0).abs() < 1e-9 && share < 0.01, "{price}");
    let stereo = bench(&["trace", scene.to_str().unwrap(), "--stereo", "side-by-side"]);
    assert_eq!(stereo.status.code(), Some(2), "{stereo:?}");
}

#[test]
fn wrong_words_are_wrong_arguments() {
    for arguments in [
        &["trace", "missing.toml", "--repeats", "0"][..],
        &["overhead", "--edge", "4"],
        &["overhead", "--size", "large"],
        &["octree", "--only", "any"],
        &["octree", "--only", "bonsai"],
        &["octree", "--views", "0"],
        &["octree", "--channels", "17"],
        &["upload", "--payload", "0"],
        &["paging", "--slots", "some"],
        &["paging", "--slots", "0"],
        &["paging", "--order", "any"],
        &["features", "--size", "large"],
        &["features", "--repeats", "0"],
        &["overlap", "missing.toml", "--views", "0"],
        &["pacing", "missing.toml", "--frame-ms", "0"],
        &["pacing", "missing.toml", "--budgets", "0"],
    ] {
        assert_eq!(bench(arguments).status.code(), Some(2), "{arguments:?}");
    }
    let missing = bench(&["paging", "--scene", "missing.toml"]);
    assert_eq!(missing.status.code(), Some(3));
}
