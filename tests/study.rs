//! `ashfall study`: the order that theory promises, going on after a stop, levels apart from integration,
//! and what it says of bad arguments and damaged files.

mod binary;
mod common;
mod folder;
mod truth;

use std::path::Path;

use ashfall::cli::read_exr;
use ashfall::reference::{Truth, VolumeLevel};
use ashfall::render::paging::{PagingSettings, RoundPicture};
use ashfall::render::{Addressing, Settings};
use ashfall::scene::{Integrator, Overrides, Quality};
use ashfall::study::error_metrics::picture_error;
use ashfall::study::stability::integrators;
use ashfall::study::sweep::{Axes, Axis, Setting, settings};
use binary::{Run, ashfall};
use common::drawing::{Device, dense, scene_data};
use folder::Folder;
use serde_json::Value;

/// A smooth bump, seen so that neighbouring rays cross cells differently. Its values are trilinear within
/// cells and its transfer function has no kinks within the window, so that the midpoint rule is of
/// second order.
const SCENE: &str = r#"format = 1
[picture]
size = [24, 20]
background = [0.1, 0.2, 0.3]
[[volume]]
name = "bump"
source = { computed = "marschner-lobb", size = [40, 40, 40] }
spacing = [0.025, 0.025, 0.025]
[[volume.channel]]
window = [0.0, 1.0]
transfer = [
  { at = 0.0, color = [0.2, 0.5, 0.9], extinction = 0.5 },
  { at = 1.0, color = [0.9, 0.6, 0.3], extinction = 4.0 },
]
[[view]]
name = "corner"
eye = [1.9, -0.8, 1.4]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 36.0
[[view]]
name = "other"
eye = [-2.0, 0.6, 0.4]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 36.0
"#;

/// No device is a failure, unless the environment says out loud that there is none.
fn no_device(run: &Run) -> bool {
    if run.code == Some(4) && std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        eprintln!("SKIPPED, because ASHFALL_NO_DEVICE is set: {}", run.stderr);
        return true;
    }
    false
}

fn study(folder: &Folder, flags: &[&str]) -> Run {
    let scene = folder.write("scene.toml", SCENE);
    let out = folder.path("out");
    let mut arguments = vec!["study".into(), scene.into_os_string(), "-o".into(), out.into()];
    arguments.extend(flags.iter().map(|flag| flag.into()));
    ashfall(arguments)
}

/// The one object on stdout of a run that ended well.
fn json(run: &Run) -> Value {
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let value: Value = serde_json::from_str(&run.stdout).expect("one object");
    assert_eq!(value["format"], 1);
    value
}

fn lines(path: &Path) -> Vec<String> {
    std::fs::read_to_string(path).expect("read").lines().map(str::to_owned).collect()
}

const SMALL: [&str; 8] =
    ["--json", "--validate", "--repeats", "1", "--only", "step", "--steps", "1,0.5,0.25,0.125"];

