//! A run of the loop, written down: what came when, and what rounds reported. Done again, it gives the same
//! pictures, however slow disk and device are that day.
//!
//! Everything else that the loop does follows from that: the host decides by reports and arrivals alone, and
//! the device by what the host publishes. Times are not part of it.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::loading::Block;
use crate::residency::{AtlasPlan, OfAtlas, Report};
use crate::volume::BrickId;

/// Counts the file's form.
const FORMAT: u32 = 1;
/// Events kept at most: some hundred MiB.
const EVENTS_MAX: usize = 4_000_000;

/// See the module.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Recording {
    format: u32,
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// What it was recorded of.
    pub of: RecordedOf,
    /// What happened, in order.
    pub(super) events: Vec<Event>,
}

/// What a recording needs to be the same where it is replayed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedOf {
    /// Digest of the scene as it was drawn, its views and quality included.
    pub scene: String,
    /// Slots of each atlas.
    pub atlas_slots: Vec<u32>,
    /// Entries of the page table.
    pub entries: u32,
    /// Bytes of a staging half.
    pub staging_half_bytes: u64,
    /// Pixels of a tile.
    pub tile: [u32; 2],
    /// Samples of one ray in a dispatch, in blocks.
    pub blocks_per_dispatch: u32,
    /// Whether rounds waited for what they asked.
    pub lockstep: bool,
}

/// One thing that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// A tile of a view begins: the view's number, the tile's first pixel.
    Tile(u32, [u32; 2]),
    /// A round was submitted; whether the octree marched, how many updates it published, and blocks of samples in
    /// a dispatch.
    Round(bool, u32, u32),
    /// What it reported.
    Report(RecordedReport),
    /// What is known of a block came.
    Surveyed(RecordedBrick),
    /// A brick's voxels came.
    Brick(RecordedBrick),
    /// A brick could not be read: exit code and sentence.
    Failed(RecordedBrick, u8, String),
    /// What had come was copied, and slots kept for what is wanted next.
    Turn,
    /// Slots were kept for what a report asked for.
    Bound,
    /// What was on its way was given up.
    GaveUp,
    /// The picture of a round, where the picture is refined by substitution: its digest.
    Frame(String),
    /// The tile's rays have ended, or not: why.
    Ended(Option<Stopped>),
    /// A view is finished: its picture's digest.
    Picture(String),
}

/// Why a tile's loop ended before its rays did; [`Unfinished`](crate::render::Unfinished) in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stopped {
    Starved(u64),
    Full(u64),
    Restless(u64),
}

/// Channel, level, x, y, z of a brick, or of a block's first brick. There is one volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedBrick([u32; 5]);

/// A round's [`Report`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedReport {
    /// Front, waiting, running, moved.
    progress: [u32; 4],
    atlases: Vec<RecordedAtlas>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct RecordedAtlas {
    /// The words of its answer.
    answer: [u32; 8],
    grants: Vec<u32>,
    requests: Vec<[u32; 2]>,
}

impl Recording {
    pub(super) fn new(device: String, driver: String, of: RecordedOf) -> Recording {
        Recording { format: FORMAT, device, driver, of, events: Vec::new() }
    }

    /// From a file's bytes.
    ///
    /// # Errors
    /// Exit code 3 when it is none, or of another version.
    pub fn from_json(bytes: &[u8]) -> Result<Recording> {
        #[derive(Deserialize)]
        struct Form {
            format: u32,
        }
        let refuse = |why: serde_json::Error| {
            Error::input(format!("is no recording of a run ({why}): make one with --record"))
        };
        let form: Form = serde_json::from_slice(bytes).map_err(refuse)?;
        if form.format != FORMAT {
            return Err(Error::input(format!(
                "is a recording of form {} where this program reads {FORMAT}: record it anew",
                form.format
            )));
        }
        serde_json::from_slice(bytes).map_err(refuse)
    }

    /// As a file's text.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_else(|why| unreachable!("plain data: {why}"))
    }

    /// Rounds in it.
    pub fn rounds(&self) -> usize {
        self.events.iter().filter(|event| matches!(event, Event::Round(..))).count()
    }

    /// Bricks that come in it.
    pub fn bricks(&self) -> usize {
        self.events.iter().filter(|event| matches!(event, Event::Brick(_))).count()
    }

    pub(super) fn push(&mut self, event: Event) -> Result<()> {
        if self.events.len() == EVENTS_MAX {
            return Err(Error::machine(format!(
                "--record: more than {EVENTS_MAX} things happened, which is what a recording holds: record fewer views"
            )));
        }
        self.events.push(event);
        Ok(())
    }
}

