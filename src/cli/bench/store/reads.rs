//! Random bricks out of one file against one file per brick (Octreemizer 2002, section on paging from
//! disk), and decoding against copying.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::{Value, json};

use crate::cli::bench::store::speed::{options, settings};
use crate::cli::bench::store::{Arguments, Folder, data, disk, median};
use crate::error::Result;
use crate::import::import;
use crate::source::{BrickEntry, BrickSource};
use crate::store::Store;
use crate::store::layout::checksum;
use crate::volume::{BrickId, Size3};

/// Reads per series, or all bricks where there are fewer.
const READS_MAX: usize = 2000;

/// Drops a file from the page cache; false where that cannot be asked for.
fn drop_cached(paths: &[&Path]) -> bool {
    paths.iter().all(|path| {
        let status = Command::new("dd")
            .arg(format!("if={}", path.display()))
            .args(["iflag=nocache", "count=0", "status=none"])
            .stdout(Stdio::null())
            .status();
        status.is_ok_and(|status| status.success())
    })
}

/// A store of the bench's volume.
fn store_of(arguments: &Arguments, folder: &Folder, payload: u32) -> Result<Store> {
    let size = Size3::cube(arguments.edge);
    let input = data::raw_file(folder, arguments.edge, arguments.edge)?;
    let path = folder.0.join(format!("reads_{payload}.bricks"));
    import(&input, &options(size), &path, &settings(payload), &mut |_, _| {})?;
    Store::open(&path)
}

/// Stored (not constant) bricks of level 0 in an order that no disk likes.
fn shuffled_bricks(store: &Store) -> Result<Vec<BrickId>> {
    let mut ids = Vec::new();
    for id in store.description().bricks().filter(|id| id.level == 0) {
        if matches!(store.entry(id)?, BrickEntry::Stored { .. }) {
            ids.push(id);
        }
    }
    let mut state = 1u64;
    for i in (1..ids.len()).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ids.swap(i, (state >> 33) as usize % (i + 1));
    }
    ids.truncate(READS_MAX);
    Ok(ids)
}

fn bricks_per_second(count: usize, read_all: impl FnOnce() -> Result<()>) -> Result<f64> {
    let start = Instant::now();
    read_all()?;
    Ok(count as f64 / start.elapsed().as_secs_f64())
}

/// The part `reads`.
pub fn against_files(arguments: &Arguments, folder: &Folder) -> Result<Value> {
    [16, 32, 64, 128]
        .into_iter()
        .filter(|payload| payload * 2 <= arguments.edge)
        .map(|payload| against_files_of(arguments, folder, payload))
        .collect::<Result<Vec<Value>>>()
        .map(Value::Array)
}

fn against_files_of(arguments: &Arguments, folder: &Folder, payload: u32) -> Result<Value> {
    let store = store_of(arguments, folder, payload)?;
    let store_path = folder.0.join(format!("reads_{payload}.bricks"));
    let ids = shuffled_bricks(&store)?;
    // One file per brick holds the same packed bytes, checked and unpacked in the same way.
    let files: Vec<PathBuf> =
        ids.iter().map(|id| folder.0.join(format!("{}_{}_{}.brick", id.x, id.y, id.z))).collect();
    let mut brick = Vec::new();
    let mut bytes = 0;
    for (&id, file) in ids.iter().zip(&files) {
        store.read(id, &mut brick)?;
        bytes += brick.len();
        let packed = lz4_flex::block::compress(&brick);
        std::fs::write(file, packed)
            .and_then(|()| File::open(file)?.sync_all())
            .map_err(|why| disk(folder, &why))?;
    }
    let from_store = || {
        let mut brick = Vec::new();
        ids.iter().try_for_each(|&id| store.read(id, &mut brick))
    };
    let from_files = || {
        let (mut packed, mut brick) = (Vec::new(), Vec::new());
        let mut sum = 0;
        for (&id, path) in ids.iter().zip(&files) {
            packed.clear();
            File::open(path)
                .and_then(|mut file| file.read_to_end(&mut packed))
                .map_err(|why| disk(folder, &why))?;
            sum ^= checksum(&packed);
            brick.resize(store.description().brick_bytes(id), 0);
            let _ = lz4_flex::block::decompress_into(&packed, &mut brick);
        }
        std::hint::black_box(sum);
        Ok(())
    };
    let all: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let series = |cold: bool| -> Result<Option<(f64, f64)>> {
        let (mut one_file, mut many) = (Vec::new(), Vec::new());
        for _ in 0..arguments.repeats {
            if cold && !(drop_cached(&[&store_path]) && drop_cached(&all)) {
                return Ok(None);
            }
            one_file.push(bricks_per_second(ids.len(), from_store)?);
            many.push(bricks_per_second(ids.len(), from_files)?);
        }
        Ok(Some((median(one_file), median(many))))
    };
    let figures = |pair: Option<(f64, f64)>| {
        pair.map(|(one_file, many)| {
            let mib = bytes as f64 / ids.len() as f64 / f64::from(1 << 20);
            json!({
                "store_bricks_per_second": one_file,
                "store_mib_per_second": one_file * mib,
                "files_bricks_per_second": many,
                "store_against_files": one_file / many,
            })
        })
    };
    let (warm, cold) = (figures(series(false)?), figures(series(true)?));
    for path in files.iter().chain([&store_path]) {
        let _ = std::fs::remove_file(path);
    }
    Ok(json!({ "brick": payload, "reads": ids.len(), "warm": warm, "cold": cold }))
}

/// The part `decode`: checksum and LZ4 of bricks in memory against copying what they unpack to.
pub fn decode_against_memcpy(arguments: &Arguments, folder: &Folder) -> Result<Value> {
    let store = store_of(arguments, folder, 32)?;
    let mut bricks = Vec::new();
    for id in shuffled_bricks(&store)? {
        let mut brick = Vec::new();
        store.read(id, &mut brick)?;
        let packed = lz4_flex::block::compress(&brick);
        bricks.push((packed, brick));
    }
    let bytes: usize = bricks.iter().map(|(_, brick)| brick.len()).sum();
    let mut out = vec![0; bricks.iter().map(|(_, brick)| brick.len()).max().unwrap_or(0)];
    let (mut decode, mut copy) = (Vec::new(), Vec::new());
    for _ in 0..arguments.repeats {
        let start = Instant::now();
        for (packed, brick) in &bricks {
            std::hint::black_box(checksum(packed));
            let got = lz4_flex::block::decompress_into(packed, &mut out[..brick.len()]);
            assert!(got.is_ok(), "packed a moment ago");
        }
        decode.push(bytes as f64 / start.elapsed().as_secs_f64());
        let start = Instant::now();
        for (_, brick) in &bricks {
            out[..brick.len()].copy_from_slice(brick);
            std::hint::black_box(&mut out);
        }
        copy.push(bytes as f64 / start.elapsed().as_secs_f64());
    }
    let mib = f64::from(1 << 20);
    let (decode, copy) = (median(decode), median(copy));
    let packed: usize = bricks.iter().map(|(packed, _)| packed.len()).sum();
    Ok(json!({
        "bricks": bricks.len(), "packed_to": packed as f64 / bytes as f64,
        "decode_mib_per_second": decode / mib, "memcpy_mib_per_second": copy / mib,
        "decode_time_against_memcpy": copy / decode,
    }))
}