/// The midpoint rule's error falls with the square of the step; the journal makes a second run free, and
/// gives the same figures; a cut line is measured again, and nothing else is.
#[test]
fn the_midpoint_rule_is_of_second_order_and_a_study_goes_on() {
    let folder = Folder::new("study-order");
    let run = study(&folder, &SMALL);
    if no_device(&run) {
        return;
    }
    let first = json(&run);
    let order = &first["orders"][0];
    assert_eq!((&order["integrator"], &order["parameter"]), (&"riemann".into(), &"step".into()));
    let slope = order["observed"]["order"].as_f64().expect("an order");
    assert!((1.8..2.2).contains(&slope), "{order}");
    let rows = first["settings"].as_array().expect("settings");
    let order = &first["orders"][1];
    assert_eq!(order["integrator"], "preintegrated");
    let slope = order["observed"]["order"].as_f64().expect("an order");
    assert!(slope > 1.8, "{order}");
    let order = &first["orders"][2];
    assert_eq!(
        (&order["integrator"], &order["parameter"]),
        (&"adaptive".into(), &"tolerance".into())
    );
    let what = "four steps of two integrators and five tolerances, with early stop and without";
    assert_eq!(rows.len(), 26, "{what}");
    assert_eq!(first["measured_now"], 26);

    // Nothing is left to do, whatever the order of steps.
    let again = json(&study(&folder, &SMALL));
    assert_eq!((&again["measured_now"], &again["settings"]), (&0.into(), &first["settings"]));
    let journal = folder.path("out/measurements.journal");
    assert_eq!(lines(&journal).len(), 28, "study, reference, 26 settings");

    // Stopped while the last line was written.
    let bytes = std::fs::read(&journal).expect("read");
    std::fs::write(&journal, &bytes[..bytes.len() - 40]).expect("written");
    let resumed = json(&study(&folder, &SMALL));
    assert_eq!(resumed["measured_now"], 1);
    assert_eq!(lines(&journal).len(), 28);
    for (before, after) in rows.iter().zip(resumed["settings"].as_array().expect("settings")) {
        for figure in ["error", "samples"] {
            assert_eq!(before["measured"][figure], after["measured"][figure]);
        }
    }

    // More is measured beside what is known; other runs are another measurement.
    let more = json(&study(&folder, &[&SMALL[..7], &["1,2"]].concat()));
    assert_eq!(more["measured_now"], 4, "step 2, with early stop and without");
    assert_eq!(lines(&journal).len(), 32);
    let twice = ["--json", "--repeats", "2", "--only", "step", "--steps", "1"];
    assert_eq!(json(&study(&folder, &twice))["measured_now"], 14);
    assert_eq!(lines(&journal).len(), 46);
}

