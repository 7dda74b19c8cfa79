//! `ashfall import`: a file in any known format -> a brick store.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use crate::cli::{interrupt, progress};
use crate::error::{Error, Result};
use crate::import::{Options, SegyFields, Settings, Summary, import};
use crate::store::Compression;
use crate::store::layout::PAYLOAD_MAX;
use crate::volume::{RawLayout, Size3, VoxelFormat};

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

/// What the command line says about an input; shared with `info`.
#[derive(Args)]
pub struct Reading {
    /// A raw file's voxels along x (fastest), y and z, as in 512x512x512.
    #[arg(long, value_name = "XxYxZ", value_parser = parse_size, requires = "raw_type")]
    raw_size: Option<Size3>,
    /// A raw file's voxel type: u8, u16, i16, f32 or rgba8.
    #[arg(long, value_name = "TYPE", value_parser = parse_type, requires = "raw_size")]
    raw_type: Option<VoxelFormat>,
    /// A raw file's byte order.
    #[arg(long, value_enum, default_value = "little", value_name = "ORDER")]
    raw_endian: Endian,
    /// World length of a voxel along x, y and z; wins over what the file says.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_spacing)]
    spacing: Option<[f64; 3]>,
    /// Which time step of a series, from 0.
    #[arg(long, default_value_t = 0, value_name = "STEP")]
    time: u32,
    /// SEG-Y: first byte of the inline number in a trace header, counted from 1.
    #[arg(long, default_value_t = 189, value_name = "BYTE")]
    segy_inline_byte: u16,
    /// SEG-Y: first byte of the crossline number in a trace header, counted from 1.
    #[arg(long, default_value_t = 193, value_name = "BYTE")]
    segy_crossline_byte: u16,
}

#[derive(Clone, Copy, ValueEnum)]
enum Compress {
    /// LZ4 where it makes a brick smaller.
    Lz4,
    /// Bricks as they are.
    None,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Endian {
    Little,
    Big,
}

impl Reading {
    /// As readers take it.
    pub fn options(&self) -> Options {
        let raw = self.raw_size.zip(self.raw_type).map(|(size, format)| RawLayout {
            size,
            format,
            big_endian: self.raw_endian == Endian::Big,
        });
        let segy = SegyFields {
            inline_byte: self.segy_inline_byte,
            crossline_byte: self.segy_crossline_byte,
        };
        Options { raw, spacing: self.spacing, time: self.time, segy }
    }
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
        eprintln!("ashfall: note: {note}");
    }
    report_counts(&summary);
    if arguments.json {
        println!("{}", to_json(&arguments.output, &summary));
    } else {
        println!("{}", sentence(&arguments.output, &summary));
    }
    Ok(())
}

/// One thread per core.
pub fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
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
            eprintln!("ashfall: channel {channel}: {count} voxels {what}");
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
        "peak_rss_bytes": crate::cli::bench::peak_rss_bytes(),
        "notes": summary.notes,
        "volume": crate::cli::info::description_json(&summary.description),
    })
}

fn parse_numbers<T: std::str::FromStr>(text: &str, separator: char) -> Option<Vec<T>> {
    text.split(separator).map(|part| part.trim().parse().ok()).collect()
}

fn parse_size(text: &str) -> std::result::Result<Size3, String> {
    match parse_numbers::<u32>(text, 'x').as_deref() {
        Some(&[x, y, z]) if x > 0 && y > 0 && z > 0 => Ok(Size3::new(x, y, z)),
        _ => Err("wanted three numbers above 0, as in 512x512x256".to_owned()),
    }
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

fn parse_type(text: &str) -> std::result::Result<VoxelFormat, String> {
    VoxelFormat::from_name(text).ok_or_else(|| "wanted u8, u16, i16, f32 or rgba8".to_owned())
}

fn parse_spacing(text: &str) -> std::result::Result<[f64; 3], String> {
    match parse_numbers::<f64>(text, ',').as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|edge| edge.is_finite() && *edge > 0.0) => {
            Ok([x, y, z])
        }
        _ => Err("wanted three positive numbers, as in 0.5,0.5,2".to_owned()),
    }
}

/// Starts a rayon pool for a command.
pub fn pool(jobs: Option<u32>) -> Result<rayon::ThreadPool> {
    let jobs = jobs.map_or_else(all_cores, |jobs| jobs as usize);
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build()
        .map_err(|why| Error::machine(format!("cannot start {jobs} jobs: {why}")))
}
