//! The real window, moved by a real hand, against what `render` makes of the same state.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::binary::{Run, ashfall};
use crate::desktop::{Desktop, Shot};
use crate::folder::Folder;

/// What a picture on the screen has at least beside `render`'s, dB.
const DB_MIN: f64 = 45.0;
const SIZE: [u32; 2] = [220, 160];

/// A computed volume, seen from here.
pub fn scene_text([eye, target, up]: [[f64; 3]; 3]) -> String {
    format!(
        "format = 1\n\
         [picture]\nbackground = [0.02, 0.03, 0.05]\n\
         [[volume]]\nname = \"shells\"\nsource = {{ computed = \"shells\", size = [96, 96, 96] }}\n\
         spacing = [0.01, 0.01, 0.01]\n\
         [[volume.channel]]\nwindow = [0.0, 1.0]\ntransfer = [\n\
         {{ at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 }},\n\
         {{ at = 0.3, color = [0.2, 0.7, 0.4], extinction = 2.0 }},\n\
         {{ at = 1.0, color = [1.0, 0.8, 0.3], extinction = 12.0 }},\n]\n\
         [[view]]\neye = {eye:?}\ntarget = {target:?}\nup = {up:?}\nfov_degrees = 40.0\n"
    )
}

pub const BEGIN: [[f64; 3]; 3] = [[1.9, -1.2, 1.3], [0.48, 0.48, 0.48], [0.0, 0.0, 1.0]];

/// `ashfall view` of a scene on a desktop.
struct View<'d> {
    desktop: &'d Desktop,
    window: u32,
    child: Child,
    report: PathBuf,
}

struct Closed {
    report: serde_json::Value,
}

impl<'d> View<'d> {
    fn open(desktop: &'d Desktop, folder: &Folder) -> View<'d> {
        let scene = folder.write("scene.toml", scene_text(BEGIN));
        let report = folder.path("report.json");
        let child = view(&scene, &desktop.display, SIZE)
            .arg("--report")
            .arg(&report)
            .arg("--save-as")
            .arg(folder.path("saved.toml"))
            .spawn()
            .expect("the binary runs");
        let window = desktop.window("scene.toml");
        View { desktop, window, child, report }
    }

    fn close(self) -> Closed {
        Closed { report: close(self.desktop, self.window, self.child, &self.report) }
    }
}

/// Closes a window as its button does; what it reported: finished, and without a message of the layers.
pub fn close(desktop: &Desktop, window: u32, child: Child, report: &Path) -> serde_json::Value {
    desktop.close(window);
    let run = Run::of(child.wait_with_output().expect("an end"));
    // The window system's libraries may say something of their own.
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let text = std::fs::read_to_string(report).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["validation_messages"], 0);
    assert_eq!(report["converged"], true, "{report:#}");
    report
}