/// Everything is swept once; every key of the object is explained in docs/STUDY.md.
#[test]
fn every_axis_gives_rows_files_and_documented_keys() {
    let folder = Folder::new("study-all");
    let flags = [
        "--json",
        "--validate",
        "--repeats",
        "1",
        "--steps",
        "1,0.25",
        "--early-stops",
        "0,0.05",
        "--axis-step",
        "0.25",
        "--atlas-sizes",
        "1,256",
        "--view",
        "other",
        "--streaming-bricks",
        "2",
    ];
    let run = study(&folder, &flags);
    if no_device(&run) {
        return;
    }
    let table = json(&run);
    assert_eq!((&table["view"], &table["size"]), (&"other".into(), &serde_json::json!([24, 20])));
    let rows = table["settings"].as_array().expect("settings");
    let of = |axis: &str| rows.iter().filter(|row| row["axis"] == axis).count();
    assert_eq!(
        (of("step"), of("filter"), of("early_stop")),
        (18, 1, 1),
        "what repeats is left out"
    );
    assert_eq!((of("level"), of("atlas")), (2, 2), "40 voxels have two levels");
    assert!(of("level_max") >= 1, "a pixel is larger than a voxel here");
    for row in rows {
        let measured = &row["measured"];
        assert!(row["refused"].is_null() && measured["incomplete"].is_null(), "{row}");
        for time in ["ms", "wall_ms", "gpu_ms"] {
            let [least, median, most] =
                ["least", "median", "most"].map(|part| measured[time][part].as_f64());
            assert!(least <= median && median <= most && least > Some(0.0), "{time} of {row}");
        }
        assert!(measured["samples"].as_u64() > Some(0), "{row}");
        let psnr = measured["error"]["whole"]["psnr_db"].as_f64().expect("a figure");
        assert!(psnr > 20.0, "{row}");
        assert!(measured["error"]["ssim"].as_f64() > Some(0.5), "{row}");
        assert!(measured["error"]["flip"].as_f64() < Some(0.3), "{row}");
    }
    let front = rows.iter().filter(|row| row["pareto"] == true).count();
    assert!(front >= 1 && front < rows.len());
    for goal in table["cheapest"].as_array().expect("cheapest") {
        let Some(key) = goal["key"].as_str() else { continue };
        let row = rows.iter().find(|row| row["key"] == key).expect("a setting that was measured");
        let psnr = row["measured"]["error"]["whole"]["psnr_db"].as_f64();
        assert!(psnr >= goal["psnr_db"].as_f64(), "{goal}");
    }
    let levels = table["levels"].as_array().expect("levels");
    let rmse = |value: &Value| value["whole"]["rmse"].as_f64().expect("a figure");
    assert_eq!(rmse(&levels[0]["level_of_detail"]), 0.0);
    // Without its own level's error, what is left is of the step alone, as on level 0.
    assert!(
        rmse(&levels[1]["integration"]) < 0.2 * rmse(&levels[1]["level_of_detail"]),
        "{levels:?}"
    );
    let streaming = &table["streaming"];
    assert_eq!(streaming["converged"], true, "{streaming}");
    let rounds = streaming["rounds"].as_array().expect("rounds");
    let times: Vec<_> = rounds.iter().map(|round| round["ms"].as_f64()).collect();
    assert!(rounds.len() >= 5 && times.is_sorted(), "{times:?}");
    let last = rmse(&rounds[rounds.len() - 1]["error"]);
    assert!(last < rmse(&rounds[0]["error"]) && last < 0.01);

    let csv = lines(&folder.path("out/study.csv"));
    assert_eq!(csv.len(), 1 + rows.len());
    let columns = |line: &String| line.split(',').count();
    assert!(csv.iter().all(|line| columns(line) == columns(&csv[0])), "{csv:?}");
    assert_eq!(lines(&folder.path("out/streaming.csv")).len(), 1 + rounds.len());
    for name in ["study.svg", "streaming.svg"] {
        let svg = std::fs::read_to_string(folder.path("out").join(name)).expect("read");
        assert!(svg.contains("</svg>") && !svg.contains("NaN"), "{name}");
        assert!(svg.contains("RMSE over all pixels") && svg.contains(" dB<"), "{name}");
    }
    let kept: Value =
        serde_json::from_slice(&std::fs::read(folder.path("out/study.json")).expect("read"))
            .expect("JSON");
    assert_eq!(kept, table);
    explained(&table, "## What the figures mean");
}

/// Fails for a key that docs/STUDY.md does not explain under `heading`.
fn explained(table: &Value, heading: &str) {
    let docs = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/STUDY.md"))
        .expect("docs/STUDY.md");
    let section = docs.split("\n## ").find(|part| heading.ends_with(part.lines().next().unwrap()));
    let section = section.unwrap_or_else(|| panic!("docs/STUDY.md has no {heading}"));
    let mut keys = Vec::new();
    collect_keys(table, &mut keys);
    for key in keys {
        assert!(section.contains(&format!("`{key}`")), "{heading} does not explain `{key}`");
    }
}

fn collect_keys(value: &Value, keys: &mut Vec<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| {
            keys.push(key.clone());
            collect_keys(value, keys);
        }),
        Value::Array(list) => list.iter().for_each(|value| collect_keys(value, keys)),
        _ => {}
    }
}

