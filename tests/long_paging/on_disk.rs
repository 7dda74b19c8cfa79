//! A store of more than 4 GiB, made, drawn through 256 MiB and removed.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use crate::alone;
use crate::binary::ashfall;
use crate::common::drawing::Device;
use crate::drawn::Drawn;
use crate::folder::Folder;
use crate::random::Random;

/// u16: 4.39e9 bytes.
const EDGE: usize = 1300;
const RAW_BYTES: u64 = 2 * (EDGE * EDGE * EDGE) as u64;
/// The raw file, and the store with its aprons and levels.
const DISK_GIB_MIN: u64 = 12;

/// Thin enough that rays from within reach the far side.
const SCENE: &str = r#"format = 1
[picture]
size = [512, 512]
[[volume]]
name = "fog"
source = "fog.bricks"
spacing = [0.00076923, 0.00076923, 0.00076923]
[[volume.channel]]
window = [0.0, 65535.0]
transfer = [
  { at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.2 },
  { at = 0.5, color = [0.9, 0.6, 0.2], extinction = 1.0 },
  { at = 1.0, color = [1.0, 0.9, 0.8], extinction = 4.0 },
]
[[view]]
name = "whole"
eye = [1.9, -1.1, 1.4]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 38.0
[[view]]
name = "inside"
eye = [0.11, 0.17, 0.23]
target = [0.8, 0.7, 0.6]
up = [0.0, 0.0, 1.0]
fov_degrees = 70.0
"#;

/// GiB free where temporary files go; nothing where the system does not say.
fn free_gib() -> Option<u64> {
    let output = Command::new("df").arg("-Pk").arg(std::env::temp_dir()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let kib: u64 = text.lines().nth(1)?.split_whitespace().nth(3)?.parse().ok()?;
    Some(kib >> 20)
}

/// Slice by slice: hills along each axis, and 12 bits of noise that nothing makes smaller.
fn write_raw(path: &Path) {
    let mut file = File::create(path).expect("created");
    let hill = |at: usize, waves: f64| {
        let turns = waves * std::f64::consts::TAU * at as f64 / EDGE as f64;
        (10_000.0 + 9_000.0 * turns.sin()) as u16
    };
    let along = |waves| (0..EDGE).map(|at| hill(at, waves)).collect::<Vec<u16>>();
    let [xs, ys, zs] = [2.0, 3.0, 1.5].map(along);
    let mut slice = vec![0u16; EDGE * EDGE];
    let mut noise = Random(1);
    for z in zs {
        for (y, row) in ys.iter().zip(slice.chunks_exact_mut(EDGE)) {
            for (x, voxel) in xs.iter().zip(row) {
                *voxel = x + y + z + (noise.next() >> 52) as u16;
            }
        }
        let bytes: &[u8] = bytemuck::cast_slice(&slice);
        file.write_all(bytes).expect("written");
    }
}

/// The store and the scene that shows it; the raw file is gone.
fn make(folder: &Folder) -> u64 {
    let [raw, store] = ["fog.raw", "fog.bricks"].map(|name| folder.path(name));
    write_raw(&raw);
    assert_eq!(raw.metadata().expect("there").len(), RAW_BYTES);
    let size = format!("{EDGE}x{EDGE}x{EDGE}");
    let text = |path: &Path| path.to_str().expect("UTF-8").to_owned();
    let flags = ["--raw-size", &size, "--raw-type", "u16", "--compress", "none"];
    let run = ashfall(["import", &text(&raw), "-o", &text(&store)].into_iter().chain(flags));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    std::fs::remove_file(&raw).expect("removed");
    store.metadata().expect("there").len()
}

#[test]
#[ignore = "2 to 5 minutes and 12 GiB of disk: a store of 4 GiB is made and drawn"]
fn a_store_of_4_gib_on_disk_is_drawn_through_256_mib() {
    let _alone = alone();
    match free_gib() {
        Some(free) if free >= DISK_GIB_MIN => {}
        free => {
            let free = free.map_or("an unknown number of".to_owned(), |free| free.to_string());
            eprintln!("SKIPPED: {free} GiB are free for temporary files, {DISK_GIB_MIN} needed");
            return;
        }
    }
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("long-on-disk");
    let begun = std::time::Instant::now();
    let bytes = make(&folder);
    assert!(bytes >= 4 << 30, "{bytes} bytes on disk");
    println!("store of {bytes} bytes on disk, made in {:.0} s", begun.elapsed().as_secs_f64());
    let scene = folder.write("fog.toml", SCENE);
    let memory = ["--atlas-mib", "256", "--ram-mib", "256", "--addressing", "auto"];
    for (view, more) in [("whole", &[][..]), ("inside", &["--level-max", "0"])] {
        let drawn = Drawn::of(&scene, view, &[&memory[..], more].concat());
        drawn.check();
        println!("store of {bytes} bytes on disk, {view}: {}", drawn.figures());
        if view == "inside" {
            assert_eq!(drawn.by_level()[0], drawn.number("bricks_uploaded"), "all of level 0");
        }
    }
}