impl RecordedOf {
    /// What of it differs where it is replayed, as a sentence's end.
    pub fn unlike(&self, here: &RecordedOf) -> Option<String> {
        let differs = |what: &str, was: &dyn std::fmt::Debug, is: &dyn std::fmt::Debug| {
            Some(format!("it was recorded with {what} {was:?} where {is:?} stands"))
        };
        if self.atlas_slots != here.atlas_slots {
            return differs("slots of atlases", &self.atlas_slots, &here.atlas_slots);
        }
        if self.staging_half_bytes != here.staging_half_bytes {
            let [was, is] = [self, here].map(|of| of.staging_half_bytes);
            return differs("bytes of a staging half", &was, &is);
        }
        if self.tile != here.tile {
            return differs("tiles of", &self.tile, &here.tile);
        }
        if self.blocks_per_dispatch != here.blocks_per_dispatch {
            return Some("it was recorded with another --steps-per-dispatch".to_owned());
        }
        if self.lockstep != here.lockstep {
            let how = if self.lockstep { "--lockstep" } else { "--free-running" };
            return Some(format!("it was recorded with {how}"));
        }
        if self.entries != here.entries {
            return differs("entries of the page table", &self.entries, &here.entries);
        }
        (self.scene != here.scene)
            .then(|| "it was recorded of another scene, or other views, size or quality".to_owned())
    }
}

impl RecordedBrick {
    pub fn id(self) -> Option<BrickId> {
        let [channel, level, x, y, z] = self.0;
        Some(BrickId {
            volume: 0,
            channel: channel.try_into().ok()?,
            level: level.try_into().ok()?,
            x,
            y,
            z,
        })
    }
}

impl From<BrickId> for RecordedBrick {
    fn from(id: BrickId) -> RecordedBrick {
        RecordedBrick([id.channel.into(), id.level.into(), id.x, id.y, id.z])
    }
}

impl From<Block> for RecordedBrick {
    fn from(block: Block) -> RecordedBrick {
        block.first().into()
    }
}

impl From<&Report> for RecordedReport {
    fn from(report: &Report) -> RecordedReport {
        let of_atlas = |atlas: &OfAtlas| RecordedAtlas {
            answer: bytemuck::cast(atlas.answer),
            grants: atlas.grants.clone(),
            requests: atlas.requests.clone(),
        };
        RecordedReport {
            progress: bytemuck::cast(report.progress),
            atlases: report.atlases.iter().map(of_atlas).collect(),
        }
    }
}

impl RecordedReport {
    /// The report that it was; `bytes` were read back here.
    pub fn report(&self, bytes: u64) -> Report {
        let of_atlas = |atlas: &RecordedAtlas| OfAtlas {
            answer: bytemuck::cast(atlas.answer),
            grants: atlas.grants.clone(),
            requests: atlas.requests.clone(),
        };
        Report {
            progress: bytemuck::cast(self.progress),
            atlases: self.atlases.iter().map(of_atlas).collect(),
            bytes,
        }
    }

    /// How another differs, as a sentence's part.
    pub fn unlike(&self, here: &RecordedReport) -> Option<String> {
        if self.progress != here.progress {
            let [_, was, ..] = self.progress;
            let [_, is, ..] = here.progress;
            return Some(format!("{is} rays wait where {was} did"));
        }
        let lists = |of: &RecordedReport| {
            let of_atlas = |atlas: &RecordedAtlas| [atlas.grants.len(), atlas.requests.len()];
            let lists = of.atlases.iter().map(of_atlas);
            lists.fold([0; 2], |sum, of| [sum[0] + of[0], sum[1] + of[1]])
        };
        let ([grants, requests], [grants_here, requests_here]) = (lists(self), lists(here));
        (self != here).then(|| {
            format!(
                "{grants_here} slots are granted and {requests_here} bricks asked for where it were {grants} and {requests}, or others of them"
            )
        })
    }

    /// Whether every slot and entry that it names is one of its atlas.
    pub fn fits(&self, atlases: &[AtlasPlan]) -> bool {
        let within = |first: u32, count: u32, number: u32| {
            number.checked_sub(first).is_some_and(|number| number < count)
        };
        let fits = |(of, plan): (&RecordedAtlas, &AtlasPlan)| {
            let (slots, shape) = (plan.layout.slot_count(), &plan.shape);
            of.grants.iter().all(|slot| within(shape.slot_first, slots, *slot))
                && of
                    .requests
                    .iter()
                    .all(|[entry, _]| within(shape.entry_first, plan.entry_count, *entry))
        };
        self.atlases.len() == atlases.len() && self.atlases.iter().zip(atlases).all(fits)
    }
}
