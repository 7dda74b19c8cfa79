//! From an input to a store: one thread decodes, all cut and pack, one writes.

use std::path::Path;
use std::time::{Duration, Instant};

use crossbeam_channel::{Sender, bounded};

use crate::error::{Error, Result};
use crate::import::build::{Build, Decoded};
use crate::import::chain::Pushed;
use crate::import::convert::{convert, kept_format};
use crate::import::level_slices::{Plan, TASK_BYTES};
use crate::import::slices::Budget;
use crate::import::{Header, Input, Options, Run, open};
use crate::source::{ChannelDescription, Description};
use crate::store::{Compression, Encoded, Numbering, Writer};
use crate::volume::{BrickId, Levels, Size3, ValueRange};

/// Memory that does not hold slices: runs on their way, bricks on theirs, the index, the program.
const OTHER_BYTES: u64 = 128 << 20;
/// Part of it: bricks that are being packed, before and after.
const PACKING_BYTES: usize = 32 << 20;

/// How a store is made.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The volume's name in the store.
    pub name: String,
    /// What the provenance says of where the voxels come from, such as the file's name.
    pub origin: String,
    /// Payload voxels per axis of a brick.
    pub payload: Size3,
    /// Memory to stay within, about; slices that do not fit are kept in files beside the store.
    pub ram_mib: u32,
    /// Threads that cut and pack.
    pub jobs: usize,
    /// Of the bricks.
    pub compression: Compression,
}

/// What was made.
#[derive(Clone, Debug)]
pub struct Summary {
    /// As it stands in the store.
    pub description: Description,
    /// Length of the store.
    pub file_bytes: u64,
    /// Bytes of the input's voxels, as kept.
    pub voxel_bytes: u64,
    /// What the reader had to say.
    pub notes: Vec<String>,
    /// Whether voxels came in an order that needs all of level 0 at once.
    pub any_order: bool,
    /// From opening the input to the store's final name.
    pub wall: Duration,
}

/// Called with voxel bytes done and in all, often.
pub type Progress<'a> = dyn FnMut(u64, u64) + Send + 'a;

/// Imports the file at `path` into a store at `target`, replacing one of that name.
///
/// # Errors
/// When the input is unusable (exit code 3) or the disk does not take the store (4); then `target` is
/// as it was.
pub fn import(
    path: &Path,
    options: &Options,
    target: &Path,
    settings: &Settings,
    progress: &mut Progress,
) -> Result<Summary> {
    import_from(&|| open(path, options), target, settings, progress)
}

/// The same from anything that can be opened, twice if its voxels come in no good order.
///
/// # Errors
/// As [`import`].
pub fn import_from(
    opened: &(dyn Fn() -> Result<Box<dyn Input>> + Sync),
    target: &Path,
    settings: &Settings,
    progress: &mut Progress,
) -> Result<Summary> {
    let start = Instant::now();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.jobs)
        .build()
        .map_err(|why| Error::machine(format!("cannot start {} jobs: {why}", settings.jobs)))?;
    let mut summary =
        match pool.install(|| attempt(opened()?, target, settings, false, progress))? {
            Some(summary) => summary,
            None => pool
                .install(|| attempt(opened()?, target, settings, true, progress))?
                .expect("any order is a good order"),
        };
    summary.wall = start.elapsed();
    Ok(summary)
}

