//! Import of a raw file against `lz4 -1` of the same file, both file to file, in turn.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::{Value, json};

use crate::cli::bench_store::{Arguments, Folder, data, disk, median};
use crate::cli::import::all_cores;
use crate::error::Result;
use crate::import::{Options, Settings, import};
use crate::store::Compression;
use crate::volume::{RawLayout, Size3, VoxelFormat};

/// How this bench imports.
pub fn settings(payload: u32) -> Settings {
    Settings {
        name: "bench".to_owned(),
        origin: "bench".to_owned(),
        payload: Size3::cube(payload),
        ram_mib: 1024,
        jobs: all_cores(),
        compression: Compression::Lz4,
    }
}

/// A raw u8 file's layout.
pub fn options(size: Size3) -> Options {
    let raw = RawLayout { size, format: VoxelFormat::U8, big_endian: false };
    Options { raw: Some(raw), ..Options::default() }
}

fn seconds(run: impl FnOnce() -> Result<bool>) -> Result<Option<f64>> {
    let start = Instant::now();
    Ok(run()?.then(|| start.elapsed().as_secs_f64()))
}

fn lz4(input: &Path, output: &Path) -> bool {
    let status = Command::new("lz4")
        .args(["-1", "-f", "-q"])
        .args([input, output])
        .stdin(Stdio::null())
        .status();
    status.is_ok_and(|status| status.success())
}

/// The part `import`.
pub fn import_against_lz4(arguments: &Arguments, folder: &Folder) -> Result<Value> {
    let edge = arguments.edge;
    let size = Size3::cube(edge);
    let input = data::raw_file(folder, edge, edge)?;
    let (store, packed) = (folder.0.join("bench.bricks"), folder.0.join("bench.lz4"));
    let voxel_mib = size.voxel_count() as f64 / f64::from(1 << 20);
    let (mut ours, mut theirs, mut unsynced) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..arguments.repeats {
        theirs.extend(seconds(|| Ok(lz4(&input, &packed)))?);
        // The store is on the disk when import ends, but lz4's file is not: what the disk takes for
        // the same number of bytes is measured apart.
        ours.extend(seconds(|| {
            import(&input, &options(size), &store, &settings(32), &mut |_, _| {}).map(|_| true)
        })?);
        let again = folder.0.join("again");
        std::fs::copy(&store, &again).map_err(|why| disk(folder, &why))?;
        unsynced.extend(seconds(|| {
            let file = std::fs::File::open(&again).map_err(|why| disk(folder, &why))?;
            file.sync_all().map_err(|why| disk(folder, &why))?;
            Ok(true)
        })?);
        let _ = std::fs::remove_file(&again);
    }
    let len = |path: &Path| std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let [store_bytes, packed_bytes] = [len(&store), len(&packed)];
    let sync_s = median(unsynced);
    let ratios: Vec<f64> = ours.iter().zip(&theirs).map(|(ours, theirs)| ours / theirs).collect();
    let ours_s = median(ours);
    let _ = std::fs::remove_file(&packed);
    let theirs_s = if theirs.is_empty() { None } else { Some(median(theirs)) };
    if theirs_s.is_none() {
        eprintln!("ashfall: SKIPPED: there is no lz4 to compare with; install it");
    }
    Ok(json!({
        "size": size.to_array(), "type": "u8", "jobs": all_cores(), "repeats": arguments.repeats,
        "import_s": ours_s,
        "import_mib_per_second": voxel_mib / ours_s,
        "lz4_s": theirs_s,
        "lz4_mib_per_second": theirs_s.map(|seconds| voxel_mib / seconds),
        "time_against_lz4": if ratios.is_empty() { None } else { Some(median(ratios)) },
        "sync_of_as_many_bytes_s": sync_s,
        "store_bytes": store_bytes, "lz4_bytes": packed_bytes,
    }))
}
