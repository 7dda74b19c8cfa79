//! The built program on bad days: killed, interrupted, no room, no permission, no input.

mod folder;
mod random;
mod support;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use ashfall::store::{Store, verify};
use folder::Folder;
use random::Random;

fn ashfall(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A raw u8 file of edge^3 noisy voxels.
fn raw_file(folder: &Folder, edge: usize) -> PathBuf {
    let path = folder.path("noise.raw");
    let mut random = Random(4);
    let bytes: Vec<u8> =
        (0..edge * edge * edge).map(|i| (i / 4096) as u8 ^ (random.next() & 3) as u8).collect();
    File::create(&path).unwrap().write_all(&bytes).unwrap();
    path
}

fn import(input: &Path, output: &Path, edge: usize) -> Command {
    let size = format!("{edge}x{edge}x{edge}");
    let [input, output] = [input, output].map(|path| path.to_str().unwrap());
    ashfall(&[
        "import",
        input,
        "-o",
        output,
        "--raw-size",
        &size,
        "--raw-type",
        "u8",
        "--jobs",
        "2",
    ])
}

fn text(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn is_whole(path: &Path) -> bool {
    verify(path, &|_, _| {}).is_ok_and(|report| report.damaged_bricks == 0)
}

#[test]
fn a_killed_import_leaves_no_store_or_a_whole_one() {
    let kills = if std::env::var_os("ASHFALL_LONG").is_some() { 200 } else { 20 };
    let folder = Folder::in_memory();
    let edge = 160;
    let input = raw_file(&folder, edge);
    let output = folder.path("out.bricks");
    let start = Instant::now();
    assert!(import(&input, &output, edge).status().unwrap().success());
    let whole_us = start.elapsed().as_micros() as u64;
    let first = std::fs::read(&output).unwrap();
    let mut random = Random(8);
    let (mut none, mut whole) = (0, 0);
    for kill in 0..kills {
        // Half of the kills hit a replacement of an older store, which must stay until it is replaced.
        let replacing = kill % 2 == 0;
        if !replacing {
            let _ = std::fs::remove_file(&output);
        }
        let mut child = import(&input, &output, edge).spawn().unwrap();
        std::thread::sleep(Duration::from_micros(random.below(whole_us * 5 / 4)));
        let _ = child.kill();
        let ended = child.wait().unwrap();
        if output.exists() {
            assert!(is_whole(&output), "kill {kill} left part of a store");
            assert_eq!(std::fs::read(&output).unwrap(), first);
            whole += 1;
        } else {
            assert!(!replacing, "kill {kill} took the old store away");
            assert!(!ended.success());
            none += 1;
        }
        std::fs::write(&output, &first).unwrap();
    }
    assert!(
        whole > 0 && none > 0,
        "{none} times none, {whole} times whole: kills all come too late or early"
    );
}

#[test]
fn an_interrupted_import_leaves_nothing() {
    let folder = Folder::in_memory();
    let edge = 320;
    let input = raw_file(&folder, edge);
    let output = folder.path("out.bricks");
    for signal in ["-INT", "-TERM"] {
        let mut child = import(&input, &output, edge).spawn().unwrap();
        while folder.names().len() < 2 {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it began to write");
            std::thread::sleep(Duration::from_millis(1));
        }
        let pid = child.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
        let status = child.wait().unwrap();
        assert!(!status.success());
        assert_eq!(folder.names(), ["noise.raw"], "after {signal}");
    }
}

#[test]
fn a_full_disk_is_a_sentence_and_leaves_nothing() {
    let folder = Folder::in_memory();
    let small = folder.path("small");
    std::fs::create_dir(&small).unwrap();
    let mount = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=1m", "tmpfs"])
        .arg(&small)
        .stderr(Stdio::null())
        .status();
    if !mount.is_ok_and(|status| status.success()) {
        eprintln!("SKIPPED: this machine lets no test mount a small tmpfs, so no disk gets full");
        return;
    }
    struct Mounted(PathBuf);
    impl Drop for Mounted {
        fn drop(&mut self) {
            let _ = Command::new("umount").arg(&self.0).status();
        }
    }
    let mounted = Mounted(small);
    let input = raw_file(&folder, 160);
    let done = import(&input, &mounted.0.join("out.bricks"), 160).output().unwrap();
    assert_eq!(done.status.code(), Some(4), "{}", text(&done));
    assert!(text(&done).contains("free some space"), "{}", text(&done));
    assert_eq!(text(&done).lines().count(), 1);
    assert_eq!(std::fs::read_dir(&mounted.0).unwrap().count(), 0, "debris");
    // Slices that go to disk meet it too.
    let done = import(&input, &mounted.0.join("out.bricks"), 160)
        .args(["--ram-mib", "1"])
        .output()
        .unwrap();
    assert_eq!(done.status.code(), Some(4), "{}", text(&done));
    assert_eq!(std::fs::read_dir(&mounted.0).unwrap().count(), 0, "debris");
}

#[test]
fn places_that_cannot_be_written_are_a_sentence() {
    let folder = Folder::in_memory();
    let input = raw_file(&folder, 8);
    let missing = folder.path("no/such/folder/out.bricks");
    // procfs takes no file, not even from root, who may write wherever permissions forbid it.
    for output in [missing, PathBuf::from("/proc/out.bricks"), folder.as_ref().to_owned()] {
        let done = import(&input, &output, 8).output().unwrap();
        assert_eq!(done.status.code(), Some(4), "{}", text(&done));
        let text = text(&done);
        assert!(text.contains(output.to_str().unwrap()) && text.lines().count() == 1, "{text}");
    }
    assert_eq!(folder.names(), ["noise.raw"]);
}

#[test]
fn inputs_that_cannot_be_read_are_a_sentence() {
    let folder = Folder::in_memory();
    let output = folder.path("out.bricks");
    let done = import(&folder.path("none.raw"), &output, 8).output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done));
    let input = raw_file(&folder, 8);
    let done = import(&input, &output, 9).output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done));
    let done = import(&input, &output, 8).args(["--brick", "0"]).output().unwrap();
    assert_eq!(done.status.code(), Some(2), "{}", text(&done));
    assert_eq!(folder.names(), ["noise.raw"]);
}

fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn verify_names_the_brick_and_ends_with_6() {
    let folder = Folder::in_memory();
    let input = raw_file(&folder, 40);
    let output = folder.path("out.bricks");
    let path = output.to_str().unwrap();
    let done = import(&input, &output, 40).args(["--brick", "16", "--json"]).output().unwrap();
    assert!(done.status.success());
    assert_eq!(json(&done)["format"], 1);
    let done = ashfall(&["verify", path, "--json"]).output().unwrap();
    assert!(done.status.success());
    assert_eq!(json(&done)["whole"], true);
    assert_eq!(json(&done)["bricks"], Store::open(&output).unwrap().numbering().count());

    let mut bytes = std::fs::read(&output).unwrap();
    bytes[200] ^= 4;
    std::fs::write(&output, &bytes).unwrap();
    let done = ashfall(&["verify", path, "--json"]).output().unwrap();
    assert_eq!(done.status.code(), Some(6));
    let damage = &json(&done)["damages"][0];
    let named = ["channel", "level", "x", "y", "z"].map(|key| damage[key].as_u64().unwrap());
    assert_eq!(named, [0; 5], "byte 200 belongs to the first brick");
    assert!(text(&done).contains("brick (channel 0, level 0, x 0, y 0, z 0)"), "{}", text(&done));

    std::fs::write(&output, &bytes[..bytes.len() - 5]).unwrap();
    assert_eq!(ashfall(&["verify", path]).output().unwrap().status.code(), Some(6));
    assert_eq!(ashfall(&["info", path]).output().unwrap().status.code(), Some(3));
    let raw = input.to_str().unwrap();
    assert_eq!(ashfall(&["verify", raw]).output().unwrap().status.code(), Some(3));
}

#[test]
fn info_tells_of_stores_and_of_other_files() {
    let folder = Folder::in_memory();
    let input = raw_file(&folder, 40);
    let output = folder.path("out.bricks");
    assert!(import(&input, &output, 40).args(["--spacing", "1,2,3"]).status().unwrap().success());
    let done = ashfall(&["info", output.to_str().unwrap(), "--json"]).output().unwrap();
    let info = json(&done);
    assert_eq!((&info["format"], &info["kind"]), (&1.into(), &"store".into()));
    assert_eq!(info["volume"]["size"], serde_json::json!([40, 40, 40]));
    assert_eq!(info["volume"]["transform"][2], serde_json::json!([0.0, 0.0, 3.0, 0.0]));
    let raw =
        ["info", input.to_str().unwrap(), "--raw-size", "40x40x40", "--raw-type", "u8", "--json"];
    let info = json(&ashfall(&raw).output().unwrap());
    assert_eq!((&info["format"], &info["kind"]), (&1.into(), &"raw".into()));
}
