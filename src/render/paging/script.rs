//! Who writes a run down, or does a written one again, beside the loop.
//!
//! Replayed on the device and driver that it was recorded on, a run must go the same way: whatever a round
//! reports otherwise is an error. Elsewhere, rays may part from it by rounding. There arrivals and evictions are
//! forced: the loop goes by the recorded reports, and the device, which is granted nothing, learns from updates
//! what was given up. The cache is then the same round by round, and pictures differ by what rays do alone.

use std::collections::{HashMap, HashSet, VecDeque};

use serde::Serialize;
use xxhash_rust::xxh3::xxh3_64;

use crate::error::{Error, Result};
use crate::loading::{Block, Delivery, Wish};
use crate::render::paging::recording::{Event, RecordedReport, Recording, Stopped};
use crate::residency::{AtlasPlan, Report};
use crate::twins::cache::entry;
use crate::twins::limits::{ENTRY_UNMAPPED, OWNER_FREE, OWNER_GRANTED};
use crate::twins::publish::Update;
use crate::volume::BrickId;

/// Bricks that loaders are asked for before their turn comes, at most.
const AHEAD: usize = 64;

/// See the module.
pub enum Script {
    /// It is written down.
    Record(Recording),
    /// It is done again.
    Replay(Replay),
}

/// A run that is done again.
pub struct Replay {
    events: VecDeque<Event>,
    forced: bool,
    /// Read before their turn.
    early_bricks: HashMap<BrickId, Delivery>,
    early_surveys: HashMap<Block, Delivery>,
    /// Entry and slot of bricks that the last report's grants gave up, where they are forced.
    evicted: Vec<(u32, u32)>,
    /// Rays that wait here after the last round.
    pub waiting_here: u32,
    /// Whether the octree marches the round, as it did.
    pub octree: bool,
    told: Replayed,
}

/// What became of a replay so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Replayed {
    /// Arrivals and evictions were forced on a device or driver that it was not recorded on.
    pub forced: bool,
    /// Rounds done again.
    pub rounds: u64,
    /// Rounds' pictures that were compared, and finished ones.
    pub pictures: u64,
    /// Of them with the bytes that were recorded.
    pub pictures_same: u64,
    /// Things recorded that were not done again yet.
    pub left: u64,
}

/// What a picture's bytes are known by.
pub fn digest(pixels: &[[f32; 4]]) -> String {
    format!("{:016x}", xxh3_64(bytemuck::cast_slice(pixels)))
}

impl Replay {
    pub fn new(recording: Recording, forced: bool) -> Replay {
        Replay {
            events: recording.events.into(),
            forced,
            early_bricks: HashMap::new(),
            early_surveys: HashMap::new(),
            evicted: Vec::new(),
            waiting_here: 0,
            octree: false,
            told: Replayed { forced, ..Replayed::default() },
        }
    }

    pub fn is_forced(&self) -> bool {
        self.forced
    }

    pub fn told(&self) -> Replayed {
        Replayed { left: self.events.len() as u64, ..self.told }
    }

    /// What happens next, if it is an arrival or what the host makes of some.
    pub fn next_arrival(&mut self) -> Option<Event> {
        let is_arrival = matches!(
            self.events.front()?,
            Event::Surveyed(_) | Event::Brick(_) | Event::Failed(..) | Event::Turn | Event::GaveUp
        );
        if is_arrival { self.events.pop_front() } else { None }
    }

    /// Why the tile's loop ended, if that is what happens next.
    pub fn take_end(&mut self) -> Option<Option<Stopped>> {
        let Event::Ended(stopped) = *self.events.front()? else { return None };
        self.events.pop_front();
        Some(stopped)
    }

    /// What happens next, whatever it is, for `expected`.
    ///
    /// # Errors
    /// Exit code 6 when nothing is left.
    pub fn next(&mut self, expected: &str) -> Result<Event> {
        self.events
            .pop_front()
            .ok_or_else(|| self.apart(&format!("the recording ends where {expected} is expected")))
    }

    /// The way parts from the recording.
    pub fn apart(&self, how: &str) -> Error {
        Error::difference(format!(
            "--replay: round {} goes another way than recorded: {how}; --replay-forced follows the recording all the same",
            self.told.rounds
        ))
    }

    /// The recording says what cannot have happened.
    pub fn damaged(&self) -> Error {
        Error::input(format!(
            "--replay: the recording is damaged after round {}: record the run anew",
            self.told.rounds
        ))
    }

