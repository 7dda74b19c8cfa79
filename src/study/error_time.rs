//! Error against run time: every setting of a sweep is drawn several times and compared with the truth.
//!
//! # Invariants
//! A finished measurement is in the journal before the next one begins. The truth is a file beside it.
//!
//! # Units
//! Milliseconds; linear values with peak 1. `ms` counts processor time of this process where the device
//! is a CPU and the system tells, since other work on the machine does not change that; else the wall's.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use crate::error::{Error, Exit, Result};
use crate::gpu::{Gpu, ShaderCompiler};
use crate::reference::{self, Truth, VolumeLevel};
use crate::render::paging::{BrickNumbers, LevelChoice, PagingSettings, ViewLevels};
use crate::render::{Addressing, Renderer, SceneData, Settings, Statistics};
use crate::scene::Refine;
use crate::study::figures::Figures;
use crate::study::journal::{Entry, Journal, Subject};
use crate::study::layout_price;
use crate::study::reload::slots_of;
use crate::study::repeated::{Spread, Timer};
use crate::study::sweep::{Axes, Axis, Setting, settings};
use crate::study::truth_file;
use crate::volume::BrickId;

/// How much is measured, and how.
#[derive(Clone, Debug)]
pub struct Effort {
    /// The scene's own setting, at level 0.
    pub base: Setting,
    /// What is swept.
    pub axes: Axes,
    /// Runs that count; one more comes before them.
    pub repeats: u32,
    /// Greatest absolute error of a pixel of the reference.
    pub error_max: f64,
    /// Threads that integrate the reference.
    pub threads: usize,
    /// Bricks that a round brings while refinement by substitution is measured; nothing: it is not.
    pub streaming: Option<u32>,
    /// How pictures are drawn, beside the setting.
    pub work: Settings,
}

/// Who hears how far a study is.
pub trait Watcher: Sync {
    /// The reference of a level is finished to a part, 0 to 1.
    fn integrates(&self, level: u8, part: f64);
    /// So many of all settings are done, and this one is next.
    fn measures(&self, done: usize, all: usize, key: &str);
}

/// What came of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Figures.
    Measured(Box<Measurement>),
    /// It cannot be drawn, and why: an atlas too small, for one.
    Refused(String),
}

/// Figures of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// "direct" or "paged".
    pub addressing: String,
    /// By the study's clock.
    pub ms: Spread,
    /// On the wall, from the first recording to the picture in host memory.
    pub wall_ms: Spread,
    /// On the device, over all passes; nothing where it has no timestamps.
    pub gpu_ms: Option<Spread>,
    /// Samples over all rays.
    pub samples: u64,
    /// Rounds of the paging loop; 1 where nothing is paged.
    pub rounds: u64,
    /// Different bricks that rays went through in slots.
    pub bricks_needed: u64,
    /// Bricks that were copied to the device.
    pub bricks_uploaded: u64,
    /// Bytes of them.
    pub bytes_uploaded: u64,
    /// Of all atlases together; 0 where nothing is paged.
    pub slots: u64,
    /// Device memory allocated, bytes.
    pub device_bytes: u64,
    /// Against the reference of level 0.
    pub error: Figures,
    /// Against the reference of the level drawn, where that is one level above 0.
    pub integration: Option<Figures>,
    /// What the picture lacks, where it lacks something.
    pub incomplete: Option<String>,
}

/// Refinement by substitution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Streaming {
    /// Round by round, the last the finished picture's.
    pub rounds: Vec<StreamingRound>,
    /// Whether the last picture is the exact one.
    pub converged: bool,
    /// Why not, where it is not.
    pub incomplete: Option<String>,
}

/// A picture on the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamingRound {
    /// From 1.
    pub round: u64,
    /// On the wall, from the beginning to the round's end, without what measuring took.
    pub ms: f64,
    /// Bricks copied to the device before.
    pub bricks_uploaded: u64,
    /// Against the reference of level 0.
    pub error: Figures,
}

/// A setting and what came of it.
#[derive(Clone, Debug)]
pub struct Measured {
    /// What it was first measured for.
    pub axis: Axis,
    /// The setting.
    pub setting: Setting,
    /// What came of it.
    pub outcome: Outcome,
}

/// All that a study found.
pub struct Found {
    /// In the order of the sweep.
    pub settings: Vec<Measured>,
    /// Of each level that was drawn alone: its reference against level 0's.
    pub levels_of_detail: BTreeMap<u8, Figures>,
    /// Refinement by substitution, if asked for.
    pub streaming: Option<Streaming>,
    /// Measurements made now; the others were in the journal.
    pub measured_now: usize,
}

