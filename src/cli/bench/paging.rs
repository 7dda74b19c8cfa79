//! `ashfall bench paging`: how often bricks are loaded again, against the size of the atlas.

use std::path::PathBuf;

use clap::Args;

use crate::cli::load::load_scene;
use crate::cli::measuring::MeasuringFlags;
use crate::cli::output::{make_folder, print, write};
use crate::cli::scene_flags::pixels;
use crate::error::{Error, Exit, Result};
use crate::render::paging::LoadOrder;
use crate::scene::Overrides;
use crate::study::bench_scenes::{cloud, four_channels};
use crate::study::chart::{Panel, Series, svg};
use crate::study::reload::{Case, Effort, ReloadRow, ReloadTable, csv, measure, order_name};

/// How often bricks are loaded again where the atlas does not hold all that a picture needs: bricks
/// uploaded over bricks needed, rounds until no ray waits, and the time, against the atlas's slots.
///
/// Two orders of loading are compared. "guarded", what ashfall does: the nearest brick that a ray waits
/// for first, and no brick is given up that a nearer ray waits for. "papers", as published: by the
/// number of rays that ask, least recently used given up; there, pictures of several channels need not
/// end in a small atlas, and then the table says why.
#[derive(Args)]
#[command(
    after_help = "Without --scene three volumes are made in memory: mandelbulb, shells, and four channels in \
    one place. Each run begins with nothing loaded, and waits for what it asks, so that counts repeat.\nA \
    factor of 1 means that every brick was loaded once. Ends with 5 when a guarded picture did not end."
)]
pub struct Arguments {
    /// Draw this scene's first view instead; may be given more than once.
    #[arg(long, value_name = "FILE")]
    scene: Vec<PathBuf>,
    /// Voxels along each axis of the volumes in memory.
    #[arg(long, default_value_t = 256, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(8..=1024))]
    edge: u32,
    /// Voxels of their bricks along each axis.
    #[arg(long, default_value_t = 16, value_name = "VOXELS",
          value_parser = clap::value_parser!(u32).range(4..=128))]
    payload: u32,
    /// Picture size in pixels, across x down; default: 256x256, and what each --scene says.
    #[arg(long, value_name = "WxH", value_parser = pixels)]
    size: Option<[u32; 2]>,
    /// Slots of each atlas, any number of sizes; all: as many as there are bricks, or --scene's atlas_mib
    /// holds.
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = slots,
          default_value = "8,16,32,64,128,256,all")]
    slots: Vec<Slots>,
    /// Order of loading: guarded, papers; may be given more than once.
    #[arg(long, value_name = "ORDER", value_delimiter = ',', value_parser = order,
          default_value = "guarded,papers")]
    order: Vec<LoadOrder>,
    /// Runs of which the median time counts; one more warms up.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Also write paging.csv and paging.svg into this folder, which is made.
    #[arg(short, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    measuring: MeasuringFlags,
}

/// Slots of an atlas; nothing: all.
#[derive(Clone, Copy)]
struct Slots(Option<u32>);

/// Measures, prints and writes.
pub fn run(arguments: &Arguments) -> Result<()> {
    let cases = cases(arguments)?;
    if let Some(folder) = &arguments.output {
        make_folder(folder)?;
    }
    let effort = Effort {
        slots: arguments.slots.iter().map(|slots| slots.0).collect(),
        orders: arguments.order.clone(),
        repeats: arguments.repeats,
    };
    let table = arguments.measuring.measure_under_bar(
        "bench paging",
        |gpu, compiler, progress| {
            let table = measure(gpu, compiler, &cases, &effort, progress)?;
            if let Some(folder) = &arguments.output {
                write(&folder.join("paging.csv"), &csv(&table))?;
                write(&folder.join("paging.svg"), &chart(&table))?;
            }
            Ok(table)
        },
        describe,
    )?;
    unless_unended(&table)
}

fn cases(arguments: &Arguments) -> Result<Vec<Case>> {
    let Arguments { edge, payload, size, .. } = *arguments;
    if !arguments.scene.is_empty() {
        let overrides = Overrides { size, ..Overrides::default() };
        let load = |path: &PathBuf| {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            Ok(Case { name, data: load_scene(path, &overrides)? })
        };
        return arguments.scene.iter().map(load).collect();
    }
    let overrides = Overrides { size: size.or(Some([256, 256])), ..Overrides::default() };
    let case = |name: &str, data| Case { name: name.to_owned(), data };
    Ok(vec![
        case("mandelbulb", cloud("mandelbulb", edge, payload, &overrides)?),
        case("shells", cloud("shells", edge, payload, &overrides)?),
        case("4 channels", four_channels(edge, payload, &overrides)?),
    ])
}

