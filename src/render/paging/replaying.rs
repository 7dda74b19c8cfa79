//! Where the loop writes a run down, and where it goes by a written one; nothing else where there is no script.

use std::time::{Duration, Instant};

use xxhash_rust::xxh3::xxh3_64;

use crate::error::{Error, Exit, Result};
use crate::loading::{Block, Delivery, Wish};
use crate::render::paging::paged::Paged;
use crate::render::paging::recording::{Event, RecordedOf, RecordedReport, Recording, Stopped};
use crate::render::paging::rounds::Rounds;
use crate::render::paging::script::{Replay, Replayed, Script, digest};
use crate::render::paging::traversal_choice::Way as Marches;
use crate::render::plan::Plan;
use crate::render::renderer::{Renderer, Way};
use crate::render::scene_data::SceneData;
use crate::render::statistics::Unfinished;
use crate::render::submit_bound::Portion;
use crate::residency::Report;
use crate::twins::publish::Update;
use crate::volume::BrickId;

impl Renderer {
    /// From now on what is drawn is written down, until [`Renderer::recording`]. `data` is what is drawn.
    ///
    /// # Errors
    /// Exit code 2 where nothing is paged.
    pub fn record(&mut self, data: &SceneData) -> Result<()> {
        let of = recorded_of(&self.plan, data)?;
        if self.plan.settings.paging.frame_us.is_some() {
            return Err(Error::arguments(
                "--record: rounds with a target go by the clock, which a recording does not hold: leave --frame-ms out",
            ));
        }
        let (device, driver) = (self.plan.device.clone(), self.plan.driver.clone());
        self.paged()?.script = Some(Script::Record(Recording::new(device, driver, of)));
        Ok(())
    }

    /// What was written down.
    ///
    /// # Errors
    /// Exit code 2 where nothing was.
    pub fn recording(&mut self) -> Result<Recording> {
        match self.paged()?.script.take() {
            Some(Script::Record(recording)) => Ok(recording),
            _ => Err(Error::arguments("--record: nothing is written down")),
        }
    }

    /// From now on what is drawn goes by a recording, of which the views are drawn in the order in which they
    /// were. Where device or driver are others than it was recorded on, or with `forced`, arrivals and evictions
    /// are forced.
    ///
    /// # Errors
    /// Exit code 2 where nothing is paged; 3 where it was recorded of another thing.
    pub fn replay(&mut self, recording: Recording, data: &SceneData, forced: bool) -> Result<()> {
        let here = recorded_of(&self.plan, data)?;
        if let Some(how) = recording.of.unlike(&here) {
            return Err(Error::input(format!("--replay: {how}")));
        }
        let elsewhere =
            recording.device != self.plan.device || recording.driver != self.plan.driver;
        self.paged()?.script = Some(Script::Replay(Replay::new(recording, forced || elsewhere)));
        Ok(())
    }

    /// What became of the replay so far; nothing where there is none.
    pub fn replayed(&self) -> Option<Replayed> {
        match &self.way {
            Way::Paged(Some(paged)) => match &paged.script {
                Some(Script::Replay(replay)) => Some(replay.told()),
                _ => None,
            },
            _ => None,
        }
    }

    fn paged(&mut self) -> Result<&mut Paged> {
        match &mut self.way {
            Way::Paged(Some(paged)) => Ok(paged),
            _ => Err(nothing_paged()),
        }
    }
}

fn nothing_paged() -> Error {
    Error::arguments(
        "--record, --replay: the volume is drawn directly and nothing is paged: add --addressing paged",
    )
}

fn recorded_of(plan: &Plan, data: &SceneData) -> Result<RecordedOf> {
    let Some(paging) = &plan.paging else {
        return Err(nothing_paged());
    };
    let scene = data.scene.to_toml(std::path::Path::new("."));
    let slots = paging.residency.atlases.iter().map(|atlas| atlas.layout.slot_count());
    Ok(RecordedOf {
        scene: format!("{:016x}", xxh3_64(scene.as_bytes())),
        atlas_slots: slots.collect(),
        entries: paging.residency.entries(),
        staging_half_bytes: paging.staging_half_bytes,
        tile: plan.tile,
        blocks_per_dispatch: plan.blocks_per_dispatch(),
        lockstep: plan.settings.paging.lockstep,
    })
}

impl Event {
    pub fn of_delivery(delivery: &Delivery) -> Event {
        match delivery {
            Delivery::Surveyed { block, .. } => Event::Surveyed((*block).into()),
            Delivery::Brick { id, .. } => Event::Brick((*id).into()),
            Delivery::Failed { id, why } => {
                Event::Failed((*id).into(), why.exit as u8, why.message.clone())
            }
        }
    }
}