pub fn view(scene: &Path, display: &str, size: [u32; 2]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.current_dir(std::env::temp_dir());
    command.env("DISPLAY", display).env_remove("WAYLAND_DISPLAY");
    command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    command.arg("view").arg(scene).arg("--validate");
    command.args(["--size", &format!("{}x{}", size[0], size[1])]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

pub fn has_no_device() -> bool {
    std::env::var_os("ASHFALL_NO_DEVICE").is_some()
}

impl Closed {
    fn camera(&self) -> [[f64; 3]; 3] {
        let triple = |of: &serde_json::Value| -> [f64; 3] {
            serde_json::from_value(of.clone()).expect("three numbers")
        };
        [&self.report["eye"], &self.report["target"], &self.report["up"]].map(triple)
    }

    /// Where the picture lay: origin and size.
    fn area(&self) -> [[u32; 2]; 2] {
        [&self.report["picture_origin"], &self.report["picture_size"]]
            .map(|of| serde_json::from_value(of.clone()).expect("two numbers"))
    }

    /// What was on the screen is what `render` makes of the camera and size at the end.
    fn assert_showed(&self, shot: &Shot, folder: &Folder) {
        let scene = folder.write("rendered.toml", scene_text(self.camera()));
        self.assert_is(shot, &scene, &[], folder);
    }

    fn assert_is(&self, shot: &Shot, scene: &Path, flags: &[&str], folder: &Folder) {
        let picture = folder.path("rendered.png");
        let [origin, size] = self.area();
        let pixels = format!("{}x{}", size[0], size[1]);
        let fixed = ["--size".as_ref(), pixels.as_ref(), "-o".as_ref(), picture.as_os_str()];
        let arguments = ["render".as_ref(), scene.as_os_str()];
        let run =
            ashfall(arguments.into_iter().chain(fixed).chain(flags.iter().map(AsRef::as_ref)));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let rendered = read_png(&picture);
        let db = shot.part(origin, size).psnr_db(&rendered);
        println!("{db:.1} dB between the screen and render, {size:?}");
        assert!(rendered.covered() > 1000 && db >= DB_MIN, "{db:.1} dB, {size:?}");
    }
}

pub fn read_png(path: &Path) -> Shot {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("a picture"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("pixels");
    let pixels = bytes.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
    Shot { size: [info.width, info.height], pixels }
}

const STILL: Duration = Duration::from_millis(1500);

#[test]
fn what_is_on_the_screen_is_what_render_draws() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([700, 400]);
    let folder = Folder::new("view");
    let view = View::open(&desktop, &folder);
    let first = desktop.still(STILL);
    let closed = view.close();
    closed.assert_showed(&first, &folder);
    assert_eq!(closed.camera()[0], BEGIN[0], "nobody moved it");
    assert_eq!(closed.area()[1], SIZE);

    // Turned, moved, nearer, and by a key.
    let view = View::open(&desktop, &folder);
    desktop.still(STILL);
    desktop.focus(view.window);
    desktop.drag(1, &[[60, 60], [90, 70], [130, 90], [150, 100]]);
    let turned = desktop.still(STILL);
    assert!(turned != first, "the picture turned");
    desktop.drag(3, &[[60, 60], [70, 70], [80, 75]]);
    // The wheel, as a button.
    desktop.drag(4, &[[100, 80]]);
    desktop.drag(4, &[[100, 80]]);
    let moved = desktop.still(STILL);
    assert!(moved.psnr_db(&turned) < 40.0, "the picture moved");
    // Saved as it is seen; picture size and all.
    const CONTROL: u32 = 0xffe3;
    desktop.keys(&[CONTROL, u32::from(b's')]);
    desktop.still(STILL);
    let closed = view.close();
    closed.assert_showed(&moved, &folder);
    closed.assert_is(&moved, &folder.path("saved.toml"), &["--view", "screen"], &folder);
    let waits = closed.report["input_ms"].as_array().expect("a list").len();
    assert!(waits >= 2, "{:#}", closed.report);
    assert!(closed.camera()[0] != BEGIN[0]);

    // Along an axis, and back: the same picture as at first.
    let view = View::open(&desktop, &folder);
    desktop.still(STILL);
    desktop.focus(view.window);
    desktop.move_to([100, 80]);
    desktop.keys(&[u32::from(b'5')]);
    let top = desktop.still(STILL);
    assert!(top != first, "from the top");
    desktop.keys(&[u32::from(b'r')]);
    desktop.still(STILL);
    let closed = view.close();
    assert_eq!(closed.camera()[0], BEGIN[0], "back at home");
}

/// Ten seconds at rest: no submit, no frame.
#[test]
fn at_rest_the_device_rests() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([700, 400]);
    let folder = Folder::new("view");
    let view = View::open(&desktop, &folder);
    desktop.still(STILL);
    std::thread::sleep(Duration::from_secs(10));
    let closed = view.close();
    let idle_s = closed.report["idle_s"].as_f64().expect("seconds");
    println!("idle for {idle_s:.1} s, first picture {} ms", closed.report["first_picture_ms"]);
    assert!(idle_s >= 10.0, "{:#}", closed.report);
    assert_eq!(closed.report["idle_submits"], 0, "{:#}", closed.report);
}

#[test]
fn a_storm_of_sizes_ends_with_the_last_one() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([900, 500]);
    let folder = Folder::new("view");
    let view = View::open(&desktop, &folder);
    desktop.still(STILL);
    for turn in 0..40u32 {
        desktop.resize(view.window, [380 + turn * 37 % 400, 70 + turn * 53 % 350]);
        std::thread::sleep(Duration::from_millis(u64::from(turn % 5) * 15));
        if turn % 13 == 5 {
            desktop.unmap(view.window);
            std::thread::sleep(Duration::from_millis(150));
            desktop.map(view.window);
        }
    }
    desktop.resize(view.window, [560, 300]);
    let shot = desktop.still(STILL);
    let closed = view.close();
    assert_eq!(closed.area()[1][1], 300, "{:#}", closed.report);
    closed.assert_showed(&shot, &folder);
}

