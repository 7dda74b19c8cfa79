//! `ashfall trace`: what a trace's file says in numbers, what changed between two, and a picture of it.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde::Serialize;
use serde_json::Value;

use crate::cli::output::{print, print_json};
use crate::cli::picture_file::{folder_is_there, write_whole};
use crate::error::{Error, Result};
use crate::trace::summary::{Percentiles, Summary};
use crate::trace::timeline::{Choice, Refused, draw};

/// Say in numbers, or draw, what a trace (`--trace FILE` of render, or the window's) shows.
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Busy queues, the part of the copies that rendering hid, who waited for whom, bricks on their way.
    Summary {
        /// The trace (.json).
        file: PathBuf,
        /// Print one JSON object instead of text.
        #[arg(long)]
        json: bool,
    },
    /// What changed from one trace to another, figure by figure.
    Compare {
        /// The trace of before.
        before: PathBuf,
        /// The trace of after.
        after: PathBuf,
        /// Print one JSON object instead of text.
        #[arg(long)]
        json: bool,
    },
    /// A picture of a trace: a lane for each thread and queue, counters below, and one brick's way.
    ///
    /// Spans narrower than half a pixel are merged, so choose a few rounds with --from and --to to tell them apart.
    Draw(DrawArguments),
}

#[derive(Args)]
struct DrawArguments {
    /// The trace (.json).
    file: PathBuf,
    /// Picture file, .svg.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Milliseconds since the trace began; default: its beginning.
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    from: Option<f64>,
    /// One past the last millisecond; default: the trace's end.
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    to: Option<f64>,
    /// The brick whose way is drawn: its flow's number; default: of those that came within the picture, the slowest.
    #[arg(long, value_name = "N")]
    brick: Option<u64>,
}

fn milliseconds(text: &str) -> std::result::Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "must be a number of milliseconds".to_owned())?;
    if number.is_finite() { Ok(number) } else { Err("must be finite".to_owned()) }
}

/// Both, side by side.
#[derive(Serialize)]
struct Compared {
    before: Summary,
    after: Summary,
    changes: Vec<Change>,
}

#[derive(Serialize)]
struct Change {
    figure: &'static str,
    before: f64,
    after: f64,
    /// After over before; nothing where there was nothing before.
    ratio: Option<f64>,
}

/// Reads, reckons, prints.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.what {
        What::Summary { file, json } => {
            let summary = read(file)?;
            if *json { print_json(&summary) } else { print(text(&summary)) }
        }
        What::Compare { before, after, json } => {
            let (before, after) = (read(before)?, read(after)?);
            let changes = changes(&before, &after);
            if *json {
                return print_json(&Compared { before, after, changes });
            }
            print(changes_text(&changes))
        }
        What::Draw(arguments) => draw_file(arguments),
    }
}

fn draw_file(arguments: &DrawArguments) -> Result<()> {
    let DrawArguments { file, output, from, to, brick } = arguments;
    if output.extension().is_none_or(|ending| ending != "svg") {
        return Err(Error::arguments(format!(
            "{}: pictures of traces are SVG: give -o a name that ends in .svg",
            output.display()
        )));
    }
    folder_is_there(output)?;
    let choice = Choice { from_ms: *from, to_ms: *to, brick: *brick };
    let svg = draw(&json(file)?, &choice).map_err(|why| match why {
        Refused::File(why) => not_ours(file, &why),
        Refused::Choice(why) => Error::arguments(format!("{}: {why}", file.display())),
    })?;
    write_whole(output, &svg)
}

fn read(path: &Path) -> Result<Summary> {
    Summary::of(&json(path)?).map_err(|why| not_ours(path, &why))
}