/// Nothing when the voxels' order asks for another attempt.
fn attempt(
    input: Box<dyn Input>,
    target: &Path,
    settings: &Settings,
    any_order: bool,
    progress: &mut Progress,
) -> Result<Option<Summary>> {
    let mut description = describe(input.header(), settings)?;
    let notes = input.header().notes.clone();
    let absent_voxels = input.header().absent_voxels;
    let numbering = Numbering::of_description(&description)
        .ok_or_else(|| Error::input("the volume has too many bricks; choose larger ones"))?;
    let mut writer = Writer::create(target, numbering)?;
    let task_bytes = TASK_BYTES.max(2 * description.brick_bytes(description.brick_largest()));
    let tasks = (PACKING_BYTES / task_bytes).clamp(settings.jobs, settings.jobs * 16);
    let (to_writer, bricks) = bounded::<(BrickId, Encoded)>(tasks / 2 + 1);
    // Runs have about 4 MiB: three on their way keep the decoding thread ahead.
    let (to_chains, runs) = bounded(2);
    let ram_bytes = u64::from(settings.ram_mib) << 20;
    let plan = Plan {
        compression: settings.compression,
        tasks,
        any_order,
        some_absent: absent_voxels > 0,
    };
    let budget = Budget::new(ram_bytes.saturating_sub(OTHER_BYTES).max(ram_bytes / 4));
    let format = description.channels[0].format;
    let mut build = Build::new(target, plan, budget, &mut description);
    let (built, written) = std::thread::scope(|scope| {
        scope.spawn(move || decode(input, format, &to_chains));
        let written = scope.spawn(move || {
            for (first, encoded) in bricks {
                writer.append(first, &encoded)?;
            }
            Ok(writer)
        });
        let built = build.run(&runs, &to_writer, progress);
        // Both other threads end when no one listens or speaks to them any more.
        drop((runs, to_writer));
        (built, written.join().expect("the writer does not panic"))
    });
    // When the writer stopped, that is why building stopped.
    let writer: Writer = written?;
    if built? == Pushed::OutOfOrder {
        return Ok(None);
    }
    count_absent(&mut description, absent_voxels);
    let voxel_bytes = voxel_bytes(&description);
    let file_bytes = writer.finish(&description)?;
    let wall = Duration::ZERO;
    Ok(Some(Summary { description, file_bytes, voxel_bytes, notes, any_order, wall }))
}

/// Bytes of all channels' voxels.
pub fn voxel_bytes(description: &Description) -> u64 {
    let bytes: u64 = description.channels.iter().map(|row| row.format.bytes() as u64).sum();
    (description.size().voxel_count() * u128::from(bytes)).try_into().unwrap_or(u64::MAX)
}

fn describe(header: &Header, settings: &Settings) -> Result<Description> {
    if header.size.is_empty() || header.channels == 0 {
        return Err(Error::input("the input has no voxels"));
    }
    if header.size.voxel_count() >= 1 << 63 {
        return Err(Error::input(format!("{} are more than 2^63 voxels", header.size)));
    }
    if header.channels > u32::from(u16::MAX) {
        return Err(Error::input(format!("{} channels are more than 65535", header.channels)));
    }
    let format = kept_format(header.format, header.absent_voxels);
    let mut provenance = format!("origin: {}\nformat: {}\n", settings.origin, header.format_name);
    if format != header.format {
        provenance += &format!("voxels: {} kept as {format} for absent voxels\n", header.format);
    }
    for note in &header.notes {
        provenance += &format!("note: {note}\n");
    }
    let channel = |channel: u32| {
        let (slope, intercept) =
            header.scaling.get(channel as usize).copied().unwrap_or((1.0, 0.0));
        ChannelDescription {
            format,
            slope,
            intercept,
            nan_voxels: 0,
            infinite_voxels: 0,
            absent_voxels: 0,
            range: ValueRange::EMPTY,
        }
    };
    let spacing = header.world_from_voxel.spacing().to_array();
    Ok(Description {
        name: settings.name.clone(),
        payload: settings.payload,
        levels: Levels::of(header.size, spacing, settings.payload),
        world_from_voxel: header.world_from_voxel,
        unit: header.unit.clone(),
        provenance,
        channels: (0..header.channels).map(channel).collect(),
    })
}

fn decode(mut input: Box<dyn Input>, format: crate::volume::VoxelFormat, out: &Sender<Decoded>) {
    loop {
        let run = match input.next_run() {
            Ok(Some(run)) => run,
            Ok(None) => return,
            Err(why) => {
                let _ = out.send(Err(why));
                return;
            }
        };
        let (voxels, counts) = convert(run.voxels, format);
        // The other end is gone when building has failed.
        if out.send(Ok((Run { voxels, ..run }, counts))).is_err() {
            return;
        }
    }
}

/// Absent voxels that came as NaN are absent, not NaN of the input.
fn count_absent(description: &mut Description, header_absent: u64) {
    let undelivered: u64 = description.channels.iter().map(|row| row.absent_voxels).sum();
    let mut rest = header_absent.saturating_sub(undelivered);
    for row in &mut description.channels {
        let came_as_nan = rest.min(row.nan_voxels);
        row.nan_voxels -= came_as_nan;
        row.absent_voxels += came_as_nan;
        rest -= came_as_nan;
    }
}