/// What is refused, with its exit code and one sentence that names what is wrong.
#[test]
fn bad_arguments_and_damaged_files_are_one_sentence() {
    let folder = Folder::new("study-bad");
    for (flags, words) in [
        (&["--only", "speed"][..], "--only"),
        (&["--steps", "0"], "step"),
        (&["--steps", "-1"], "step"),
        (&["--steps", "nan"], "step"),
        (&["--axis-step", "1e9"], "step"),
        (&["--early-stops", "1"], "early_stop"),
        (&["--repeats", "0"], "--repeats"),
        (&["--error-max", "0"], "--error-max"),
        (&["--integrators", "magic"], "--integrators"),
        (&["--filters", "soft"], "--filters"),
        (&["--show-states"], "--show-states"),
        (&["--size", "5000x10"], "--size"),
        (&["--only", "level", "--levels", "9"], "--only"),
        (&["--view", "nowhere"], "--view"),
    ] {
        let run = study(&folder, flags);
        assert_eq!(run.code, Some(2), "{flags:?}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{flags:?}: {}", run.stderr);
    }
    let missing = ashfall(["study", "missing.toml", "-o", "out"]);
    assert_eq!(missing.code, Some(3), "{}", missing.stderr);
    assert_eq!(ashfall(["study", "missing.toml"]).code, Some(2), "-o is asked for");
    let scene = folder.write("scene.toml", SCENE);
    let on_file = ashfall(["study".as_ref(), scene.as_os_str(), "-o".as_ref(), scene.as_os_str()]);
    assert_eq!(on_file.code, Some(4), "{}", on_file.stderr);
    on_file.sentence().expect("one sentence");

    let flags = ["--repeats", "1", "--only", "step", "--steps", "2,1"];
    let run = study(&folder, &flags);
    if no_device(&run) {
        return;
    }
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.contains("cheapest for 40 dB"), "{}", run.stdout);
    let journal = folder.path("out/measurements.journal");
    let whole = std::fs::read(&journal).expect("read");
    let refused = |what: &str, line: &str| {
        let run = study(&folder, &flags);
        let sentence = run.sentence().expect(what).to_owned();
        assert_eq!(run.code, Some(3), "{what}: {sentence}");
        assert!(sentence.contains(&format!("measurements.journal:{line}: ")), "{what}: {sentence}");
        assert!(sentence.contains("remove the file"), "{what}: {sentence}");
    };
    // One bit, in whichever line; a line that is missing its first part; no text at all.
    let ends: Vec<usize> = (0..whole.len()).filter(|at| whole[*at] == b'\n').collect();
    for (index, end) in ends.iter().enumerate() {
        let mut bytes = whole.clone();
        bytes[end - 3] ^= 1;
        std::fs::write(&journal, &bytes).expect("written");
        refused("a bit", &(index + 1).to_string());
    }
    std::fs::write(&journal, &whole[ends[0] + 1..]).expect("written");
    refused("no first line", "1");
    std::fs::write(&journal, b"\xff\xfe\n\n").expect("written");
    refused("no text", "1");
    std::fs::write(&journal, &whole).expect("written");
    // Another size is another study.
    let other = study(&folder, &[&flags[..], &["--size", "8x8"]].concat());
    assert_eq!(other.code, Some(3), "{}", other.stderr);
    assert!(other.sentence().expect("one").contains("another scene"), "{}", other.stderr);
    // The reference that the figures belong to.
    let reference = folder.path("out/reference_level_0.npy");
    let mut bytes = std::fs::read(&reference).expect("read");
    assert_eq!(bytes.len(), 128 + 24 * 20 * 32);
    bytes[1000] ^= 1;
    std::fs::write(&reference, &bytes).expect("written");
    let damaged = study(&folder, &flags);
    assert_eq!(damaged.code, Some(3), "{}", damaged.stderr);
    assert!(damaged.sentence().expect("one").contains("reference_level_0.npy"));
    std::fs::remove_file(&reference).expect("removed");
    assert_eq!(study(&folder, &flags).code, Some(0), "it is integrated anew");
    bytes[1000] ^= 1;
    assert!(std::fs::read(&reference).expect("read") == bytes, "the same reference");
    // A journal that was cut within its first line begins anew.
    std::fs::write(&journal, &whole[..20]).expect("written");
    assert_eq!(study(&folder, &flags).code, Some(0));
    assert_eq!(lines(&journal).len(), 20);
}

