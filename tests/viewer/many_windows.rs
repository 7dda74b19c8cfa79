//! Several windows: two eyes, and the screens of a wall, each against what `render` makes of it.

use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

use crate::binary::ashfall;
use crate::desktop::{Desktop, Shot};
use crate::folder::Folder;
use crate::window::{BEGIN, close, has_no_device, read_png, scene_text, view};

const STILL: Duration = Duration::from_millis(1500);

/// `ashfall view` in a folder, with flags.
fn open(desktop: &Desktop, folder: &Folder, scene: &Path, size: [u32; 2], flags: &[&str]) -> Child {
    view(scene, &desktop.display, size)
        .current_dir(folder.path(""))
        .args(["--report", "report.json", "--panels", "none"])
        .args(flags)
        .spawn()
        .expect("the binary runs")
}

/// Closes the window, which had come to rest; what it wrote of itself.
fn close_at_rest(
    desktop: &Desktop,
    folder: &Folder,
    child: Child,
    window: u32,
) -> serde_json::Value {
    let report = close(desktop, window, child, &folder.path("report.json"));
    assert_eq!(report["idle_submits"], 0, "{report:#}");
    report
}

/// `ashfall render` into a PNG of this name; the names of all that it wrote.
fn render(folder: &Folder, scene: &Path, name: &str, flags: &[&str]) -> Vec<PathBuf> {
    let output = folder.path(name);
    let fixed = ["render".as_ref(), scene.as_os_str(), "-o".as_ref(), output.as_os_str()];
    let flags = flags.iter().chain(&["--json"]).map(AsRef::as_ref);
    let run = ashfall(fixed.into_iter().chain(flags));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let results: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    let views = results["views"].as_array().expect("views");
    let file = |view: &serde_json::Value| view["files"][0].as_str().expect("a file").into();
    views.iter().map(file).collect()
}

fn assert_same(shot: &Shot, origin: [u32; 2], rendered: &Path, what: &str) {
    let rendered = read_png(rendered);
    assert!(rendered.covered() > 500, "{what}");
    let part = shot.part(origin, rendered.size);
    assert!(part == rendered, "{what}: {:.1} dB", part.psnr_db(&rendered));
}

#[test]
fn two_eyes_in_one_window_and_in_two() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([700, 400]);
    let folder = Folder::new("eyes");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    let eyes = ["--eye-separation", "0.2", "--screen-distance", "2"];
    let flags = |how: &'static str| [&["--stereo", how][..], &eyes].concat();

    let child = open(&desktop, &folder, &scene, [200, 150], &flags("pair"));
    let first = desktop.window("scene.toml");
    desktop.place(desktop.window("right eye"), [300, 100]);
    let shot = desktop.still(STILL);
    close_at_rest(&desktop, &folder, child, first);
    let files =
        render(&folder, &scene, "pair.png", &[&flags("pair")[..], &["--size", "200x150"]].concat());
    assert_same(&shot, [0, 0], &files[0], "the left eye");
    assert_same(&shot, [300, 100], &files[1], "the right eye");

    // Side by side, and turned by a hand.
    let child = open(&desktop, &folder, &scene, [300, 150], &flags("side-by-side"));
    let first = desktop.window("scene.toml");
    let shot = desktop.still(STILL);
    desktop.focus(first);
    desktop.drag(1, &[[60, 60], [90, 70], [130, 90]]);
    let turned = desktop.still(STILL);
    assert!(turned != shot);
    close_at_rest(&desktop, &folder, child, first);
    let files = render(
        &folder,
        &scene,
        "wide.png",
        &[&flags("side-by-side")[..], &["--size", "150x150"]].concat(),
    );
    assert_same(&shot, [0, 0], &files[0], "both eyes");
}

/// Four screens on the desktop, one of them hung upside down, make up the picture of one; a hand in one of them
/// turns all.
#[test]
fn a_wall_is_one_picture_in_four_windows() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([900, 400]);
    let folder = Folder::new("wall");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    // Perspective of 40 degrees in a picture of 240 by 160, from the right of the desktop's middle on.
    let top = 20.0f64.to_radians().tan();
    let place = |x: u32, y: u32| {
        let [x, y] = [f64::from(x) / 120.0 - 1.0, 1.0 - f64::from(y) / 80.0];
        format!("[{:?}, {:?}, -1.0]", 1.5 * top * x, top * y)
    };
    let mut text = "format = 1\nunits = \"metres\"\neye = [0.0, 0.0, 0.0]\n".to_owned();
    for (name, [x, y], rotation) in
        [("a", [0, 0], 0), ("b", [120, 0], 0), ("c", [0, 80], 180), ("d", [120, 80], 0)]
    {
        let corners = [place(x, y), place(x + 120, y), place(x, y + 80)].join(", ");
        text += &format!(
            "[[screen]]\nname = \"screen {name}\"\nsize = [120, 80]\ncorners = [{corners}]\nrotation = {rotation}\nwindow = [{}, {}]\n",
            600 + x,
            100 + y
        );
    }
    let wall = folder.write("wall.toml", text);
    let flags = ["--wall", wall.to_str().expect("UTF-8")];
    let child = open(&desktop, &folder, &scene, [200, 150], &flags);
    let first = desktop.window("scene.toml");
    for name in ["screen a", "screen b", "screen c", "screen d"] {
        desktop.window(name);
    }
    let shot = desktop.still(STILL);
    let whole = render(&folder, &scene, "whole.png", &["--size", "240x160"]);
    let whole = read_png(&whole[0]);
    for (what, [x, y]) in [("a", [0, 0]), ("b", [120, 0]), ("c", [0, 80]), ("d", [120, 80])] {
        let mut seen = shot.part([600 + x, 100 + y], [120, 80]);
        if what == "c" {
            seen.pixels.reverse();
        }
        assert!(seen == whole.part([x, y], [120, 80]), "screen {what}");
    }
    // A hand in the window of one screen.
    desktop.drag(1, &[[640, 130], [660, 135], [680, 140]]);
    let turned = desktop.still(STILL);
    for [x, y] in [[0, 0], [120, 0], [0, 80], [120, 80]] {
        let [before, after] = [&shot, &turned].map(|shot| shot.part([600 + x, 100 + y], [120, 80]));
        assert!(before != after, "{x}, {y}");
    }
    close_at_rest(&desktop, &folder, child, first);
}

/// On a desktop with many pixels to an inch: panels twice as large, and the picture pixel by pixel all the same.
#[test]
fn panels_are_scaled_and_pictures_are_not() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([1000, 400]);
    let folder = Folder::new("scale");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    let child = view(&scene, &desktop.display, [220, 160])
        .current_dir(folder.path(""))
        .env("WINIT_X11_SCALE_FACTOR", "2")
        .args(["--report", "report.json"])
        .spawn()
        .expect("the binary runs");
    let window = desktop.window("scene.toml");
    let shot = desktop.still(STILL);
    let report = close_at_rest(&desktop, &folder, child, window);
    assert_eq!(report["picture_size"], serde_json::json!([220, 160]));
    let files = render(&folder, &scene, "picture.png", &["--size", "220x160"]);
    assert_same(&shot, [0, 0], &files[0], "the picture");
    // 300 points are 600 pixels of panels.
    assert!(shot.part([220, 0], [600, 160]).covered() > 90_000);
    assert_eq!(shot.part([821, 0], [100, 160]).covered(), 0);
}