impl Paged {
    /// What the next round publishes.
    pub(super) fn next_updates(&mut self, view: u32, blocks: u32) -> Result<Vec<Update>> {
        let most = self.plan.residency.updates_max as usize;
        let octree = self.way(view) == Some(Marches::Octree);
        let mut updates = self.host.take_updates(most);
        match &mut self.script {
            None => {}
            Some(Script::Record(recording)) => {
                recording.push(Event::Round(octree, updates.len() as u32, blocks))?;
            }
            Some(Script::Replay(replay)) => {
                replay.round(updates.len())?;
                replay.add_evicted(&mut updates, most)?;
            }
        }
        Ok(updates)
    }

    /// A view's picture is finished.
    pub(in crate::render) fn script_picture(&mut self, pixels: &[[f32; 4]]) -> Result<()> {
        match &mut self.script {
            None => {}
            Some(Script::Record(recording)) => recording.push(Event::Picture(digest(pixels)))?,
            Some(Script::Replay(replay)) => match replay.next("a picture")? {
                Event::Picture(recorded) => replay.picture(&recorded, pixels),
                _ => return Err(replay.apart("a picture is finished where another thing happened")),
            },
        }
        Ok(())
    }
}

impl Rounds<'_, '_> {
    pub(super) fn has_script(&self) -> bool {
        self.paged.script.is_some()
    }

    pub(super) fn is_replay(&self) -> bool {
        matches!(self.paged.script, Some(Script::Replay(_)))
    }

    pub(super) fn is_forced(&self) -> bool {
        matches!(&self.paged.script, Some(Script::Replay(replay)) if replay.is_forced())
    }

    /// What marches the next round: as it did, where it is replayed, since reports count by dispatches.
    pub(super) fn portion(&mut self) -> Result<Portion> {
        let plan = &self.renderer.plan;
        let portion = self.renderer.submit_bound.portion(plan);
        let Some(Script::Replay(replay)) = &self.paged.script else { return Ok(portion) };
        let blocks = replay.blocks()?.min(plan.blocks_per_dispatch());
        self.renderer.submit_bound.submits(blocks);
        let all = plan.blocks_per_dispatch().saturating_mul(plan.march_dispatches());
        Ok(Portion { blocks, dispatches: all.div_ceil(blocks), ..portion })
    }

    /// Writes down what happened, where that is done.
    pub(super) fn script(&mut self, event: impl FnOnce() -> Event) -> Result<()> {
        match &mut self.paged.script {
            Some(Script::Record(recording)) => recording.push(event()),
            _ => Ok(()),
        }
    }

    /// What is replayed; one who asks knows that something is.
    fn replay(&mut self) -> &mut Replay {
        match &mut self.paged.script {
            Some(Script::Replay(replay)) => replay,
            _ => unreachable!("asked for where nothing is replayed"),
        }
    }

    /// The same happens as was recorded, or the way parts; it is written down where that is done.
    fn same(&mut self, event: Event, what: &str) -> Result<()> {
        if !self.is_replay() {
            return self.script(|| event);
        }
        let replay = self.replay();
        if replay.next(what)? == event {
            return Ok(());
        }
        Err(replay.apart(&format!("{what} comes where another thing happened")))
    }

    /// A tile begins.
    pub(super) fn script_tile(&mut self) -> Result<()> {
        self.same(Event::Tile(self.tile.view, self.tile.origin_pixel), "another tile")
    }

    /// Slots are kept for what a report asked for.
    pub(super) fn script_bound(&mut self) -> Result<()> {
        self.same(Event::Bound, "the keeping of slots")
    }

    /// Another scene, or another state of the source, is wanted in the midst of a picture.
    pub(super) fn script_breaks(&self) -> Result<()> {
        match self.has_script() {
            true => Err(Error::machine(
                "--record, --replay: scene or source changed in the midst of a picture, which a recording cannot tell",
            )),
            false => Ok(()),
        }
    }

    /// A round's report: written down, or the one to go by.
    pub(super) fn script_report(&mut self, report: Report) -> Result<Report> {
        if !self.has_script() {
            return Ok(report);
        }
        self.script(|| Event::Report(RecordedReport::from(&report)))?;
        let Paged { script: Some(Script::Replay(replay)), host, plan, .. } = &mut *self.paged
        else {
            return Ok(report);
        };
        let report = replay.report(report, &plan.residency.atlases)?;
        let granted = report.atlases.iter().flat_map(|atlas| &atlas.grants);
        replay.evict(granted.map(|slot| (host.entry_in(*slot), *slot)));
        Ok(report)
    }

    /// The picture of a round, where one tile holds it.
    pub(super) fn script_frame(&mut self) -> Result<()> {
        if !self.has_script() || self.renderer.plan.tiles != 1 {
            return Ok(());
        }
        let (_, pixels) = self.resolved()?;
        if !self.is_replay() {
            return self.script(|| Event::Frame(digest(&pixels)));
        }
        let replay = self.replay();
        match replay.next("a round's picture")? {
            Event::Frame(recorded) => replay.picture(&recorded, &pixels),
            _ => return Err(replay.apart("a picture is drawn where another thing happened")),
        }
        Ok(())
    }

