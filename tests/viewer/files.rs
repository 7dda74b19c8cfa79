//! What the window writes: pictures, the frames of a path, kept views, a trace; and that panels' changes come back
//! from the saved scene.

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use crate::binary::ashfall;
use crate::desktop::{Desktop, Shot};
use crate::folder::Folder;
use crate::window::{BEGIN, close, has_no_device, read_png, scene_text, view};

const STILL: Duration = Duration::from_millis(1500);
const SIZE: [u32; 2] = [220, 600];
const CONTROL: u32 = 0xffe3;

fn open(desktop: &Desktop, folder: &Folder, scene: &Path) -> (Child, u32) {
    let child = view(scene, &desktop.display, SIZE)
        .current_dir(folder.path(""))
        .args(["--report", "report.json", "--save-as", "saved.toml"])
        .spawn()
        .expect("the binary runs");
    let window = desktop.window("scene.toml");
    desktop.still(STILL);
    desktop.focus(window);
    (child, window)
}

/// `ashfall render` of what the window saved.
fn render(folder: &Folder, output: &str, flags: &[&str]) {
    let (scene, output) = (folder.path("saved.toml"), folder.path(output));
    let fixed = ["render".as_ref(), scene.as_os_str(), "-o".as_ref(), output.as_os_str()];
    let run = ashfall(fixed.into_iter().chain(flags.iter().map(AsRef::as_ref)));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
}

fn wait_for(path: &Path) {
    let begun = Instant::now();
    while !path.exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{} does not come", path.display());
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn pictures_paths_and_traces_are_written() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([600, 640]);
    let folder = Folder::new("files");
    let scene = folder.write("scene.toml", scene_text(BEGIN) + "[path]\nframes = 4\n");
    let (child, window) = open(&desktop, &folder, &scene);
    desktop.move_to([100, 80]);
    // Kept here and from the side; the picture, the path's, and a trace.
    desktop.keys(&[u32::from(b'3')]);
    desktop.still(STILL);
    desktop.keys(&[u32::from(b'b')]);
    desktop.keys(&[CONTROL, u32::from(b'e')]);
    wait_for(&folder.path("scene.png"));
    let shot = desktop.still(STILL);
    desktop.keys(&[CONTROL, u32::from(b't')]);
    wait_for(&folder.path("scene.trace.json"));
    desktop.keys(&[CONTROL, u32::from(b'p')]);
    wait_for(&folder.path("scene-0003.png"));
    desktop.still(STILL);
    desktop.keys(&[CONTROL, u32::from(b's')]);
    wait_for(&folder.path("saved.toml"));
    let report = close(&desktop, window, child, &folder.path("report.json"));

    let exported = read_png(&folder.path("scene.png"));
    assert!(exported == shot.part([0, 0], exported.size) && exported.covered() > 1000);
    let error_db = report["error_db"].as_f64().expect("measured");
    println!("{error_db:.1} dB against the reference");
    assert!((30.0..200.0).contains(&error_db));
    let saved = std::fs::read_to_string(folder.path("saved.toml")).expect("a scene");
    for words in ["\"screen\"", "\"view0\"", "\"kept 1\"", "through = [\"view0\", \"kept 1\"]"] {
        assert!(saved.contains(words), "{words}: {saved}");
    }
    render(&folder, "again.png", &["--path"]);
    for frame in ["0000", "0001", "0002", "0003"] {
        let [window, render] =
            ["scene", "again"].map(|name| read_png(&folder.path(&format!("{name}-{frame}.png"))));
        // The saved views are the window's to some 1e-15.
        let db = window.psnr_db(&render);
        assert!(window == render || db > 60.0, "frame {frame}: {db:.1} dB");
    }
    let trace = std::fs::read_to_string(folder.path("scene.trace.json")).expect("a trace");
    let trace: serde_json::Value = serde_json::from_str(&trace).expect("JSON");
    assert!(trace["traceEvents"].as_array().expect("events").len() > 50);
}

/// Where the curve of the first channel lies in the window: a large rectangle of its own grey.
fn curve(shot: &Shot) -> [u32; 4] {
    let [width, height] = shot.size;
    let grey = |x: u32, y: u32| shot.pixels[(y * width + x) as usize] == [20; 3];
    // Within the margin that histogram and points leave.
    let column = SIZE[0] + 28;
    let rows: Vec<u32> = (0..height).filter(|y| grey(column, *y)).collect();
    let top = *rows.iter().find(|y| (0..60).all(|down| grey(column, *y + down))).expect("a curve");
    let bottom = (top..height).find(|y| !grey(column, *y)).expect("an end");
    let left = (SIZE[0]..width).find(|x| grey(*x, top + 3)).expect("a side");
    let right = (column..width).find(|x| !grey(*x, top + 2)).unwrap_or(width);
    [left, top, right - left, bottom - top]
}

#[test]
fn what_panels_change_comes_back_from_the_saved_scene() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([600, 640]);
    let folder = Folder::new("files");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    let (child, window) = open(&desktop, &folder, &scene);
    let before = desktop.still(STILL);
    let [left, top, width, height] = curve(&before);
    let at = |x: f64, y: f64| {
        [left as i16 + (x * f64::from(width)) as i16, top as i16 + (y * f64::from(height)) as i16]
    };
    // A new point in the middle, and dragged to the left and upwards.
    desktop.click(1, at(0.6, 0.8), 2);
    desktop.still(STILL);
    desktop.drag(1, &[at(0.6, 0.8), at(0.55, 0.5), at(0.5, 0.1)]);
    let edited = desktop.still(STILL);
    let picture = |shot: &Shot| shot.part([0, 0], [SIZE[0], SIZE[1]]);
    assert!(picture(&edited) != picture(&before), "the picture follows the curve");
    desktop.keys(&[CONTROL, u32::from(b's')]);
    wait_for(&folder.path("saved.toml"));
    let shot = desktop.still(STILL);
    close(&desktop, window, child, &folder.path("report.json"));
    let saved = std::fs::read_to_string(folder.path("saved.toml")).expect("a scene");
    assert_eq!(saved.matches("{ at = ").count(), 4, "one point more: {saved}");
    render(&folder, "again.png", &["--view", "screen"]);
    let rendered = read_png(&folder.path("again.png"));
    let db = shot.part([0, 0], rendered.size).psnr_db(&rendered);
    println!("{db:.1} dB");
    assert!(rendered.size == SIZE && db > 60.0, "{db:.1} dB");
}