/// A study that is under way.
pub struct Study<'a> {
    gpu: &'a Arc<Gpu>,
    compiler: &'a ShaderCompiler,
    data: SceneData,
    effort: Effort,
    folder: PathBuf,
    journal: Journal,
    timer: Timer,
    truths: BTreeMap<u8, reference::Picture>,
    measured_now: usize,
}

/// Pixels along one side: pictures are kept in f64, and streaming takes one tile.
pub const PICTURE_EDGE_MAX: u32 = 4096;

/// Finest and coarsest level that the scene's first view uses where none is forbidden.
pub fn levels_by_footprint(data: &SceneData) -> [u8; 2] {
    let description = data.volumes[0].source.description();
    let Some(numbers) = BrickNumbers::new(description, Vec::new(), 0) else { return [0, 0] };
    let scene = &data.scene;
    let step = scene.quality.step;
    let levels = LevelChoice { step, level_min: 0, level_max: None, shift: 0 };
    let (view, size) = (&scene.views[0], scene.picture.size);
    let world_from_voxel = data.world_from_voxel(0);
    ViewLevels::new(view, size, description, &world_from_voxel, &numbers, levels)
        .in_use
        .map(|level| level as u8)
}

impl<'a> Study<'a> {
    /// Opens or begins the study of the first view of `data` in `folder`.
    ///
    /// # Errors
    /// As [`Journal::open`]; when voxels cannot be read whole (exit code 3).
    pub fn open(
        gpu: &'a Arc<Gpu>,
        compiler: &'a ShaderCompiler,
        data: SceneData,
        effort: Effort,
        folder: PathBuf,
    ) -> Result<Study<'a>> {
        let subject = Subject {
            scene_hash: format!("{:016x}", scene_hash(&data, &effort)?),
            device: gpu.facts().name.clone(),
            driver: gpu.facts().driver.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let journal = Journal::open(&folder.join("measurements.journal"), &subject)?;
        let (timer, truths) = (Timer::of(gpu), BTreeMap::new());
        Ok(Study { gpu, compiler, data, effort, folder, journal, timer, truths, measured_now: 0 })
    }

    /// Measures whatever the journal does not hold yet.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory or is lost, or the disk is full; 3 when nothing at
    /// all can be drawn, or the reference beside the journal is not as it was written.
    pub fn run(&mut self, watcher: &dyn Watcher) -> Result<Found> {
        let all = settings(&self.effort.base, &self.effort.axes);
        let count = all.len() + usize::from(self.effort.streaming.is_some());
        let mut measured: Vec<Measured> = Vec::new();
        for (axis, setting) in all {
            if axis == Axis::Atlas && measured.iter().any(|known| self.holds_all(known)) {
                continue;
            }
            let key = setting.key();
            self.truth(0, watcher)?;
            let level = setting.level().filter(|level| *level > 0);
            if let Some(level) = level {
                self.truth(level, watcher)?;
            }
            watcher.measures(measured.len(), count, &key);
            let outcome = match self.known(&key) {
                Some(outcome) => outcome,
                None => {
                    let outcome = self.measure(&setting)?;
                    let (repeats, kept) = (self.effort.repeats, outcome.clone());
                    self.journal.add(Entry::Setting { key, repeats, outcome: kept })?;
                    self.measured_now += 1;
                    outcome
                }
            };
            measured.push(Measured { axis, setting, outcome });
        }
        let refused = |measured: &Measured| match &measured.outcome {
            Outcome::Refused(why) => Some(why.clone()),
            Outcome::Measured(_) => None,
        };
        if let Some(why) = measured.first().and_then(refused)
            && measured.iter().all(|measured| refused(measured).is_some())
        {
            return Err(Error::input(why));
        }
        let streaming = match self.effort.streaming {
            Some(bricks) => Some(self.streaming(bricks, [count - 1, count], watcher)?),
            None => None,
        };
        let finest = self.truths.get(&0).map(|truth| &truth.rgba);
        let size = self.data.scene.picture.size;
        let of_level = |(level, truth): (&u8, &reference::Picture)| {
            Some((*level, Figures::of(size, &truth.rgba, finest?)))
        };
        let drawn = |level: &u8| {
            measured.iter().any(|m| m.axis == Axis::Level && m.setting.level_min == *level)
        };
        let levels = self.truths.iter().filter(|(level, _)| drawn(level)).filter_map(of_level);
        let levels_of_detail = levels.collect();
        Ok(Found {
            settings: measured,
            levels_of_detail,
            streaming,
            measured_now: self.measured_now,
        })
    }

    /// Whether this is an atlas with a slot for every brick: a larger one is no other.
    fn holds_all(&self, known: &Measured) -> bool {
        let volume = &self.data.volumes[0];
        let of_shown = |id: &BrickId| volume.channels.contains(&id.channel);
        let bricks = || volume.source.description().bricks().filter(of_shown).count() as u64;
        match &known.outcome {
            Outcome::Measured(m) => known.axis == Axis::Atlas && m.slots >= bricks(),
            Outcome::Refused(_) => false,
        }
    }