    /// Bricks to ask loaders for: those that come next and are not here.
    pub fn upcoming(&self) -> Vec<Wish> {
        let bricks = self.events.iter().filter_map(|event| match event {
            Event::Brick(brick) => brick.id(),
            _ => None,
        });
        let bricks = bricks.take(AHEAD).filter(|id| !self.early_bricks.contains_key(id));
        bricks.enumerate().map(|(rank, id)| Wish { id, rank: rank as u64 }).collect()
    }

    pub fn take_early_brick(&mut self, id: BrickId) -> Option<Delivery> {
        self.early_bricks.remove(&id)
    }

    pub fn take_early_survey(&mut self, block: Block) -> Option<Delivery> {
        self.early_surveys.remove(&block)
    }

    /// Came before its turn.
    pub fn keep(&mut self, delivery: Delivery) {
        match &delivery {
            Delivery::Brick { id, .. } => _ = self.early_bricks.insert(*id, delivery),
            Delivery::Surveyed { block, .. } => _ = self.early_surveys.insert(*block, delivery),
            // Whether it counts is told when its turn comes: it is read again then.
            Delivery::Failed { .. } => {}
        }
    }

    /// Blocks of samples in each dispatch of the round that comes next.
    pub fn blocks(&self) -> Result<u32> {
        match self.events.front() {
            Some(Event::Round(_, _, blocks)) if *blocks > 0 => Ok(*blocks),
            _ => Err(self.apart("a round begins where another thing happened")),
        }
    }

    /// A round is submitted with so many updates.
    pub fn round(&mut self, updates: usize) -> Result<()> {
        let Event::Round(octree, recorded, _) = self.next("a round")? else {
            return Err(self.apart("a round begins where another thing happened"));
        };
        self.told.rounds += 1;
        self.octree = octree;
        if recorded as usize != updates {
            return Err(self.apart(&format!("{updates} entries change where {recorded} did")));
        }
        Ok(())
    }

    /// What the loop goes by after a round that reported this.
    pub fn report(&mut self, here: Report, atlases: &[AtlasPlan]) -> Result<Report> {
        let Event::Report(recorded) = self.next("a round's report")? else {
            return Err(self.apart("a round ends where another thing happened"));
        };
        if !recorded.fits(atlases) {
            return Err(self.damaged());
        }
        self.waiting_here = here.progress.waiting;
        if self.forced {
            return Ok(recorded.report(here.bytes));
        }
        match recorded.unlike(&RecordedReport::from(&here)) {
            Some(how) => Err(self.apart(&how)),
            None => Ok(here),
        }
    }

    /// The device is told, with the next round, that these slots are granted and, where there is one, that the
    /// entry's brick is given up.
    pub fn evict(&mut self, slots: impl Iterator<Item = (Option<u32>, u32)>) {
        if self.forced {
            let entry = |(entry, slot): (Option<u32>, u32)| (entry.unwrap_or(OWNER_FREE), slot);
            self.evicted.extend(slots.map(entry));
        }
    }

    /// Adds what was given up to a round's updates, of which there may be `most`.
    pub fn add_evicted(&mut self, updates: &mut Vec<Update>, most: usize) -> Result<()> {
        // What the host says of an entry or slot since then counts.
        let entries: HashSet<u32> = updates.iter().map(|update| update.entry).collect();
        let slots: HashSet<u32> = updates.iter().map(|update| update.slot).collect();
        let unless = |said: &HashSet<u32>, of| if said.contains(&of) { OWNER_FREE } else { of };
        for (number, slot) in std::mem::take(&mut self.evicted) {
            let update = Update {
                entry: unless(&entries, number),
                value: entry(ENTRY_UNMAPPED, 0),
                slot: unless(&slots, slot),
                owner: OWNER_GRANTED,
            };
            if update.entry == OWNER_FREE && update.slot == OWNER_FREE {
                continue;
            }
            if updates.len() == most {
                return Err(Error::machine(
                    "--replay: a round changes more entries than there is room for where evictions are forced: replay it where it was recorded",
                ));
            }
            updates.push(update);
        }
        Ok(())
    }

    /// A picture whose digest was recorded.
    pub fn picture(&mut self, recorded: &str, pixels: &[[f32; 4]]) {
        self.told.pictures += 1;
        self.told.pictures_same += u64::from(recorded == digest(pixels));
    }
}
