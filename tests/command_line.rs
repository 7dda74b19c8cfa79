//! The binary as users meet it: help, exit codes, pictures in and out, JSON; no device is needed.

mod binary;
mod common;
mod folder;

use std::ffi::OsStr;
use std::fs::File;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use ashfall::cli::{read_exr, write_picture};
use ashfall::render::Picture;
use binary::{Run, ashfall};
use folder::Folder;
use serde_json::Value;

const COMMANDS: [&str; 7] = ["render", "plan", "compare", "reference", "devices", "study", "bench"];

const SCENE: &str = r#"format = 1
[picture]
size = [6, 4]
background = [0.25, 0.5, 0.75]
[[volume]]
name = "slab"
source = { computed = "constant", size = [4, 4, 4] }
spacing = [1.0, 1.0, 1.0]
[[volume.channel]]
window = [0.0, 1.0]
transfer = [{ at = 1.0, color = [1.0, 0.5, 0.0], extinction = 0.5 }]
[[view]]
name = "front"
eye = [2.0, 2.0, -8.0]
target = [2.0, 2.0, 2.0]
up = [0.0, 1.0, 0.0]
height = 2.0
[[view]]
name = "side"
eye = [-8.0, 2.0, 2.0]
target = [2.0, 2.0, 2.0]
up = [0.0, 1.0, 0.0]
height = 2.0
"#;

fn picture(width: u32, height: u32, change: f32) -> Picture {
    let pixel = |index: u32| [index as f32 * 0.125, 0.5, -1.0, 1.0];
    let mut pixels: Vec<[f32; 4]> = (0..width * height).map(pixel).collect();
    pixels[0][1] += change;
    Picture { size: [width, height], pixels }
}

/// Writes a.exr, an equal b.exr, c.exr with one component 0.25 off, and d.exr of another size.
fn pictures(name: &str) -> Folder {
    let folder = Folder::new(name);
    for (file, picture) in [
        ("a.exr", picture(4, 3, 0.0)),
        ("b.exr", picture(4, 3, 0.0)),
        ("c.exr", picture(4, 3, 0.25)),
        ("d.exr", picture(3, 4, 0.0)),
    ] {
        write_picture(&folder.path(file), &picture).expect("written");
    }
    folder
}

fn compare(folder: &Folder, a: &str, b: &str, flags: &[&str]) -> Run {
    let mut arguments =
        vec!["compare".into(), folder.path(a).into_os_string(), folder.path(b).into_os_string()];
    arguments.extend(flags.iter().map(|flag| flag.into()));
    ashfall(arguments)
}

/// The one object on stdout, which says its format.
fn json(run: &Run) -> Value {
    let value: Value = serde_json::from_str(&run.stdout)
        .unwrap_or_else(|why| panic!("{why}: {:?} {:?}", run.stdout, run.stderr));
    assert_eq!(value["format"], 1, "{value}");
    value
}

#[test]
fn help_teaches_every_command_and_flag() {
    let all = ashfall(["--help"]);
    assert_eq!((all.code, all.stderr.as_str()), (Some(0), ""));
    for command in COMMANDS {
        assert!(all.stdout.contains(&format!("\n  {command} ")), "{command} in {}", all.stdout);
        let help = ashfall([command, "--help"]);
        assert_eq!((help.code, help.stderr.as_str()), (Some(0), ""), "{command}");
        assert!(help.stdout.contains(&format!("Usage: ashfall {command}")), "{}", help.stdout);
        assert!(help.stdout.lines().all(|line| line.chars().count() <= 100), "{}", help.stdout);
        // Every flag has a word of explanation, on its line or on the next.
        let lines: Vec<&str> = help.stdout.lines().collect();
        for (index, line) in lines.iter().enumerate() {
            let line = line.trim_start();
            if line.starts_with('-') {
                let rest = line.split_once("  ").map_or("", |(_, rest)| rest);
                let next = lines.get(index + 1).map_or("", |next| next.trim());
                let explained = rest.len() > 8 || (next.len() > 8 && !next.starts_with('-'));
                assert!(explained, "{command}: {line}");
            }
        }
    }
    let help = ashfall(["render", "--help"]);
    for key in [
        "size",
        "background",
        "integrator",
        "step",
        "tolerance",
        "filter",
        "refine",
        "level-max",
        "early-stop",
        "atlas-mib",
        "ram-mib",
        "staging-mib",
    ] {
        assert!(help.stdout.contains(&format!("--{key} ")), "every key is a flag: {key}");
    }
    for code in 0..=6 {
        assert!(all.stdout.contains(&format!("{code}: ")), "exit code {code} is told");
    }
}