    fn known(&self, wanted: &str) -> Option<Outcome> {
        self.journal.entries().iter().rev().find_map(|entry| match entry {
            Entry::Setting { key, repeats, outcome }
                if key == wanted && *repeats == self.effort.repeats =>
            {
                Some(outcome.clone())
            }
            _ => None,
        })
    }

    /// Has the reference of a level at hand: from before, from its file, or integrated now.
    fn truth(&mut self, level: u8, watcher: &dyn Watcher) -> Result<()> {
        if self.truths.contains_key(&level) {
            return Ok(());
        }
        let file = self.folder.join(format!("reference_level_{level}.npy"));
        let size = self.data.scene.picture.size;
        let known = self.journal.entries().iter().rev().find_map(|entry| match entry {
            Entry::Reference { level: of, hash, .. } if *of == level => {
                u64::from_str_radix(hash, 16).ok()
            }
            _ => None,
        });
        let kept = known.map_or(Ok(None), |hash| truth_file::read(&file, size, hash))?;
        let truth = match kept {
            Some(truth) => truth,
            None => {
                let begun = Instant::now();
                let truth = self.integrate(level, watcher)?;
                let hash = format!("{:016x}", truth_file::write(&file, &truth)?);
                let seconds = begun.elapsed().as_secs_f64();
                self.journal.add(Entry::Reference { level, hash, seconds })?;
                truth
            }
        };
        self.truths.insert(level, truth);
        Ok(())
    }

    fn integrate(&self, level: u8, watcher: &dyn Watcher) -> Result<reference::Picture> {
        let Effort { error_max, threads, .. } = self.effort;
        let scene = &self.data.scene;
        let voxels = self.data.level(0, level)?;
        let extent_voxel = self.data.volumes[0].extent_voxel(level);
        let levels = [VolumeLevel { volume: &scene.volumes[0], voxels: &voxels, extent_voxel }];
        let (size, background) = (scene.picture.size, scene.picture.background);
        Ok(Truth::of_levels(&scene.views[0], size, background, &levels, error_max)
            .picture(threads, &|part| watcher.integrates(level, part)))
    }

    fn measure(&mut self, setting: &Setting) -> Result<Outcome> {
        let scene = &mut self.data.scene;
        scene.quality = setting.quality()?;
        scene.memory.atlas_mib = setting.atlas_mib;
        let work = Settings { level_min: setting.level_min, ..self.effort.work };
        let work = match setting.paged {
            true => Settings { addressing: Addressing::Paged, ..work },
            false => work,
        };
        let (mut renderer, mut addressing, mut slots) = (None, "", 0);
        let (mut took, mut wall_ms, mut gpu_ms) = (Vec::new(), Vec::new(), Vec::new());
        let mut last = None;
        for turn in 0..=self.effort.repeats {
            // In pages each run begins with nothing loaded.
            if addressing != "direct" {
                // The one before gives its memory back first.
                drop(renderer.take());
                let plan = match layout_price::plan(self.gpu, self.compiler, &self.data, &work) {
                    Err(Error { exit: Exit::Arguments | Exit::Input, message }) => {
                        return Ok(Outcome::Refused(message));
                    }
                    plan => plan?,
                };
                addressing = plan.addressing;
                slots = if addressing == "paged" { slots_of(&plan, &self.data) } else { 0 };
                renderer = Some(Renderer::new(self.gpu, plan, &self.data)?);
            }
            let Some(renderer) = &mut renderer else { unreachable!("made above") };
            let ((picture, statistics), time) =
                self.timer.time(|| renderer.draw(0, &mut |_| {}))?;
            let lacks = incomplete(&statistics);
            if turn > 0 || lacks.is_some() {
                took.push(time.ms);
                wall_ms.push(statistics.wall_ms);
                // The upload is not repeated, where nothing is paged.
                let passes = statistics.gpu_ms.iter().filter(|time| time.pass != "upload");
                let total: f64 = passes.map(|time| time.ms).sum();
                gpu_ms.extend((!statistics.gpu_ms.is_empty()).then_some(total));
            }
            let ends = lacks.is_some();
            last = Some((picture, statistics, lacks));
            if ends {
                break;
            }
        }
        let Some((picture, statistics, incomplete)) = last else { unreachable!("a turn was made") };
        let size = self.data.scene.picture.size;
        let against = |level: u8| {
            let truth = self.truths.get(&level)?;
            Some(Figures::of_drawn(size, &picture.pixels, &truth.rgba))
        };
        let Some(error) = against(0) else { unreachable!("the truth comes first") };
        Ok(Outcome::Measured(Box::new(Measurement {
            addressing: addressing.to_owned(),
            ms: Spread::of(&took),
            wall_ms: Spread::of(&wall_ms),
            gpu_ms: (!gpu_ms.is_empty()).then(|| Spread::of(&gpu_ms)),
            samples: statistics.samples,
            rounds: statistics.rounds,
            bricks_needed: statistics.bricks_needed,
            bricks_uploaded: statistics.bricks_uploaded,
            bytes_uploaded: statistics.bytes_uploaded,
            slots,
            device_bytes: statistics.device_bytes,
            error,
            integration: setting.level().filter(|level| *level > 0).and_then(against),
            incomplete,
        })))
    }