fn json(path: &Path) -> Result<Value> {
    let refuse = |why: String| Error::input(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(path).map_err(|why| refuse(format!("cannot be read: {why}")))?;
    serde_json::from_slice(&bytes).map_err(|why| refuse(format!("is no JSON: {why}")))
}

fn not_ours(path: &Path, why: &str) -> Error {
    Error::input(format!("{}: {why}: is it a trace of ashfall's?", path.display()))
}

fn text(summary: &Summary) -> String {
    let mut lines = vec![format!("{:.1} ms, {} rounds", summary.wall_ms, summary.rounds)];
    if summary.events_dropped > 0 {
        lines.push(format!(
            "{} events are missing: figures are of the rest",
            summary.events_dropped
        ));
    }
    for queue in &summary.queues {
        let part = 100.0 * queue.part;
        lines.push(format!(
            "{}: busy {:.1} ms ({part:.1} %), {} steps",
            queue.queue, queue.ms, queue.steps
        ));
    }
    lines.push(match summary.overlap {
        Some(overlap) => format!(
            "{:.1} % of the copies' time lay beside rendering{}",
            100.0 * overlap,
            if summary.roles_share_queue { ": the device has one queue for both" } else { "" }
        ),
        None => "no copies were timed: no overlap".to_owned(),
    });
    for stall in &summary.stalls {
        lines.push(format!(
            "waits, {}: {:.1} ms in {}, the longest {:.1} ms",
            stall.cause, stall.ms, stall.count, stall.worst_ms
        ));
    }
    let percentiles = |what: &str, of: &Percentiles| {
        format!(
            "{what}: median {:.1} ms, p95 {:.1}, p99 {:.1}, worst {:.1}",
            of.median, of.p95, of.p99, of.worst
        )
    };
    lines.push(percentiles("rounds", &summary.round_ms));
    if summary.bricks_published > 0 {
        lines.push(percentiles("wanted to published", &summary.wanted_to_published_ms));
        lines.push(percentiles("wanted to sampled", &summary.wanted_to_sampled_ms));
        lines.push(format!(
            "{} bricks, {} of them distinct: reload factor {:.2}; {} were never sampled, {}{} of {} bytes; {:.0} bytes a round",
            summary.bricks_published,
            summary.bricks_distinct,
            summary.reload_factor,
            summary.bricks_wasted,
            if summary.bytes_wasted_guessed > 0 { "about " } else { "" },
            summary.bytes_wasted,
            summary.bytes_copied,
            summary.bytes_per_round
        ));
        for slow in &summary.slowest {
            lines.push(format!("slow: {:.1} ms for {}", slow.ms, slow.brick));
        }
    }
    lines.join("\n") + "\n"
}

/// One of a summary's.
type Figure = fn(&Summary) -> f64;

fn changes(before: &Summary, after: &Summary) -> Vec<Change> {
    let figures: [(&'static str, Figure); 12] = [
        ("wall, ms", |of| of.wall_ms),
        ("rounds", |of| of.rounds as f64),
        ("round p95, ms", |of| of.round_ms.p95),
        ("round worst, ms", |of| of.round_ms.worst),
        ("render queue busy, ms", |of| of.queues.first().map_or(0.0, |queue| queue.ms)),
        ("transfer queue busy, ms", |of| of.queues.get(1).map_or(0.0, |queue| queue.ms)),
        ("overlap", |of| of.overlap.unwrap_or(0.0)),
        ("waits, ms", |of| of.stalls.iter().map(|stall| stall.ms).sum()),
        ("wanted to published p95, ms", |of| of.wanted_to_published_ms.p95),
        ("bricks", |of| of.bricks_published as f64),
        ("reload factor", |of| of.reload_factor),
        ("bricks never sampled", |of| of.bricks_wasted as f64),
    ];
    let change = |(figure, of): (&'static str, Figure)| {
        let (before, after) = (of(before), of(after));
        let ratio = (before != 0.0).then(|| after / before);
        Change { figure, before, after, ratio }
    };
    figures.map(change).into()
}

fn changes_text(changes: &[Change]) -> String {
    let mut text = format!("{:<28} {:>12} {:>12} {:>8}\n", "", "before", "after", "ratio");
    for Change { figure, before, after, ratio } in changes {
        let ratio = ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
        text += &format!("{figure:<28} {before:>12.2} {after:>12.2} {ratio:>8}\n");
    }
    text
}