/// A level drawn alone approximates the reference of that level, whose outermost voxels reach beyond a
/// volume of odd size.
#[test]
fn a_level_alone_is_measured_against_its_own_reference() {
    let Some(device) = Device::open() else { return };
    let text = SCENE.replace("[40, 40, 40]", "[45, 37, 50]");
    let flags = Overrides { level_max: Some(1), step: Some(0.125), ..Overrides::default() };
    let flags = Overrides { early_stop: Some(0.0), ..flags };
    let data = scene_data(&text, &flags);
    let settings = Settings { addressing: Addressing::Paged, level_min: 1, ..Settings::default() };
    let drawn = device.draw_with(&data, 0, &settings).picture;
    let (view, size) = (&data.scene.views[0], data.scene.picture.size);
    let truth = |level: u8, extent: [f64; 3]| {
        let voxels = data.level(0, level).expect("voxels");
        let volume = &data.scene.volumes[0];
        let levels = [VolumeLevel { volume, voxels: &voxels, extent_voxel: extent }];
        Truth::of_levels(view, size, data.scene.picture.background, &levels, 1e-9)
            .picture(2, &|_| {})
            .rgba
    };
    assert_eq!(data.volumes[0].extent_voxel(1), [22.5, 18.5, 25.0]);
    let psnr = |truth: &[[f64; 4]]| picture_error(&drawn.pixels, truth).covered.psnr_db;
    let own = psnr(&truth(1, [22.5, 18.5, 25.0]));
    let beyond = psnr(&truth(1, [23.0, 19.0, 25.0]));
    let finest = psnr(&truth(0, [45.0, 37.0, 50.0]));
    println!("own level {own:.1} dB, not cut {beyond:.1} dB, level 0 {finest:.1} dB");
    assert!(own > 65.0, "{own}");
    assert!(beyond < own - 15.0 && finest < own - 15.0, "{beyond} {finest}");
    device.finish();
}

/// In memory as from a formula: the voxels of a level are the means that import makes.
#[test]
fn voxels_of_a_level_are_means() {
    let rows = truth::rows([1.0, 2.0, 1.0], [5.0, 6.0, 7.0]);
    let voxels = truth::voxels([40, 2, 2], rows, |x, y, z| (3 * x + 5 * y + 2 * z) as f32);
    let data = dense(voxels);
    let level = data.level(1).expect("level 1");
    assert_eq!(level.size.to_array(), [20, 2, 1]);
    // The mean of x and of z; y stays, since its spacing is twice the others'.
    let expected = 3.0 * 6.5 + 5.0 + 2.0 * 0.5;
    let index = level.size.index(3, 1, 0);
    assert_eq!(level.channels[0].voxels.value(index), expected);
    assert_eq!(
        level.world_from_voxel.rows(),
        [[2.0, 0.0, 0.0, 5.0], [0.0, 2.0, 0.0, 6.0], [0.0, 0.0, 2.0, 7.0]]
    );
}

