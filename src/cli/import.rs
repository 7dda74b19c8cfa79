//! `ashfall import`: a file in any known format -> a brick store.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use crate::cli::cores::all_cores;
use crate::cli::output::{print_line, say};
use crate::cli::reading::{Reading, parse_numbers};
use crate::cli::{interrupt, progress};
use crate::error::Result;
use crate::import::{Settings, Summary, import};
use crate::store::Compression;
use crate::store::layout::PAYLOAD_MAX;
use crate::volume::Size3;

/// Make a brick store of a volume in any format known.
///
/// A store holds the volume at every resolution, cut into bricks that can be read one by one, so that
/// volumes larger than any memory can be drawn. Import reads the input once and stays within --ram-mib.
/// The store appears under its name when it is whole; an import that ends early leaves no store.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    ashfall import brain.nii.gz -o brain.bricks\n  \
    ashfall import engine.raw -o engine.bricks --raw-size 256x256x128 --raw-type u8\n  \
    ashfall import scan.tif -o scan.bricks --spacing 0.5,0.5,2 --ram-mib 4096")]
pub struct Arguments {
    /// The file to read.
    input: PathBuf,
    /// The store to make; one of that name is replaced.
    #[arg(short, long, value_name = "OUT.bricks")]
    output: PathBuf,
    /// Payload voxels of a brick: one number, or three as in 64x64x16; each 1 to 256.
    #[arg(long, default_value = "32", value_name = "VOXELS", value_parser = parse_brick)]
    brick: Size3,
    /// Memory to stay within; what does not fit is kept in temporary files beside the store.
    #[arg(long, default_value_t = 1024, value_name = "MIB",
          value_parser = clap::value_parser!(u32).range(1..))]
    ram_mib: u32,
    /// Threads that work; absent: one per core.
    #[arg(long, value_name = "THREADS", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// How bricks are made smaller.
    #[arg(long, value_enum, default_value = "lz4")]
    compress: Compress,
    #[command(flatten)]
    reading: Reading,
    /// Print what was made as one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Compress {
    /// LZ4 where it makes a brick smaller.
    Lz4,
    /// Bricks as they are.
    None,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    interrupt::clean_up_on_signals();
    let origin = arguments.input.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let settings = Settings {
        name: name_of(&arguments.output),
        origin,
        payload: arguments.brick,
        ram_mib: arguments.ram_mib,
        jobs: arguments.jobs.map_or_else(all_cores, |jobs| jobs as usize),
        compression: match arguments.compress {
            Compress::Lz4 => Compression::Lz4,
            Compress::None => Compression::None,
        },
    };
    let bar = progress::bytes("importing");
    let summary = import(
        &arguments.input,
        &arguments.reading.options(),
        &arguments.output,
        &settings,
        &mut |done, total| {
            bar.set_length(total);
            bar.set_position(done);
        },
    );
    bar.finish_and_clear();
    let summary = summary?;
    for note in &summary.notes {
        say(format_args!("note: {note}"));
    }
    report_counts(&summary);
    if arguments.json {
        print_line(to_json(&arguments.output, &summary))
    } else {
        print_line(sentence(&arguments.output, &summary))
    }
}

fn name_of(output: &Path) -> String {
    output.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn report_counts(summary: &Summary) {
    for (channel, row) in summary.description.channels.iter().enumerate() {
        let counts = [
            (row.nan_voxels, "are NaN and will be drawn as nothing"),
            (row.infinite_voxels, "were infinite and are now the largest finite value"),
            (row.absent_voxels, "are absent from the input and will be drawn as nothing"),
        ];
        for (count, what) in counts.iter().filter(|(count, _)| *count > 0) {
            say(format_args!("channel {channel}: {count} voxels {what}"));
        }
    }
}

fn mib_per_second(summary: &Summary) -> f64 {
    summary.voxel_bytes as f64 / f64::from(1 << 20) / summary.wall.as_secs_f64().max(1e-9)
}

fn sentence(output: &Path, summary: &Summary) -> String {
    let description = &summary.description;
    format!(
        "{}: {} voxels of {}, {} channel(s), {} levels, {:.1} MiB in {:.2} s ({:.0} MiB/s of voxels)",
        output.display(),
        description.size(),
        description.channels[0].format,
        description.channels.len(),
        description.levels.count(),
        summary.file_bytes as f64 / f64::from(1 << 20),
        summary.wall.as_secs_f64(),
        mib_per_second(summary),
    )
}

fn to_json(output: &Path, summary: &Summary) -> serde_json::Value {
    json!({
        "format": 1,
        "store": output.display().to_string(),
        "file_bytes": summary.file_bytes,
        "voxel_bytes": summary.voxel_bytes,
        "wall_ms": summary.wall.as_secs_f64() * 1e3,
        "mib_per_second": mib_per_second(summary),
        "peak_rss_bytes": crate::render::peak_rss_bytes(),
        "notes": summary.notes,
        "volume": crate::cli::info::description_json(&summary.description),
    })
}

fn parse_brick(text: &str) -> std::result::Result<Size3, String> {
    let size = match parse_numbers::<u32>(text, 'x').as_deref() {
        Some(&[edge]) => Size3::cube(edge),
        Some(&[x, y, z]) => Size3::new(x, y, z),
        _ => return Err("wanted one number or three, as in 32 or 64x64x16".to_owned()),
    };
    if size.to_array().iter().all(|edge| (1..=PAYLOAD_MAX).contains(edge)) {
        Ok(size)
    } else {
        Err(format!("a brick has 1 to {PAYLOAD_MAX} voxels along each axis"))
    }
}