#[test]
fn version_and_wrong_commands() {
    let version = ashfall(["--version"]);
    assert_eq!(version.code, Some(0));
    assert_eq!(version.stdout.trim(), concat!("ashfall ", env!("CARGO_PKG_VERSION")));
    for arguments in [&[][..], &["paint"], &["render"], &["compare", "a.exr"], &["bench"]] {
        let run = ashfall(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""), "{arguments:?}");
        assert!(run.stderr.contains("Usage"), "{arguments:?}: {}", run.stderr);
    }
}

#[test]
fn equal_pictures_agree_and_others_do_not() {
    let folder = pictures("compare");
    let equal = compare(&folder, "a.exr", "b.exr", &[]);
    assert_eq!((equal.code, equal.stderr.as_str()), (Some(0), ""));
    assert!(equal.stdout.starts_with("PSNR inf dB over 12 pixels"), "{}", equal.stdout);

    // One of 36 components is 0.25 off: 10 log10(36 / 0.0625) = 27.60 dB.
    for (flags, code) in [
        (&[][..], 6),
        (&["--psnr", "27"], 0),
        (&["--psnr", "28"], 6),
        (&["--max-difference", "0.25"], 0),
        (&["--max-difference", "0.2"], 6),
        (&["--psnr", "27", "--max-difference", "0.2"], 6),
        (&["--psnr", "28", "--max-difference", "0.3"], 6),
    ] {
        let run = compare(&folder, "a.exr", "c.exr", flags);
        assert_eq!(run.code, Some(code), "{flags:?}: {}", run.stderr);
        assert!(run.stdout.contains("PSNR 27.60 dB"), "{}", run.stdout);
        if code == 6 {
            let sentence = run.sentence().expect("one sentence");
            assert!(sentence.contains("a.exr") && sentence.contains("c.exr"), "{sentence}");
        }
    }

    let sizes = compare(&folder, "a.exr", "d.exr", &[]);
    let sentence = sizes.sentence().expect("one sentence");
    assert_eq!(sizes.code, Some(6));
    assert!(sentence.contains("4 x 3") && sentence.contains("3 x 4"), "{sentence}");
}

#[test]
fn comparisons_that_cannot_be_made() {
    let folder = pictures("compare-bad");
    folder.write("text.exr", "no picture");
    folder.write("empty.exr", "");
    let whole = std::fs::read(folder.path("a.exr")).expect("read");
    folder.write("cut.exr", &whole[..whole.len() / 2]);
    for bad in ["text.exr", "empty.exr", "cut.exr", "nowhere.exr", "."] {
        for (a, b) in [(bad, "a.exr"), ("a.exr", bad)] {
            let run = compare(&folder, a, b, &[]);
            let sentence = run.sentence().expect("one sentence");
            assert_eq!(run.code, Some(3), "{sentence}");
            assert!(sentence.contains(bad) && sentence.contains("EXR"), "{sentence}");
        }
    }
    for flag in ["--psnr", "--max-difference"] {
        for value in ["high", "nan", "-1"] {
            let run = compare(&folder, "a.exr", "b.exr", &[flag, value]);
            assert_eq!(run.code, Some(2), "{flag} {value}: {}", run.stderr);
            assert!(run.stderr.contains(flag), "{flag} {value}: {}", run.stderr);
        }
    }
}

