//! Import of a raw file against `lz4 -1` of the same file, both file to file, in turn.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::{Value, json};

use crate::cli::bench::store::{Arguments, Folder, data, median};
use crate::cli::cores::all_cores;
use crate::cli::output::say;
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

/// Wall and processor seconds of some work, this process and its children together.
fn seconds(run: impl FnOnce() -> Result<bool>) -> Result<Option<(f64, f64)>> {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    Ok(run()?.then(|| (start.elapsed().as_secs_f64(), cpu_seconds() - cpu)))
}

/// User and system time of this process and of children that have ended; NaN where the system does
/// not tell. Linux counts it in hundredths of a second.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 to 17, counted after the program's name, which may hold blanks.
    let fields = stat.rsplit_once(')').map_or("", |(_, fields)| fields);
    let ticks: Vec<f64> =
        fields.split_whitespace().skip(11).take(4).filter_map(|field| field.parse().ok()).collect();
    if ticks.len() == 4 { ticks.iter().sum::<f64>() / 100.0 } else { f64::NAN }
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
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..arguments.repeats {
        theirs.extend(seconds(|| Ok(lz4(&input, &packed)))?);
        ours.extend(seconds(|| {
            import(&input, &options(size), &store, &settings(32), &mut |_, _| {}).map(|_| true)
        })?);
    }
    let len = |path: &Path| std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let [store_bytes, packed_bytes] = [len(&store), len(&packed)];
    let _ = std::fs::remove_file(&packed);
    let figures = |runs: &[(f64, f64)]| {
        let wall_s = median(runs.iter().map(|run| run.0).collect());
        let cpu_s = median(runs.iter().map(|run| run.1).collect());
        json!({ "wall_s": wall_s, "cpu_s": cpu_s, "mib_per_second": voxel_mib / wall_s })
    };
    if theirs.is_empty() {
        say("SKIPPED: there is no lz4 to compare with; install it");
    }
    let ratio = |of: fn(&(f64, f64)) -> f64| {
        let ratios: Vec<f64> = ours.iter().zip(&theirs).map(|(a, b)| of(a) / of(b)).collect();
        (!ratios.is_empty()).then(|| median(ratios))
    };
    Ok(json!({
        "size": size.to_array(), "type": "u8", "jobs": all_cores(), "repeats": arguments.repeats,
        "import": figures(&ours),
        "lz4": (!theirs.is_empty()).then(|| figures(&theirs)),
        // The store is on the disk when import ends; lz4 leaves its file to the page cache.
        "wall_against_lz4": ratio(|run| run.0),
        "cpu_against_lz4": ratio(|run| run.1),
        "store_bytes": store_bytes, "lz4_bytes": packed_bytes,
    }))
}
