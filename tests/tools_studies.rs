//! `tools/studies`: what it says, the page that it makes of a study, and the page in docs/.

#![cfg(unix)]

mod binary;
mod folder;

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

use binary::Run;
use folder::Folder;
use serde_json::Value;

/// What docs/studies shows.
const SCENES: [&str; 7] = [
    "bonsai",
    "engine",
    "marschner_lobb",
    "stent",
    "dna_2_channels",
    "synth256-sparse",
    "synth256-linear",
];
/// Charts are read in a browser, from a repository that stays small.
const CHART_BYTES_MAX: u64 = 150_000;

const SCENE: &str = r#"format = 1
[picture]
size = [24, 20]
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
"#;

fn studies<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Run {
    let mut command = Command::new("bash");
    command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tools/studies")).args(arguments);
    command.env("ASHFALL_SHARED", "not-there").current_dir(std::env::temp_dir());
    Run::of(command.output().expect("bash runs"))
}

#[test]
fn it_explains_itself() {
    let run = studies(["--help"]);
    assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""));
    for word in ["SCENE", "--docs", "--output", "--binary", "--device", "-- FLAGS", "Ends with 0"] {
        assert!(run.stdout.contains(word), "--help lacks {word}");
    }
}

#[test]
fn it_refuses_in_one_sentence() {
    let refused: [(&[&str], i32, &str); 4] = [
        (&["--docs"], 2, "--docs needs a value"),
        (&["--unknown"], 2, "unknown argument --unknown"),
        (&["not-there.toml"], 3, "not-there.toml: is no file"),
        (&[], 3, "set ASHFALL_SHARED"),
    ];
    for (arguments, code, words) in refused {
        let run = studies(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (Some(code), ""), "{arguments:?}");
        assert!(
            run.stderr.starts_with("studies: ") && run.stderr.contains(words),
            "{}",
            run.stderr
        );
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    }
}

/// Of a small study: every figure that the page shows stands in study.json.
#[test]
fn a_page_says_what_the_study_says() {
    let python = Command::new("python3").arg("--version").output();
    if !python.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: python3 is missing");
        return;
    }
    let folder = Folder::new("studies");
    let scene = folder.write("bump.toml", SCENE);
    let (work, docs) = (folder.path("work"), folder.path("docs"));
    let flags = "--size 24x20 --repeats 1 --steps 1,0.5,0.25 --tolerances 0.1,0.001 --early-stops 0 \
                 --atlas-sizes 1 --streaming-bricks 2";
    let arguments = |scene: &Path| {
        let named = [("--docs", &docs), ("--output", &work)];
        let paths = named.iter().flat_map(|(flag, path)| [flag.as_ref(), path.as_os_str()]);
        let binary = ["--binary", env!("CARGO_BIN_EXE_ashfall"), "--"].map(OsStr::new);
        let all = [scene.as_os_str()].into_iter().chain(paths).chain(binary);
        let flags = flags.split(' ').filter(|flag| !flag.is_empty()).map(OsStr::new);
        all.chain(flags).map(OsStr::to_owned).collect::<Vec<_>>()
    };
    let run = studies(arguments(&scene));
    if run.code == Some(4) && std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        eprintln!("SKIPPED, because ASHFALL_NO_DEVICE is set: {}", run.stderr);
        return;
    }
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let page = std::fs::read_to_string(docs.join("README.md")).expect("a page");
    let found = std::fs::read(work.join("bump/study.json")).expect("a study");
    let study: Value = serde_json::from_slice(&found).expect("JSON");

    for words in ["## bump", "24 x 20", "bump.svg", "bump-streaming.svg"] {
        assert!(page.contains(words), "{words} is missing:\n{page}");
    }
    assert!(page.contains(study["device"].as_str().expect("a name")), "{page}");
    let lines: Vec<&str> = page.lines().collect();
    let line = |parts: &[String]| {
        lines.iter().any(|line| parts.iter().all(|part| line.contains(&format!("| {part} |"))))
    };
    let settings = study["settings"].as_array().expect("settings");
    let mut on_front = 0;
    for row in settings.iter().filter(|row| row["pareto"] == true) {
        on_front += 1;
        let (setting, measured) = (&row["setting"], &row["measured"]);
        let whole = &measured["error"]["whole"];
        let parts = [
            setting["integrator"].as_str().expect("a name").to_owned(),
            format!("{:.2}", measured["samples"].as_f64().expect("a number") * 1e-6),
            format!("{:.1}", whole["psnr_db"].as_f64().expect("a number")),
        ];
        assert!(line(&parts), "{parts:?}:\n{page}");
    }
    let marked = |line: &&&str| line.contains("| front") && !line.contains("cheapest for");
    let marked = lines.iter().filter(marked).count();
    assert_eq!(marked, on_front, "{page}");
    for order in study["orders"].as_array().expect("orders") {
        let Some(seen) = order["observed"]["order"].as_f64() else { continue };
        let name = order["integrator"].as_str().expect("a name").to_owned();
        assert!(line(&[name, format!("{seen:.2}")]), "{order}:\n{page}");
    }
    let rounds = study["streaming"]["rounds"].as_array().expect("rounds");
    let bricks = rounds.last().map(|round| round["bricks_uploaded"].to_string());
    assert!(line(&["converged".to_owned(), bricks.expect("a round")]), "{page}");

    // Nothing is measured again, and the page stays as it is.
    let again = studies(arguments(&scene));
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert_eq!(std::fs::read_to_string(docs.join("README.md")).expect("a page"), page);
}

#[test]
fn the_page_in_docs_has_every_scene_and_stays_small() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/studies");
    let page = std::fs::read_to_string(docs.join("README.md")).expect("docs/studies/README.md");
    let tool = include_str!("../tools/studies");
    for scene in SCENES {
        assert!(page.contains(&format!("\n## {scene}\n")), "{scene} is missing: run tools/studies");
        assert!(tool.contains(&format!("{scene}=")), "tools/studies lacks {scene}");
        for chart in [format!("{scene}.svg"), format!("{scene}-streaming.svg")] {
            assert!(page.contains(&format!("({chart})")), "{chart} is not shown");
            let bytes = docs.join(&chart).metadata().expect("a chart").len();
            assert!(bytes < CHART_BYTES_MAX, "{chart} has {bytes} bytes");
        }
    }
    let others = page.lines().filter_map(|line| line.strip_prefix("## "));
    assert_eq!(others.collect::<Vec<_>>(), SCENES);
}