#[test]
fn a_sweep_has_each_setting_once_and_says_so_in_words() {
    let base = Setting {
        integrator: "riemann",
        step: 0.5,
        tolerance: None,
        filter: "exact",
        early_stop: 0.0005,
        level_min: 0,
        level_max: Some(0),
        paged: false,
        atlas_mib: 64,
    };
    let axes = Axes {
        swept: Axis::ALL.to_vec(),
        integrators: Integrator::ALL.to_vec(),
        steps: vec![1.0, 0.5, 0.5],
        tolerances: vec![0.01],
        filters: vec![ashfall::scene::Filter::Exact, ashfall::scene::Filter::Hardware],
        early_stops: vec![0.0, 0.01],
        axis_step: 0.5,
        levels: vec![0, 1],
        levels_max: vec![Some(0), None],
        atlas_mibs: vec![4, 64],
    };
    let all = settings(&base, &axes);
    let of = |axis| all.iter().filter(|(of, _)| *of == axis).count();
    let tolerant = Integrator::ALL.iter().filter(|i| i.has_tolerance()).count();
    assert_eq!(of(Axis::Step), 4 * (Integrator::ALL.len() - tolerant) + 2 * tolerant);
    assert_eq!((of(Axis::Filter), of(Axis::EarlyStop)), (1, 1), "the others are in the product");
    assert_eq!((of(Axis::Level), of(Axis::LevelMax), of(Axis::Atlas)), (2, 1, 2));
    let keys: std::collections::BTreeSet<_> = all.iter().map(|(_, s)| s.key()).collect();
    assert_eq!(keys.len(), all.len());
    assert_eq!(base.key(), "riemann, step 0.5, exact filter, early stop 0.0005");
    let level = Setting { level_min: 2, level_max: Some(2), paged: true, ..base.clone() };
    assert!(level.key().ends_with("level 2, paged in 64 MiB") && level.level() == Some(2));
    assert_eq!(base.quality().map(|q| q.step), Ok(0.5));
    for integrator in Integrator::ALL {
        let flags =
            Overrides { integrator: Some(integrator.name().to_owned()), ..Overrides::default() };
        assert_eq!(Quality::of_flags(&flags).expect("its own name").integrator, integrator);
    }
}

/// Watching changes no bit of a picture; the last that is seen is the finished one.
#[test]
fn who_watches_rounds_sees_the_finished_picture_last() {
    let Some(device) = Device::open() else { return };
    let flags = Overrides { refine: Some("substitute".to_owned()), ..Overrides::default() };
    let data = scene_data(SCENE, &flags);
    let paging = PagingSettings { grants_per_round: Some(1), ..PagingSettings::default() };
    let settings = Settings { addressing: Addressing::Paged, paging, ..Settings::default() };
    let plain = device.draw_with(&data, 0, &settings);
    let mut seen: Vec<RoundPicture> = Vec::new();
    let mut renderer = device.renderer(&data, &settings);
    let (picture, statistics) = renderer
        .draw_watched(0, &mut |picture| {
            seen.push(picture);
            std::ops::ControlFlow::Continue(())
        })
        .expect("drawn")
        .expect("not broken off");
    assert!(picture == plain.picture && statistics.converged);
    assert_eq!(statistics.rounds, plain.statistics.rounds);
    let rounds: Vec<u64> = seen.iter().map(|seen| seen.round).collect();
    assert_eq!(rounds, (1..=statistics.rounds).collect::<Vec<_>>());
    assert!(seen.last().is_some_and(|last| last.picture == picture));
    let uploaded: Vec<u64> = seen.iter().map(|seen| seen.bricks_uploaded).collect();
    assert!(uploaded.windows(2).all(|pair| pair[1] - pair[0] <= 1), "{uploaded:?}");
    assert!(seen[0].picture != picture && seen.is_sorted_by(|a, b| a.ms <= b.ms));
    drop(renderer);
    device.finish();
}

#[test]
fn the_reference_takes_a_level() {
    let folder = Folder::new("study-reference");
    let scene = folder.write("scene.toml", SCENE);
    let integrate = |level: &str| {
        let out = folder.path(&format!("{level}.exr"));
        let words = ["--view", "corner", "--level", level, "--error-max", "1e-6", "-o"];
        let mut arguments = vec!["reference".into(), scene.clone().into_os_string()];
        arguments.extend(words.iter().map(Into::into));
        arguments.push(out.clone().into_os_string());
        let run = ashfall(arguments);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        read_exr(&out).expect("a picture")
    };
    let [finest, coarser, beyond] = ["0", "1", "31"].map(integrate);
    assert!(finest != coarser, "levels differ");
    assert!(coarser == beyond, "the coarsest of two levels");
}

const TWO_CASES: [&str; 6] = [
    "study",
    "--suite",
    "stability",
    "--case=looking away",
    "--case=on a face of the box, inwards",
    "--validate",
];