fn describe(table: &ReloadTable) -> Result<()> {
    print(format_args!(
        "{} ({})\n{} time, medians of {}; factor: bricks uploaded over bricks needed\n\n{:<14} {:<8} {:>6} {:>8} {:>8} {:>7} {:>7} {:>9} {:>17}\n",
        table.device,
        table.driver,
        table.clock,
        table.repeats,
        "scene",
        "order",
        "slots",
        "needed",
        "uploaded",
        "factor",
        "rounds",
        "ms",
        "least to most",
    ))?;
    for row in &table.rows {
        let ms = row.ms.map_or(["-".to_owned(), String::new()], |ms| {
            [format!("{:.0}", ms.median), format!("{:.0} to {:.0}", ms.least, ms.most)]
        });
        let factor = row.factor.filter(|_| row.converged);
        print(format_args!(
            "{:<14} {:<8} {:>6} {:>8} {:>8} {:>7} {:>7} {:>9} {:>17}{}\n",
            row.scene,
            row.order,
            row.slots,
            row.bricks_needed,
            row.bricks_uploaded,
            factor.map_or("-".to_owned(), |factor| format!("{factor:.3}")),
            row.rounds,
            ms[0],
            ms[1],
            row.never_ends.as_ref().map(|why| format!("  never ends ({why})")).unwrap_or_default(),
        ))?;
    }
    Ok(())
}

/// One column per scene, one line per order: factor, rounds, time.
fn chart(table: &ReloadTable) -> String {
    let mut scenes: Vec<&str> = Vec::new();
    for row in &table.rows {
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
    }
    type Value = fn(&ReloadRow) -> Option<f64>;
    let values: [(&str, Value); 3] = [
        ("uploaded over needed", |row| row.factor),
        ("rounds", |row| Some(row.rounds as f64)),
        ("ms", |row| row.ms.map(|ms| ms.median)),
    ];
    let mut panels = Vec::new();
    for (label, value) in values {
        for scene in &scenes {
            let of_order = |order: LoadOrder| {
                let name = order_name(order).to_owned();
                let rows = table.rows.iter().filter(|row| row.slots > 0 && row.scene == **scene);
                let points = rows
                    .filter(|row| row.order == name)
                    .map(|row| (row.slots as f64, value(row).filter(|_| row.converged)))
                    .collect();
                Series { name, points, ..Series::default() }
            };
            let orders = [LoadOrder::Guarded, LoadOrder::Papers];
            let series = orders.map(of_order).into_iter().filter(|s| !s.points.is_empty());
            panels.push(Panel {
                title: (*scene).to_owned(),
                y_label: label.to_owned(),
                series: series.collect(),
                ..Panel::default()
            });
        }
    }
    let title = format!("ashfall bench paging, {} time, {}", table.clock, table.device);
    svg(&title, "slots of the atlas", "never ends", scenes.len(), &panels)
}

/// The loop promises to end in the order that ashfall loads by.
fn unless_unended(table: &ReloadTable) -> Result<()> {
    let guarded = order_name(LoadOrder::Guarded);
    let unended =
        table.rows.iter().find(|row| row.order == guarded && row.slots > 0 && !row.converged);
    match unended {
        None => Ok(()),
        Some(row) => Err(Error {
            exit: Exit::Incomplete,
            message: format!(
                "{} with {} slots did not end: {}",
                row.scene,
                row.slots,
                row.never_ends.as_deref().unwrap_or("rays wait")
            ),
        }),
    }
}

fn slots(text: &str) -> std::result::Result<Slots, String> {
    match text {
        "all" => Ok(Slots(None)),
        _ => match text.parse() {
            Ok(count) if count > 0 => Ok(Slots(Some(count))),
            _ => Err("expected a number above 0, or all".to_owned()),
        },
    }
}

fn order(text: &str) -> std::result::Result<LoadOrder, String> {
    let orders = [LoadOrder::Guarded, LoadOrder::Papers];
    let known = orders.into_iter().find(|order| order_name(*order) == text);
    known.ok_or_else(|| "expected guarded or papers".to_owned())
}