    /// The tile's loop ends.
    pub(super) fn script_end(&mut self) -> Result<()> {
        if self.is_replay() {
            return match self.replay_stops()? {
                true => Ok(()),
                false => Err(self.replay().apart("no ray waits where some did")),
            };
        }
        let stopped = self.statistics.unfinished.and_then(|unfinished| match unfinished {
            Unfinished::Starved { bricks } => Some(Stopped::Starved(bricks)),
            Unfinished::Full { slots } => Some(Stopped::Full(slots)),
            Unfinished::Restless { rounds } => Some(Stopped::Restless(rounds)),
            Unfinished::Apart => None,
        });
        self.script(|| Event::Ended(stopped))
    }

    /// Whether the tile's loop ended here.
    pub(super) fn replay_stops(&mut self) -> Result<bool> {
        let Some(stopped) = self.replay().take_end() else { return Ok(false) };
        let waiting_here = self.replay().waiting_here;
        self.statistics.unfinished = match stopped {
            Some(Stopped::Starved(bricks)) => Some(Unfinished::Starved { bricks }),
            Some(Stopped::Full(slots)) => Some(Unfinished::Full { slots }),
            Some(Stopped::Restless(rounds)) => Some(Unfinished::Restless { rounds }),
            None if waiting_here > 0 && self.statistics.rays_waiting == 0 => {
                Some(Unfinished::Apart)
            }
            None => None,
        };
        self.statistics.rays_waiting = waiting_here.into();
        Ok(true)
    }

    /// Takes what came, in the order in which it came, up to the next thing that the loop does itself.
    pub(super) fn replay_arrivals(&mut self) -> Result<()> {
        while let Some(event) = self.replay().next_arrival() {
            match event {
                Event::Turn => {
                    self.flush()?;
                    self.bind_and_wish();
                }
                Event::GaveUp => self.give_up(),
                Event::Failed(brick, exit, message) => {
                    let id = brick.id().ok_or_else(|| self.replay().damaged())?;
                    let why = Error { exit: exit_of(exit), message };
                    self.take(Delivery::Failed { id, why })?;
                }
                Event::Surveyed(first) => {
                    let id = first.id().filter(|id| self.paged.description.has(*id));
                    let id = id.ok_or_else(|| self.replay().damaged())?;
                    let block = Block::of(id);
                    let delivery = self.fetch(|replay| replay.take_early_survey(block))?;
                    self.take(delivery)?;
                }
                Event::Brick(brick) => {
                    let id = brick.id().filter(|id| self.paged.description.has(*id));
                    let id = id.ok_or_else(|| self.replay().damaged())?;
                    let delivery = match self.replay().take_early_brick(id) {
                        Some(delivery) => delivery,
                        None => self.fetch_brick(id)?,
                    };
                    self.take(delivery)?;
                }
                _ => unreachable!("no arrival"),
            }
        }
        Ok(())
    }

    fn fetch_brick(&mut self, id: BrickId) -> Result<Delivery> {
        let mut wishes = vec![Wish { id, rank: 0 }];
        let later = self.replay().upcoming();
        wishes.extend(later.into_iter().map(|wish| Wish { rank: wish.rank + 1, ..wish }));
        self.paged.loading.wish(&wishes);
        self.fetch(|replay| replay.take_early_brick(id))
    }

    /// Waits until what is looked for has come; what else comes is kept until its turn.
    fn fetch(&mut self, found: impl Fn(&mut Replay) -> Option<Delivery>) -> Result<Delivery> {
        let begun = Instant::now();
        loop {
            if let Some(delivery) = found(self.replay()) {
                return Ok(delivery);
            }
            match self.paged.loading.next(Duration::from_millis(50)) {
                Some(Delivery::Failed { id, why }) => {
                    let message = format!(
                        "--replay: {id} came when the run was recorded and cannot be read now: {}",
                        why.message
                    );
                    return Err(Error { exit: why.exit, message });
                }
                Some(delivery) => {
                    self.paged.trace_loading();
                    self.replay().keep(delivery);
                }
                None if self.paged.loading.outstanding() == 0
                    || begun.elapsed() > self.renderer.plan.settings.paging.patience =>
                {
                    return Err(Error::machine(
                        "--replay: what came when the run was recorded does not come now: see to the source",
                    ));
                }
                None => {}
            }
        }
    }
}

fn exit_of(number: u8) -> Exit {
    [Exit::Bug, Exit::Arguments, Exit::Machine, Exit::Incomplete, Exit::Difference]
        .into_iter()
        .find(|exit| *exit as u8 == number)
        .unwrap_or(Exit::Input)
}