    fn streaming(
        &mut self,
        bricks: u32,
        [done, all]: [usize; 2],
        watcher: &dyn Watcher,
    ) -> Result<Streaming> {
        let key = format!("{}, substitute, {bricks} bricks a round", self.effort.base.key());
        watcher.measures(done, all, &key);
        let known = self.journal.entries().iter().rev().find_map(|entry| match entry {
            Entry::Streaming { key: of, streaming } if *of == key => Some(streaming.clone()),
            _ => None,
        });
        if let Some(known) = known {
            return Ok(known);
        }
        self.truth(0, watcher)?;
        let streaming = self.stream(bricks)?;
        self.journal.add(Entry::Streaming { key, streaming: streaming.clone() })?;
        self.measured_now += 1;
        Ok(streaming)
    }

    /// In lockstep, so that nothing goes on while a round's picture is measured.
    fn stream(&mut self, bricks: u32) -> Result<Streaming> {
        let scene = &mut self.data.scene;
        scene.quality = self.effort.base.quality()?;
        scene.quality.refine = Refine::Substitute;
        scene.memory.atlas_mib = self.effort.base.atlas_mib;
        let (size, data) = (scene.picture.size, &self.data);
        let paging = PagingSettings {
            lockstep: true,
            grants_per_round: Some(bricks),
            ..self.effort.work.paging
        };
        let work =
            Settings { addressing: Addressing::Paged, tile: size, paging, ..self.effort.work };
        let Some(truth) = self.truths.get(&0) else { unreachable!("the truth comes first") };
        let mut rounds: Vec<StreamingRound> = Vec::new();
        // The first time drivers compile; the second counts.
        let renderer = || -> Result<Renderer> {
            Renderer::new(self.gpu, layout_price::plan(self.gpu, self.compiler, data, &work)?, data)
        };
        match renderer().and_then(|mut renderer| renderer.draw(0, &mut |_| {})) {
            Err(Error { exit: Exit::Arguments | Exit::Input, message }) => {
                return Ok(Streaming { rounds, converged: false, incomplete: Some(message) });
            }
            drawn => _ = drawn?,
        }
        let drawn = renderer()?.draw_watched(0, &mut |seen| {
            let error = Figures::of_drawn(size, &seen.picture.pixels, &truth.rgba);
            let (round, bricks_uploaded) = (seen.round, seen.bricks_uploaded);
            rounds.push(StreamingRound { round, ms: seen.ms, bricks_uploaded, error });
            ControlFlow::Continue(())
        })?;
        let Some((_, statistics)) = drawn else { unreachable!("nobody broke off") };
        let (converged, incomplete) = (statistics.converged, incomplete(&statistics));
        Ok(Streaming { rounds, converged, incomplete })
    }
}

/// What a picture lacks, in words.
fn incomplete(statistics: &Statistics) -> Option<String> {
    let failed = || {
        (statistics.bricks_failed > 0)
            .then(|| format!("{} bricks could not be read", statistics.bricks_failed))
    };
    let waiting =
        || (!statistics.converged).then(|| format!("{} rays wait", statistics.rays_waiting));
    let unfinished = statistics.unfinished.as_ref().map(ToString::to_string);
    unfinished.or_else(failed).or_else(waiting)
}

/// Of all that a picture depends on beside the setting: view, picture, memory, volume with its voxels,
/// work, and how precise the reference is.
fn scene_hash(data: &SceneData, effort: &Effort) -> Result<u64> {
    let scene = &data.scene;
    let mut hash = Xxh3::new();
    let words = format!("{:?}", (&scene.picture, &scene.views[0], &scene.memory));
    hash.update(words.as_bytes());
    hash.update(format!("{:?}", (&effort.work, effort.error_max)).as_bytes());
    let voxels = data.whole(0)?;
    hash.update(format!("{:?}", (voxels.size, voxels.world_from_voxel.rows())).as_bytes());
    for (channel, values) in scene.volumes[0].channels.iter().zip(&voxels.channels) {
        hash.update(format!("{:?}", (channel, values.slope, values.intercept)).as_bytes());
        hash.update(values.voxels.bytes());
    }
    Ok(hash.digest())
}
