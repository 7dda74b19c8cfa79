//! `ashfall render --record` and `--replay`, as users meet them.

use serde_json::Value;

use crate::binary::{Run, ashfall};
use crate::folder::Folder;

const SCENE: &str = r#"format = 1
[picture]
size = [48, 40]
[quality]
refine = "substitute"
[[volume]]
name = "shells"
source = { computed = "shells", size = [64, 64, 64] }
spacing = [0.015625, 0.015625, 0.015625]
[[volume.channel]]
window = [0.0, 255.0]
transfer = [
  { at = 0.1, color = [0.2, 0.4, 0.9], extinction = 0.0 },
  { at = 0.6, color = [0.9, 0.6, 0.2], extinction = 6.0 },
]
[[view]]
name = "front"
eye = [0.5, -1.6, 0.7]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 40.0
[[view]]
name = "side"
eye = [2.4, 0.2, 0.9]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 40.0
"#;

fn render(folder: &Folder, more: &[&str]) -> Run {
    let scene = folder.path("scene.toml");
    let picture = folder.path("picture.png");
    let mut all = vec!["render", scene.to_str().expect("UTF-8"), "-o"];
    all.push(picture.to_str().expect("UTF-8"));
    all.extend(["--addressing", "paged", "--free-running", "--atlas-slots", "16"]);
    all.extend(more);
    ashfall(&all)
}

#[test]
fn a_run_is_recorded_and_replayed_by_flags() {
    if crate::common::drawing::Device::open().is_none() {
        return;
    }
    let folder = Folder::new("replay");
    folder.write("scene.toml", SCENE);
    let run = folder.path("run.json");
    let run = run.to_str().expect("UTF-8");
    let recorded = render(&folder, &["--record", run]);
    assert_eq!(recorded.code, Some(0), "{}", recorded.stderr);
    assert!(recorded.stdout.contains("recorded: "), "{}", recorded.stdout);
    let pictures = || {
        ["front", "side"]
            .map(|view| std::fs::read(folder.path(&format!("picture-{view}.png"))).expect("drawn"))
    };
    let first = pictures();
    for more in [&["--loaders", "1"][..], &["--loaders", "5", "--replay-forced"]] {
        let mut flags = vec!["--replay", run, "--json"];
        flags.extend(more);
        let replayed = render(&folder, &flags);
        assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
        let told: Value = serde_json::from_str(&replayed.stdout).expect("JSON");
        let told = &told["replayed"];
        assert_eq!(told["forced"], flags.contains(&"--replay-forced"), "{told}");
        assert_eq!(told["left"], 0, "{told}");
        assert!(told["pictures"].as_u64() > Some(2), "{told}");
        assert_eq!(told["pictures"], told["pictures_same"], "{told}");
        assert_eq!(pictures(), first, "{told}");
    }
    let refused = |flags: &[&str], code: i32, words: &str| {
        let refused = render(&folder, flags);
        assert_eq!(refused.code, Some(code), "{flags:?}: {}", refused.stderr);
        assert!(refused.stderr.contains(words), "{flags:?}: {}", refused.stderr);
        assert_eq!(refused.stderr.trim_end().lines().count(), 1, "{flags:?}: {}", refused.stderr);
    };
    refused(&["--replay", run, "--size", "40x40"], 3, "tiles of [48, 40]");
    refused(&["--replay", run, "--view", "side"], 3, "another scene, or other views");
    refused(&["--replay", run, "--step", "0.25"], 3, "recorded");
    refused(&["--replay", &format!("{run}.none")], 3, "cannot be read");
    let scene = folder.path("scene.toml");
    refused(&["--replay", scene.to_str().expect("UTF-8")], 3, "is no recording");
    refused(&["--record", "/nowhere/run.json"], 4, "make it first");
    let twice = render(&folder, &["--record", run, "--replay", run]);
    assert_eq!(twice.code, Some(2), "{}", twice.stderr);
    // What is drawn directly has no rounds; nothing is left of the file that was asked for.
    let other = folder.path("direct.json");
    let direct = ashfall([
        "render",
        scene.to_str().expect("UTF-8"),
        "-o",
        folder.path("direct.png").to_str().expect("UTF-8"),
        "--refine",
        "exact",
        "--record",
        other.to_str().expect("UTF-8"),
    ]);
    assert_eq!(direct.code, Some(2), "{}", direct.stderr);
    assert!(direct.stderr.contains("--addressing paged"), "{}", direct.stderr);
    let left: Vec<_> = std::fs::read_dir(scene.parent().expect("a folder"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
        .filter(|name| name.starts_with("direct"))
        .collect();
    assert_eq!(left, Vec::<String>::new());
}