/// A quick part of the suite: a row for each case and integrator, in files and on stdout, all explained.
#[test]
fn a_suite_is_drawn_without_a_scene() {
    let folder = Folder::new("study-suite");
    let out = folder.path("out");
    let files = ["-o", out.to_str().expect("UTF-8")];
    let run = ashfall([&TWO_CASES[..], &["--json"], &files].concat());
    if no_device(&run) {
        return;
    }
    let table = json(&run);
    assert_eq!((&table["suite"], &table["not_holding"]), (&"stability".into(), &0.into()));
    let rows = table["cases"].as_array().expect("cases");
    assert_eq!(rows.len(), 2 * integrators().len(), "{rows:?}");
    for row in rows {
        assert_eq!((&row["theme"], &row["holds"]), (&"cameras".into(), &true.into()), "{row}");
        let figure = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
        assert!(figure("error") <= figure("bound"), "{row}");
        let seen = row["case"] != "looking away";
        assert_eq!(figure("error") > 0.0, seen, "something is seen, and nothing: {row}");
    }
    explained(&table, "## Suites");
    let kept = std::fs::read(out.join("stability.json")).expect("read");
    assert_eq!(serde_json::from_slice::<Value>(&kept).expect("JSON"), table);
    let csv = lines(&out.join("stability.csv"));
    assert_eq!(csv.len(), 1 + rows.len());
    assert!(csv[0].starts_with("theme,case,integrator,error,"), "{csv:?}");
    assert_eq!(out.read_dir().expect("a folder").count(), 2);
}

/// What does not hold is in the table, in a sentence each, and in the exit code.
#[test]
fn a_case_beyond_its_bound_is_a_difference() {
    let flags = ["--bound-factor", "1e-6", "--integrators", "riemann"];
    let run = ashfall([&TWO_CASES[..], &flags].concat());
    if no_device(&run) {
        return;
    }
    assert_eq!(run.code, Some(6), "{}", run.stderr);
    let sentence = run.sentence().expect("one sentence");
    let begins =
        "stability: 1 of 2 do not hold, first: on a face of the box, inwards, riemann: error";
    assert!(sentence.starts_with(begins), "{sentence}");
    let rows: Vec<_> = run.stdout.lines().filter(|line| line.starts_with("cameras ")).collect();
    let ends = |word: &str| rows.iter().filter(|line| line.ends_with(word)).count();
    assert_eq!((rows.len(), ends("NO"), ends("yes")), (2, 1, 1), "{}", run.stdout);
    assert!(run.stdout.contains("what does not hold\n  on a face of the box"), "{}", run.stdout);
}

#[test]
fn a_suite_or_a_scene_is_asked_for() {
    let suite = ["study", "--suite", "stability"];
    for (arguments, words) in [
        (&["study"][..], "--suite stability"),
        (&["study", "-o", "out"], "no SCENE"),
        (&["study", "scene.toml"], "no --output"),
        (&["study", "scene.toml", "--suite", "stability"], "cannot be used with"),
        (&["study", "scene.toml", "-o", "out", "--theme", "fields"], "--theme"),
        (&["study", "-o", "out", "--case", "sheared"], "--suite"),
        (&[&suite[..], &["--steps", "1"]].concat(), "--steps"),
        (&[&suite[..], &["--size", "8x8"]].concat(), "--size"),
        (&[&suite[..], &["--theme", "sounds"]].concat(), "\"fields\", \"transfers\""),
        (&[&suite[..], &["--theme", "fields", "--case", "sheared"]].concat(), "\"linear\""),
        (&[&suite[..], &["--bound-factor", "0"]].concat(), "--bound-factor"),
        (&[&suite[..], &["--bound-factor", "nan"]].concat(), "--bound-factor"),
        (&["study", "--suite", "speed"], "stability"),
    ] {
        let run = ashfall(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{arguments:?}: {}", run.stderr);
        assert_eq!(run.stdout, "", "{arguments:?}");
    }
}
