//! Opening a store of millions of bricks: time and memory, in a process of its own.

use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use crate::cli::bench::store::memory::run_self;
use crate::cli::bench::store::{Arguments, Folder, median};
use crate::error::Result;
use crate::render::peak_rss_bytes;
use crate::source::{BrickSource, ChannelDescription, Description};
use crate::store::{Compression, Encoded, Numbering, Store, Writer, encode};
use crate::volume::{BrickId, Levels, Size3, ValueRange, VoxelFormat, WorldFromVoxel};

/// Opens a store and reads one brick: `open_ms`, `first_brick_ms`, `peak_rss_bytes`.
pub fn once(file: &Path) -> Result<Value> {
    let before = peak_rss_bytes();
    let start = Instant::now();
    let store = Store::open(file)?;
    let open_ms = start.elapsed().as_secs_f64() * 1e3;
    let after = peak_rss_bytes();
    let start = Instant::now();
    let middle = store.numbering().brick(store.numbering().count() / 2);
    store.read(middle, &mut Vec::new())?;
    Ok(json!({
        "format": 1,
        "bricks": store.numbering().count(),
        "open_ms": open_ms,
        "first_brick_ms": start.elapsed().as_secs_f64() * 1e3,
        "peak_rss_bytes": peak_rss_bytes(),
        "open_rss_bytes": after.saturating_sub(before),
    }))
}

/// A store of at least `bricks` bricks, all of them constant: an index and little else.
pub fn make_large(path: &Path, bricks: u64) -> Result<u64> {
    let payload = Size3::cube(32);
    // Coarser levels add a seventh.
    let edge = ((bricks as f64 * 7.0 / 8.0).cbrt().ceil() as u32).max(1) * 32;
    let channel = ChannelDescription {
        format: VoxelFormat::U8,
        slope: 1.0,
        intercept: 0.0,
        nan_voxels: 0,
        infinite_voxels: 0,
        absent_voxels: 0,
        range: ValueRange::of(7.0),
    };
    let description = Description {
        name: "large".to_owned(),
        payload,
        levels: Levels::of(Size3::cube(edge), [1.0; 3], payload),
        world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3])?,
        unit: None,
        provenance: "origin: bench\n".to_owned(),
        channels: vec![channel],
    };
    let numbering = Numbering::of_description(&description).expect("bricks are millions");
    let count = numbering.count();
    let mut writer = Writer::create(path, numbering)?;
    for level in 0..description.levels.count() as u8 {
        let grid = description.grid(level).expect("it has that level").bricks();
        let mut row = Encoded::default();
        for _ in 0..grid.x {
            encode(&[7u8; 27], Size3::cube(3), Compression::Lz4, || 0.0, &mut row);
        }
        for z in 0..grid.z {
            for y in 0..grid.y {
                let id = BrickId { volume: 0, channel: 0, level, x: 0, y, z };
                writer.append(id, &row)?;
            }
        }
    }
    writer.finish(&description)?;
    Ok(count)
}

/// The part `open`.
pub fn large_store(arguments: &Arguments, folder: &Folder) -> Result<Value> {
    let path = folder.0.join("large.bricks");
    let bricks = make_large(&path, arguments.open_bricks)?;
    let text = path.display().to_string();
    let mut runs = Vec::new();
    for _ in 0..arguments.repeats {
        runs.push(run_self(&["bench", "store", "--open", &text])?);
    }
    let file_bytes = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
    let _ = std::fs::remove_file(&path);
    let of = |key: &str| median(runs.iter().filter_map(|run| run[key].as_f64()).collect());
    Ok(json!({
        "bricks": bricks, "file_mib": file_bytes as f64 / 1048576.0,
        "open_ms": of("open_ms"), "first_brick_ms": of("first_brick_ms"),
        "peak_rss_mib": of("peak_rss_bytes") / 1048576.0,
        "open_rss_mib": of("open_rss_bytes") / 1048576.0,
    }))
}