#[test]
fn comparisons_as_json_and_as_a_picture() {
    let folder = pictures("compare-json");
    let difference = folder.path("difference.exr");
    let equal = json(&compare(&folder, "a.exr", "b.exr", &["--json"]));
    assert_eq!((&equal["agree"], &equal["psnr_db"]), (&Value::Bool(true), &Value::Null));
    let flags = ["--json", "--difference", difference.to_str().expect("a plain path")];
    let run = compare(&folder, "a.exr", "c.exr", &flags);
    let other = json(&run);
    assert_eq!((run.code, &other["agree"]), (Some(6), &Value::Bool(false)));
    assert_eq!((&other["max"], &other["pixels"]), (&Value::from(0.25), &Value::from(12)));
    let psnr = other["psnr_db"].as_f64().expect("a number");
    assert!((psnr - 27.604).abs() < 0.01, "{psnr}");
    let drawn = read_exr(&difference).expect("the difference");
    assert_eq!(drawn.pixels[0], [0.0, 1.0, 0.0, 1.0]);
    assert!(drawn.pixels[1..].iter().all(|pixel| *pixel == [0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn the_reference_writes_pictures_that_compare_reads() {
    let folder = Folder::new("reference");
    let scene = folder.write("scene.toml", SCENE);
    let reference = |output: &Path, more: &[&str]| {
        let mut arguments = vec!["reference".into(), scene.clone().into_os_string(), "-o".into()];
        arguments.push(output.as_os_str().to_owned());
        arguments.extend(more.iter().map(|flag| flag.into()));
        ashfall(arguments)
    };
    let run = reference(&folder.path("one.exr"), &["--view", "front"]);
    assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""));
    assert!(run.stdout.starts_with("front: ") && run.stdout.contains("one.exr"), "{}", run.stdout);
    // Parallel rays through 4 units of extinction 0.5.
    let one = read_exr(&folder.path("one.exr")).expect("written");
    let transmitted = (-2.0f64).exp();
    let truth = [
        1.0 - transmitted + 0.25 * transmitted,
        0.5 * (1.0 - transmitted) + 0.5 * transmitted,
        0.75 * transmitted,
        1.0 - transmitted,
    ];
    assert_eq!(one.size, [6, 4]);
    for (got, truth) in one.pixels.iter().flat_map(|pixel| pixel.iter().zip(truth)) {
        assert!((f64::from(*got) - truth).abs() < 1e-6, "{got} is not {truth}");
    }

    let run = reference(&folder.path("two.exr"), &["--jobs", "1"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let names = ["two-front.exr", "two-side.exr"];
    assert!(names.iter().all(|name| folder.path(name).exists()), "{}", run.stdout);
    assert!(!folder.path("two.exr").exists());
    assert_eq!(compare(&folder, "one.exr", "two-front.exr", &[]).code, Some(0));
    assert_eq!(compare(&folder, "one.exr", "two-side.exr", &["--psnr", "100"]).code, Some(0));

    let run = reference(&folder.path("picture.png"), &["--view", "side", "--size", "3x3"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let png = std::fs::read(folder.path("picture.png")).expect("written");
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));

    for (more, word) in [(["--error-max", "0"], "--error-max"), (["--view", "back"], "--view")] {
        let run = reference(&folder.path("three.exr"), &more);
        assert_eq!(run.code, Some(2), "{}", run.stderr);
        assert!(run.sentence().expect("one sentence").starts_with(word), "{}", run.stderr);
    }
    let leftovers: Vec<_> = std::fs::read_dir(&folder)
        .expect("the folder")
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("partial") || name.contains("three"))
        .collect();
    assert!(leftovers.is_empty(), "{leftovers:?}");
}

#[test]
fn output_that_cannot_be_written() {
    let folder = pictures("outputs");
    let scene = folder.write("scene.toml", SCENE);
    folder.write("file", "");
    for command in ["render", "reference"] {
        let run = |output: &Path| {
            ashfall([command.as_ref(), scene.as_os_str(), "-o".as_ref(), output.as_os_str()])
        };
        for output in ["nowhere/picture.exr", "file/picture.exr"] {
            let run = run(&folder.path(output));
            let sentence = run.sentence().expect("one sentence");
            assert_eq!(run.code, Some(4), "{sentence}");
            assert!(sentence.contains("picture.exr") && sentence.contains("folder"), "{sentence}");
            assert!(sentence.contains("make it first"), "{sentence}");
        }
        for output in ["picture.jpg", "picture", "picture.exr.gz", ".exr"] {
            let run = run(&folder.path(output));
            let sentence = run.sentence().expect("one sentence");
            assert_eq!(run.code, Some(2), "{sentence}");
            assert!(sentence.contains(".png") && sentence.contains(".exr"), "{sentence}");
        }
    }
    // A folder of the picture's name.
    std::fs::create_dir(folder.path("taken.exr")).expect("made");
    let run = ashfall([
        "reference".as_ref(),
        scene.as_os_str(),
        "--view".as_ref(),
        "front".as_ref(),
        "-o".as_ref(),
        folder.path("taken.exr").as_os_str(),
    ]);
    let sentence = run.sentence().expect("one sentence");
    assert_eq!(run.code, Some(4), "{sentence}");
    assert!(sentence.contains("taken.exr"), "{sentence}");
    let flags = ["--difference", "picture.jpg"];
    assert_eq!(compare(&folder, "a.exr", "b.exr", &flags).code, Some(2));
}

fn no_device(run: &Run) {
    let sentence = run.sentence().expect("one sentence");
    assert!(sentence.contains("Vulkan"), "{sentence}");
    common::device::no_device(sentence);
}

/// A machine without Vulkan is refused with a sentence; one with it lists its devices.
#[test]
fn devices_are_listed_or_missed_in_a_sentence() {
    let run = ashfall(["devices", "--json"]);
    match run.code {
        Some(0) => {
            let report = json(&run);
            let devices = report["devices"].as_array().expect("a list");
            assert!(devices.iter().any(|device| device["usable"] == true), "{report}");
            assert!(devices.iter().all(|device| device["name"].is_string()), "{report}");
            let text = ashfall(["devices"]);
            assert_eq!(text.code, Some(0));
            assert!(text.stdout.contains(devices[0]["name"].as_str().expect("a name")));
        }
        Some(4) => no_device(&run),
        code => panic!("exit code {code:?}: {}", run.stderr),
    }
}

/// What a device is asked for only after: a scene that is good ends with a plan, or with 4 where
/// there is no device.
#[test]
fn plans_as_json() {
    let folder = Folder::new("plan");
    let scene = folder.write("scene.toml", SCENE);
    let run = ashfall(["plan".as_ref(), scene.as_os_str(), "--json".as_ref()]);
    match run.code {
        Some(0) => {
            let plan = json(&run);
            assert_eq!(plan["views"], serde_json::json!(["front", "side"]));
            assert!(plan["passes"].as_array().is_some_and(|passes| !passes.is_empty()), "{plan}");
        }
        Some(4) => no_device(&run),
        code => panic!("exit code {code:?}: {}", run.stderr),
    }
    let run = ashfall([
        "plan".as_ref(),
        scene.as_os_str(),
        "--device".as_ref(),
        "no such device".as_ref(),
    ]);
    assert!(matches!(run.code, Some(2 | 4)), "{:?}: {}", run.code, run.stderr);
    assert!(
        run.sentence().expect("one sentence").contains("no such device") || run.code == Some(4)
    );
}

/// What a device offers draws the same bytes; what it does not is refused with what it does.
#[test]
fn queue_topologies_are_drawn_with_or_refused() {
    let folder = Folder::new("queues");
    // Bricks of one value would not travel.
    let source = r#"computed = "marschner-lobb", size = [40, 40, 40]"#;
    let text = SCENE.replace(r#"computed = "constant", size = [4, 4, 4]"#, source);
    let scene = folder.write("scene.toml", text.replace("[2.0, 2.0,", "[20.0, 20.0,"));
    let render = |topology: &str| {
        let picture = folder.path(&format!("{topology}.exr"));
        let stats = folder.path("stats.json");
        let flags = ["--view", "front", "--addressing", "paged", "--free-running", "--queues"];
        let mut arguments = vec![OsStr::new("render"), scene.as_os_str()];
        arguments.extend(flags.iter().map(OsStr::new));
        arguments.extend([OsStr::new(topology), OsStr::new("-o"), picture.as_os_str()]);
        arguments.extend([OsStr::new("--stats"), stats.as_os_str()]);
        ashfall(arguments)
    };
    assert_eq!(render("three-queues").code, Some(2));
    let auto = render("auto");
    if auto.code == Some(4) {
        return no_device(&auto);
    }
    assert_eq!(auto.code, Some(0), "{}", auto.stderr);
    let stats = std::fs::read_to_string(folder.path("stats.json")).expect("written");
    let stats: Value = serde_json::from_str(&stats).expect("JSON");
    assert!(stats["bytes_uploaded"].as_u64() > Some(0), "nothing was copied: {stats}");
    let report = json(&ashfall(["devices", "--json"]));
    let devices = report["devices"].as_array().expect("a list");
    let lists = devices.iter().map(|device| device["topologies"].as_array().expect("a list"));
    let lists: Vec<Vec<&str>> =
        lists.map(|list| list.iter().filter_map(Value::as_str).collect()).collect();
    assert!(lists.iter().any(|list| list.contains(&"one-queue")), "{report}");
    for topology in ["one-queue", "two-queues", "transfer-family", "ownership"] {
        let run = render(topology);
        if run.code == Some(0) {
            assert!(lists.iter().any(|list| list.contains(&topology)), "{topology}: {report}");
            let of = |name: &str| std::fs::read(folder.path(&format!("{name}.exr"))).expect("read");
            assert!(of(topology) == of("auto"), "{topology} draws other bytes");
        } else {
            let sentence = run.sentence().expect("one sentence");
            assert_eq!(run.code, Some(4), "{sentence}");
            assert!(sentence.contains(&format!("--queues {topology}")), "{sentence}");
            assert!(sentence.contains("it offers one-queue"), "{sentence}");
            assert!(lists.iter().any(|list| !list.contains(&topology)), "{topology}: {report}");
        }
    }
}

#[test]
fn exr_pictures_come_back_bit_by_bit() {
    let folder = Folder::new("exr");
    let mut picture = picture(5, 2, 0.0);
    picture.pixels[3] = [1e-40, f32::MAX, -0.0, f32::INFINITY];
    picture.pixels[4][0] = f32::NAN;
    write_picture(&folder.path("a.exr"), &picture).expect("written");
    let again = read_exr(&folder.path("a.exr")).expect("read");
    let bits = |picture: &Picture| -> Vec<[u32; 4]> {
        picture.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    };
    assert_eq!((again.size, bits(&again)), (picture.size, bits(&picture)));
}

/// A store and a raw file need no scene: the whole volume is drawn.
#[test]
fn files_without_a_scene() {
    let folder = Folder::new("bare");
    let raw = folder.path("cube.raw");
    std::fs::write(&raw, [0u8, 50, 100, 150, 200, 250, 10, 60]).expect("a raw file");
    let store = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/version_1_u8.bricks");
    let flags: &[&str] = &["--raw-size", "2x2x2", "--raw-type", "u8", "--spacing", "1,1,2"];
    for (file, flags) in [(&store, &[][..]), (&raw, flags)] {
        let mut arguments = vec!["plan".as_ref(), file.as_os_str(), "--json".as_ref()];
        arguments.extend(flags.iter().map(OsStr::new));
        let run = ashfall(arguments);
        match run.code {
            Some(0) => assert_eq!(json(&run)["views"], serde_json::json!(["whole"])),
            Some(4) => no_device(&run),
            code => panic!("exit code {code:?}: {}", run.stderr),
        }
    }
    let run = ashfall(["plan".as_ref(), raw.as_os_str()]);
    assert_eq!(run.code, Some(3), "a raw file does not say its size: {}", run.stderr);
    let short = ["--raw-size", "2x2x3", "--raw-type", "u8"].map(OsStr::new);
    let run = ashfall(["plan".as_ref(), raw.as_os_str()].into_iter().chain(short));
    assert_eq!(run.code, Some(3), "{}", run.stderr);
    assert!(run.stderr.contains("cube.raw") && run.stderr.contains('8'), "{}", run.stderr);
}

/// A reader that has gone away ends no command with a panic.
#[test]
fn results_that_nobody_reads() {
    let store = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/version_1_u8.bricks");
    for command in ["info", "verify"] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_ashfall"))
            .args([command.as_ref(), store.as_os_str()])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        // Closed at once: the pipe is broken before or while the command writes.
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("the program ends");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{command}: {said}");
    }
}

/// Runs with its output going to files that the caller opened.
fn ashfall_into<S: AsRef<OsStr>>(
    stdout: impl Into<Stdio>,
    stderr: impl Into<Stdio>,
    arguments: &[S],
) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.args(arguments).stdout(stdout).stderr(stderr);
    command.spawn().and_then(|child| child.wait_with_output()).expect("the program runs")
}

/// Takes nothing, as a file on a full disk.
fn full() -> File {
    File::options().write(true).open("/dev/full").expect("a device that is full")
}

/// Results that nobody can read later are not done: a sentence and exit code 4, from every command.
#[test]
fn results_that_find_no_room() {
    let folder = pictures("full");
    let scene = folder.write("scene.toml", SCENE);
    let store = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/version_1_u8.bricks");
    let [a, c] = ["a.exr", "c.exr"].map(|name| folder.path(name));
    let (drawn, imported) = (folder.path("drawn.exr"), folder.path("imported.bricks"));
    let cube = folder.write("cube.raw", [0u8, 50, 100, 150, 200, 250, 10, 60]);
    let word = |word: &'static str| OsStr::new(word);
    let runs: [Vec<&OsStr>; 15] = [
        vec![word("--help")],
        vec![word("--version")],
        vec![word("bench"), word("upload"), word("--help")],
        vec![word("info"), store.as_os_str()],
        vec![word("info"), store.as_os_str(), word("--json")],
        vec![word("info"), cube.as_os_str(), word("--raw-size=2x2x2"), word("--raw-type=u8")],
        vec![word("verify"), store.as_os_str()],
        vec![word("verify"), store.as_os_str(), word("--json")],
        vec![word("compare"), a.as_os_str(), a.as_os_str()],
        // Where the verdict is lost too, what the machine lacks comes first.
        vec![word("compare"), a.as_os_str(), c.as_os_str(), word("--json")],
        vec![word("reference"), scene.as_os_str(), word("-o"), drawn.as_os_str()],
        vec![
            word("import"),
            cube.as_os_str(),
            word("-o"),
            imported.as_os_str(),
            word("--raw-size=2x2x2"),
            word("--raw-type=u8"),
        ],
        vec![word("plan"), scene.as_os_str()],
        vec![word("devices")],
        vec![word("render"), scene.as_os_str(), word("-o"), drawn.as_os_str()],
    ];
    for arguments in runs {
        let run = Run::of(ashfall_into(full(), Stdio::piped(), &arguments));
        assert_eq!(run.code, Some(4), "{arguments:?}: {}", run.stderr);
        let sentence = run.sentence().expect("one sentence");
        if sentence.contains("Vulkan") {
            no_device(&run);
            continue;
        }
        assert!(sentence.starts_with("standard output: "), "{arguments:?}: {sentence}");
        assert!(sentence.contains("No space left") && sentence.contains("elsewhere"), "{sentence}");
    }
}

/// Where stderr takes nothing, the exit code still tells.
#[test]
fn remarks_that_find_no_room() {
    for (arguments, code) in [(["info", "nowhere.nrrd"], 3), (["paint", "nowhere.nrrd"], 2)] {
        let output = ashfall_into(Stdio::null(), full(), &arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
    }
}
