//! How often bricks are loaded again where the atlas does not hold all that a picture needs.
//!
//! # Invariants
//! Every run begins with an empty device and an empty RAM cache, and waits for what it asks: counts
//! repeat, times do not.

use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Exit, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::render::paging::{LoadOrder, PagingSettings};
use crate::render::{Addressing, Plan, Renderer, SceneData, Settings, Statistics};
use crate::study::repeated::{Spread, Timer};

/// A scene and what it is called in tables.
pub struct Case {
    /// The name.
    pub name: String,
    /// Its first view is drawn.
    pub data: SceneData,
}

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Slots of each atlas; nothing: as many as `atlas_mib` holds, at most all bricks.
    pub slots: Vec<Option<u32>>,
    /// Which orders of loading.
    pub orders: Vec<LoadOrder>,
    /// Turns that count.
    pub repeats: u32,
}

/// One scene through atlases of one size, in one order.
#[derive(Clone, Debug, Serialize)]
pub struct ReloadRow {
    /// The scene.
    pub scene: String,
    /// "guarded" or "papers".
    pub order: &'static str,
    /// Slots of all atlases together; 0 where they were refused.
    pub slots: u64,
    /// Different bricks that rays went through in slots.
    pub bricks_needed: u64,
    /// Bricks that were copied to the device.
    pub bricks_uploaded: u64,
    /// Uploaded over needed.
    pub factor: Option<f64>,
    /// Rounds until no ray waited, or until it was given up.
    pub rounds: u64,
    /// Until the picture was there or given up, by the table's clock.
    pub ms: Option<Spread>,
    /// Whether no ray waits.
    pub converged: bool,
    /// Why the picture never ends or was refused, where it was.
    pub never_ends: Option<String>,
    /// Whether every turn counted the same bricks and rounds.
    pub repeats_agree: bool,
}

/// All rows, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct ReloadTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "wall".
    pub clock: &'static str,
    /// Turns that count.
    pub repeats: u32,
    /// By scene, order and slots.
    pub rows: Vec<ReloadRow>,
}

/// The word for an order in flags and tables.
pub const fn order_name(order: LoadOrder) -> &'static str {
    match order {
        LoadOrder::Guarded => "guarded",
        LoadOrder::Papers => "papers",
    }
}

/// Measures every scene; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device runs out of memory or is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    cases: &[Case],
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<ReloadTable> {
    let bench = Bench { gpu, compiler, timer: Timer::of(gpu), repeats: effort.repeats };
    let runs = (cases.len() * effort.orders.len() * effort.slots.len()) as f64;
    let mut rows: Vec<ReloadRow> = Vec::new();
    let mut done = 0.0;
    for case in cases {
        for order in &effort.orders {
            let first = rows.len();
            for slots in &effort.slots {
                let row = bench.row(case, *order, *slots)?;
                // More slots than bricks are no other atlas.
                if row.slots == 0 || rows[first..].iter().all(|known| known.slots != row.slots) {
                    rows.push(row);
                }
                done += 1.0;
                progress(done / runs);
            }
        }
    }
    Ok(ReloadTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: bench.timer.name("wall"),
        repeats: effort.repeats,
        rows,
    })
}

struct Bench<'a> {
    gpu: &'a Arc<Gpu>,
    compiler: &'a ShaderCompiler,
    timer: Timer,
    repeats: u32,
}

impl Bench<'_> {
    fn row(&self, case: &Case, order: LoadOrder, slots: Option<u32>) -> Result<ReloadRow> {
        let paging = PagingSettings { atlas_slots: slots, order, ..PagingSettings::default() };
        let settings = Settings { addressing: Addressing::Paged, paging, ..Settings::default() };
        let settings = settings.checked()?;
        let mut row = ReloadRow {
            scene: case.name.clone(),
            order: order_name(order),
            slots: 0,
            bricks_needed: 0,
            bricks_uploaded: 0,
            factor: None,
            rounds: 0,
            ms: None,
            converged: false,
            never_ends: None,
            repeats_agree: true,
        };
        let (mut times, mut known) = (Vec::new(), None);
        for turn in 0..=self.repeats {
            let plan = match Plan::new(self.gpu, self.compiler, &case.data, &settings) {
                // An atlas too small for the scene is part of the answer.
                Err(Error { exit: Exit::Arguments | Exit::Input, message }) => {
                    row.never_ends = Some(message);
                    return Ok(row);
                }
                plan => plan?,
            };
            row.slots = slots_of(&plan, &case.data);
            let mut renderer = Renderer::new(self.gpu, plan, &case.data)?;
            let ((_, statistics), took) = self.timer.time(|| renderer.draw(0, &mut |_| {}))?;
            if turn > 0 || !statistics.converged {
                times.push(took.ms);
            }
            let counts = counts(&statistics);
            row.repeats_agree &= known.replace(counts).is_none_or(|before| before == counts);
            [row.bricks_needed, row.bricks_uploaded, row.rounds] = counts;
            row.converged = statistics.converged;
            row.never_ends = never_ends(&statistics);
            if !row.converged {
                break;
            }
        }
        row.factor =
            (row.bricks_needed > 0).then(|| row.bricks_uploaded as f64 / row.bricks_needed as f64);
        row.ms = Some(Spread::of(&times));
        Ok(row)
    }
}

fn counts(statistics: &Statistics) -> [u64; 3] {
    [statistics.bricks_needed, statistics.bricks_uploaded, statistics.rounds]
}

fn never_ends(statistics: &Statistics) -> Option<String> {
    let why = statistics.unfinished.as_ref().map(ToString::to_string);
    let unknown = || format!("{} rays wait", statistics.rays_waiting);
    (!statistics.converged).then(|| why.unwrap_or_else(unknown))
}

/// Slots of all atlases of a plan together.
pub(super) fn slots_of(plan: &Plan, data: &SceneData) -> u64 {
    let description = data.volumes[0].source.description();
    let (_, slot) = description.brick(description.brick_largest());
    let slot = slot.to_array();
    let of_image =
        |size: [u32; 3]| -> u64 { (0..3).map(|axis| u64::from(size[axis] / slot[axis])).product() };
    plan.images.iter().map(|image| of_image(image.size)).sum()
}

/// The rows as comma-separated values, with a line of names.
pub fn csv(table: &ReloadTable) -> String {
    let mut text = String::from(
        "scene,order,slots,bricks_needed,bricks_uploaded,factor,rounds,ms,ms_least,ms_most,converged,never_ends\n",
    );
    let quoted = |words: &str| format!("\"{}\"", words.replace('"', "\"\""));
    for row in &table.rows {
        let ms = row.ms.map(|ms| [ms.median, ms.least, ms.most].map(|ms| format!("{ms:.3}")));
        text += &format!(
            "{},{},{},{},{},{},{},{},{},{}\n",
            quoted(&row.scene),
            row.order,
            row.slots,
            row.bricks_needed,
            row.bricks_uploaded,
            row.factor.map(|factor| format!("{factor:.4}")).unwrap_or_default(),
            row.rounds,
            ms.unwrap_or_default().join(","),
            row.converged,
            row.never_ends.as_deref().map(quoted).unwrap_or_default(),
        );
    }
    text
}