#[test]
fn closing_while_it_loads() {
    if has_no_device() {
        return;
    }
    let desktop = Desktop::start([700, 400]);
    let folder = Folder::new("view");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    for wait_ms in [0, 60, 250, 600] {
        let child = view(&scene, &desktop.display, SIZE).spawn().expect("the binary runs");
        let window = desktop.window("scene.toml");
        std::thread::sleep(Duration::from_millis(wait_ms));
        desktop.close(window);
        let run = Run::of(child.wait_with_output().expect("an end"));
        assert_eq!(run.code, Some(0), "after {wait_ms} ms: {}", run.stderr);
    }
}

#[test]
fn no_display_is_told_in_a_sentence() {
    if has_no_device() {
        return;
    }
    let folder = Folder::new("view");
    let scene = folder.write("scene.toml", scene_text(BEGIN));
    for display in ["", ":9999"] {
        let mut command = view(&scene, display, SIZE);
        if display.is_empty() {
            command.env_remove("DISPLAY");
        }
        let run = Run::of(command.output().expect("the binary runs"));
        assert_eq!(run.code, Some(4), "{}", run.stderr);
        let last = run.stderr.lines().last().unwrap_or_default();
        assert!(last.starts_with("ashfall: ") && last.contains("`ashfall render`"), "{last}");
        assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
    }
}

/// Plays a path of 120 frames in a window; what it reports, in a line.
fn played(desktop: &Desktop, folder: &Folder, scene: &Path, flags: &[&str]) -> String {
    let report = folder.path("report.json");
    let child = view(scene, &desktop.display, [640, 480])
        .args(flags)
        .arg("--report")
        .arg(&report)
        .spawn()
        .expect("the binary runs");
    let window = desktop.window("scene.toml");
    desktop.still(STILL);
    desktop.focus(window);
    desktop.keys(&[u32::from(b'p')]);
    std::thread::sleep(Duration::from_secs(5));
    desktop.still(STILL);
    let report = close(desktop, window, child, &report);
    let mut waits: Vec<f64> = serde_json::from_value(report["input_ms"].clone()).expect("numbers");
    waits.sort_by(f64::total_cmp);
    format!(
        "{} frames, {} pictures, a frame {}, a round while it moves {} ms (median, p95, p99, worst), {:.2} of them over the target, step to picture {:.0} ms (median of {})",
        report["frames"],
        report["pictures"],
        report["frame_ms"],
        report["moving_ms"],
        report["moving_over_target"].as_f64().unwrap_or(1.0),
        waits[waits.len() / 2],
        waits.len()
    )
}

/// Frames of a path played in the window: with panels and without, and with targets for a round's time.
#[test]
#[ignore = "three minutes: what panels cost and targets give, for docs/MEASUREMENTS.md"]
fn what_a_window_costs() {
    let desktop = Desktop::start([1100, 700]);
    let folder = Folder::new("view");
    let [_, target, up] = BEGIN;
    let more = format!(
        "[[view]]\nname = \"side\"\neye = [-0.9, -1.2, 1.3]\ntarget = {target:?}\nup = {up:?}\nfov_degrees = 40.0\n"
    );
    let scene = folder.write("scene.toml", scene_text(BEGIN) + &more);
    for turn in 0..3 {
        for panels in ["none", "some", "all"] {
            let line = played(&desktop, &folder, &scene, &["--panels", panels]);
            println!("turn {turn}, panels {panels}: {line}");
        }
        for target in ["1e9", "120", "60", "30"] {
            let line = played(&desktop, &folder, &scene, &["--frame-ms", target]);
            println!("turn {turn}, target {target} ms: {line}");
        }
    }
}
