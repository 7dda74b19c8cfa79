//! What the host knows and holds between rounds: granted slots, bricks bound to them, what surveys said.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use crate::error::Error;
use crate::loading::{Block, Wish};
use crate::render::paging::brick_numbers::{BrickNumbers, ChannelPlace};
use crate::render::paging::slot_map::SlotMap;
use crate::render::paging::visibility::{Judge, Shows};
use crate::residency::Report;
use crate::source::{BrickEntry, BrickSource};
use crate::twins::cache::entry;
use crate::twins::limits::{
    ENTRY_ABSENT, ENTRY_CONSTANT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_HIDDEN, ENTRY_MAPPED,
    ENTRY_UNMAPPED, OWNER_FREE, OWNER_GRANTED,
};
use crate::twins::publish::Update;
use crate::volume::{BrickGrid, BrickId};

/// Bricks of one value share texels, of which there are at most this many.
pub const CONSTANTS_MAX: u32 = 65_536;

/// A brick that a slot is kept for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Number over all atlases.
    pub slot: u32,
    /// Of the wish.
    pub rank: u32,
}

/// Counts of one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counts {
    /// Bricks copied into slots.
    pub uploaded: u64,
    /// The same by level.
    pub uploaded_by_level: Vec<u64>,
    /// Texel bytes copied.
    pub uploaded_bytes: u64,
    /// Bricks copied into slots at least once.
    pub distinct: u64,
    /// Bricks that the source does not have, of all that were looked at.
    pub absent: u64,
    /// Bricks that show nothing.
    pub hidden: u64,
    /// Bricks of one value.
    pub constant: u64,
    /// Bricks of one value that travel, since there are too many values.
    pub constants_overflow: u64,
}

/// See the module.
pub struct HostCache {
    numbers: BrickNumbers,
    /// By channel of the source.
    judges: HashMap<u16, Judge>,
    slot_first: Vec<u32>,
    /// Granted and not bound, atlas by atlas, over all atlases' numbers.
    pool: Vec<Vec<u32>>,
    bound: BTreeMap<BrickId, Bound>,
    /// Bit per brick of a block: whether its voxels have to travel. Empty: asked for, not known yet.
    surveyed: HashMap<Block, Vec<bool>>,
    /// Of which some entries could not be had.
    surveyed_in_part: HashSet<Block>,
    /// Of the last report, in order of rank: bricks that are neither there nor on their way.
    wanted: Vec<(u32, BrickId)>,
    updates: BTreeMap<u32, Update>,
    constants: HashMap<[u32; 4], u32>,
    constant_texels: Vec<[f32; 4]>,
    constants_written: usize,
    /// Of them, at most.
    constants_max: u32,
    failed: BTreeMap<BrickId, Error>,
    loaded: HashSet<BrickId>,
    /// Came before a slot was kept for them.
    ahead: HashSet<BrickId>,
    /// Bricks to be loaded before all else, until they are there or known not to travel.
    floor: BTreeSet<BrickId>,
    held: Vec<BrickId>,
    surveys_pending: usize,
    /// Of this view.
    pub counts: Counts,
    /// Over all views.
    pub slots: SlotMap,
}

impl HostCache {
    /// Nothing is known yet. `slot_first`: first slot of every atlas; `held`: bricks that are loaded first
    /// and never given up; `constants_max`: room for so many values of bricks of one value.
    pub fn new(
        numbers: BrickNumbers,
        judges: HashMap<u16, Judge>,
        slot_first: Vec<u32>,
        held: Vec<BrickId>,
        constants_max: u32,
    ) -> HostCache {
        HostCache {
            numbers,
            judges,
            pool: vec![Vec::new(); slot_first.len()],
            slot_first,
            bound: BTreeMap::new(),
            surveyed: HashMap::new(),
            surveyed_in_part: HashSet::new(),
            wanted: Vec::new(),
            updates: BTreeMap::new(),
            constants: HashMap::new(),
            constant_texels: Vec::new(),
            constants_written: 0,
            constants_max,
            failed: BTreeMap::new(),
            loaded: HashSet::new(),
            ahead: HashSet::new(),
            floor: held.iter().copied().collect(),
            held,
            surveys_pending: 0,
            counts: Counts::default(),
            slots: SlotMap::default(),
        }
    }

    /// A new view: counts begin anew.
    pub fn begin_view(&mut self) {
        self.loaded.clear();
        self.ahead.clear();
        self.counts = Counts::default();
    }

    /// Takes a round's grants and requests; gives blocks that have to be surveyed before anything can be
    /// said of their bricks.
    pub fn take_report(&mut self, report: &Report) -> Vec<Block> {
        let mut blocks = BTreeSet::new();
        self.wanted.clear();
        self.slots.next_round();
        for (atlas, of_atlas) in report.atlases.iter().enumerate() {
            self.pool[atlas].extend(&of_atlas.grants);
            of_atlas.grants.iter().for_each(|slot| self.slots.freed(*slot));
            for [entry, rank] in &of_atlas.requests {
                let id = self.numbers.brick(atlas, *entry);
                // What came while the device marched is there from the next round on.
                if self.bound.contains_key(&id) || self.updates.contains_key(entry) {
                    continue;
                }
                let block = Block::of(id);
                if !self.surveyed.contains_key(&block) {
                    blocks.insert(block);
                }
                self.wanted.push((*rank, id));
            }
        }
        self.wanted.sort_by_key(|(rank, _)| *rank);
        blocks.iter().for_each(|block| _ = self.surveyed.insert(*block, Vec::new()));
        self.surveys_pending += blocks.len();
        blocks.into_iter().collect()
    }

    /// Wants these bricks before all else.
    pub fn want_first(&mut self, bricks: Vec<BrickId>) -> Vec<Block> {
        let mut first: Vec<_> = bricks.into_iter().map(|id| (0, id)).collect();
        let mut blocks: Vec<_> = first.iter().map(|(_, id)| Block::of(*id)).collect();
        blocks.sort();
        blocks.dedup();
        blocks.retain(|block| !self.surveyed.contains_key(block));
        blocks.iter().for_each(|block| _ = self.surveyed.insert(*block, Vec::new()));
        self.surveys_pending += blocks.len();
        first.append(&mut self.wanted);
        self.wanted = first;
        blocks
    }

    /// Learns what the source knows of a block's bricks. With `joint` a brick is hidden only where no channel
    /// shows anything.
    pub fn take_survey(
        &mut self,
        block: Block,
        entries: &[(BrickId, crate::error::Result<BrickEntry>)],
        joint: Option<&dyn BrickSource>,
    ) {
        let mut travels = Vec::with_capacity(entries.len());
        for (id, of_source) in entries {
            let (Some(number), Some(judge)) =
                (self.numbers.entry(*id), self.judges.get(&id.channel))
            else {
                travels.push(false);
                continue;
            };
            let value = match of_source {
                Err(why) => {
                    self.surveyed_in_part.insert(block);
                    self.failed.insert(*id, why.clone());
                    Some(entry(ENTRY_FAILED, 0))
                }
                Ok(of_source) => match judge.shows(of_source) {
                    Shows::Absent => {
                        self.counts.absent += 1;
                        Some(entry(ENTRY_ABSENT, 0))
                    }
                    Shows::Hidden if joint.is_some_and(|of| self.any_shows(of, *id)) => None,
                    Shows::Hidden => {
                        self.counts.hidden += 1;
                        Some(entry(ENTRY_HIDDEN, 0))
                    }
                    Shows::Constant(texel) => self.constant(texel),
                    Shows::Voxels => None,
                },
            };
            travels.push(value.is_none());
            if let Some(value) = value {
                self.floor.remove(id);
                self.set_entry(number, value);
            }
        }
        // Of a channel that is not shown any more nothing is kept.
        if !self.judges.contains_key(&block.channel) {
            return;
        }
        if self.surveyed.insert(block, travels).is_some_and(|known| known.is_empty()) {
            self.surveys_pending -= 1;
        }
    }

    /// Whether some channel shows something of its brick in the same place.
    fn any_shows(&self, source: &dyn BrickSource, id: BrickId) -> bool {
        self.judges.iter().any(|(channel, judge)| {
            let entry = source.entry(BrickId { channel: *channel, ..id });
            let shows = entry.map(|entry| judge.shows(&entry));
            !matches!(shows, Ok(Shows::Hidden | Shows::Absent))
        })
    }

    fn constant(&mut self, texel: [f32; 4]) -> Option<u32> {
        let count = self.constants.len() as u32;
        let number = match self.constants.get(&texel.map(f32::to_bits)) {
            Some(number) => *number,
            None if count == self.constants_max => {
                self.counts.constants_overflow += 1;
                return None;
            }
            None => {
                self.constants.insert(texel.map(f32::to_bits), count);
                self.constant_texels.push(texel);
                count
            }
        };
        self.counts.constant += 1;
        Some(entry(ENTRY_CONSTANT, number))
    }

    /// Texels of constants that the device does not have yet, and the number of the first.
    pub fn new_constants(&mut self) -> Option<(usize, &[[f32; 4]])> {
        let first = std::mem::replace(&mut self.constants_written, self.constant_texels.len());
        let new = &self.constant_texels[first..];
        (!new.is_empty()).then_some((first, new))
    }

    /// Bricks of the floor that are neither there nor on their way.
    pub fn floor_wanted(&self) -> Vec<BrickId> {
        self.floor.iter().filter(|id| !self.bound.contains_key(id)).copied().collect()
    }

    /// Blocks that were asked for and are not known yet.
    pub fn surveys_pending(&self) -> usize {
        self.surveys_pending
    }

    /// Binds wanted bricks to granted slots, most urgent first. `expected`: rays shall not ask for them
    /// again.
    pub fn bind(&mut self, expected: bool, grid_of_level: impl Fn(u8) -> Option<BrickGrid>) {
        let mut left = Vec::new();
        for (rank, id) in std::mem::take(&mut self.wanted) {
            match self.travels(id, &grid_of_level) {
                Some(true) => {}
                Some(false) => continue,
                None => {
                    left.push((rank, id));
                    continue;
                }
            }
            let atlas = self.numbers.atlas_of(id);
            let Some(number) = self.numbers.entry(id) else { continue };
            let Some(slot) = self.pool[atlas].pop() else {
                left.push((rank, id));
                continue;
            };
            self.bound.insert(id, Bound { slot, rank });
            if expected {
                self.set_entry(number, entry(ENTRY_EXPECTED, 0));
            }
        }
        self.wanted = left;
    }

    /// Whether a brick's voxels have to travel; nothing: its survey has not come.
    fn travels(
        &self,
        id: BrickId,
        grid_of_level: &impl Fn(u8) -> Option<BrickGrid>,
    ) -> Option<bool> {
        if self.failed.contains_key(&id) {
            return Some(false);
        }
        let known = self.surveyed.get(&Block::of(id)).filter(|known| !known.is_empty())?;
        known.get(Block::index(id, grid_of_level(id.level)?)?).copied()
    }

    /// Came though no slot was kept for it: it waits in the RAM cache.
    pub fn came_ahead(&mut self, id: BrickId) {
        self.ahead.insert(id);
    }

    /// Bricks to load: those that slots are kept for, and up to `ahead` more that have not come yet.
    pub fn wishes(&self, ahead: usize) -> Vec<Wish> {
        let bound = self.bound.iter().map(|(id, bound)| Wish { id: *id, rank: bound.rank.into() });
        let known = |id: &BrickId| {
            self.surveyed.get(&Block::of(*id)).is_some_and(|known| !known.is_empty())
        };
        let ahead = self
            .wanted
            .iter()
            .filter(|(_, id)| known(id) && !self.ahead.contains(id))
            .take(ahead)
            .map(|(rank, id)| Wish { id: *id, rank: u64::from(*rank) + (1 << 32) });
        bound.chain(ahead).collect()
    }

    /// The slot kept for a brick.
    pub fn slot_of(&self, id: BrickId) -> Option<u32> {
        self.bound.get(&id).map(|bound| bound.slot)
    }

    /// Bricks that rays asked for, without a slot.
    pub fn wanted(&self) -> impl ExactSizeIterator<Item = BrickId> {
        self.wanted.iter().map(|(_, id)| *id)
    }

    /// The brick that an update puts into a slot; nothing: it puts none.
    pub fn published(&self, update: &Update) -> Option<BrickId> {
        let fills = update.slot != OWNER_FREE && update.owner != OWNER_GRANTED;
        fills.then(|| self.numbers.brick(self.atlas_of_slot(update.slot).0, update.entry))
    }

    /// The entry of the brick that a slot holds, as far as it was published.
    pub fn entry_in(&self, slot: u32) -> Option<u32> {
        self.numbers.entry(self.slots.brick_in(slot)?)
    }

    /// Slots kept for bricks that have not come.
    pub fn bound_count(&self) -> usize {
        self.bound.len()
    }

    /// Granted slots of an atlas that nothing is bound to.
    pub fn pool_count(&self, atlas: usize) -> u32 {
        self.pool[atlas].len() as u32
    }

    /// The atlas of a slot, and the slot's number in it.
    pub fn atlas_of_slot(&self, slot: u32) -> (usize, u32) {
        let atlas = self.slot_first.iter().rposition(|first| slot >= *first).unwrap_or(0);
        (atlas, slot - self.slot_first[atlas])
    }

    /// A bound brick was copied into its slot, `bytes` long: rays see it from the next round on.
    pub fn arrived(&mut self, id: BrickId, bytes: u64) {
        let Some(Bound { slot, .. }) = self.bound.remove(&id) else { return };
        let Some(number) = self.numbers.entry(id) else { return };
        let (_, in_atlas) = self.atlas_of_slot(slot);
        self.update(Update {
            entry: number,
            value: entry(ENTRY_MAPPED, in_atlas),
            slot,
            owner: number,
        });
        self.slots.filled(slot, id);
        self.floor.remove(&id);
        self.ahead.remove(&id);
        self.counts.uploaded += 1;
        self.counts.uploaded_bytes += bytes;
        let level = usize::from(id.level);
        let levels = self.counts.uploaded_by_level.len().max(level + 1);
        self.counts.uploaded_by_level.resize(levels, 0);
        self.counts.uploaded_by_level[level] += 1;
        self.counts.distinct += u64::from(self.loaded.insert(id));
    }

    /// A brick could not be read: drawn as nothing for the epoch, and its slot is free for another.
    pub fn failed(&mut self, id: BrickId, why: Error) {
        if let Some(Bound { slot, .. }) = self.bound.remove(&id) {
            let (atlas, _) = self.atlas_of_slot(slot);
            self.pool[atlas].push(slot);
        }
        self.failed.insert(id, why);
        self.floor.remove(&id);
        if let Some(number) = self.numbers.entry(id) {
            self.set_entry(number, entry(ENTRY_FAILED, 0));
        }
    }

    /// Gives up what is on its way: rays may ask for it again.
    pub fn give_up(&mut self) -> Vec<BrickId> {
        let given_up: Vec<_> = std::mem::take(&mut self.bound).into_iter().collect();
        for (id, bound) in &given_up {
            let (atlas, _) = self.atlas_of_slot(bound.slot);
            self.pool[atlas].push(bound.slot);
            if let Some(number) = self.numbers.entry(*id) {
                self.set_entry(number, entry(ENTRY_UNMAPPED, 0));
            }
        }
        // Surveys that never came are asked for again.
        self.surveyed.retain(|_, known| !known.is_empty());
        self.surveys_pending = 0;
        given_up.into_iter().map(|(id, _)| id).collect()
    }

    /// Bricks that could not be read, and why.
    pub fn failures(&self) -> &BTreeMap<BrickId, Error> {
        &self.failed
    }

    /// Failed bricks may be asked for again.
    pub fn forget_failures(&mut self) {
        // Whole surveys hold for the epoch: loaders do not give them again.
        for block in std::mem::take(&mut self.surveyed_in_part) {
            self.surveyed.remove(&block);
        }
        for id in std::mem::take(&mut self.failed).into_keys() {
            if let Some(number) = self.numbers.entry(id) {
                self.set_entry(number, entry(ENTRY_UNMAPPED, 0));
            }
        }
    }

    /// Another channel of the source has the place of this one from now on, or, with `keep`, another
    /// transfer function says what of it shows: what the device holds of it is forgotten there too, but
    /// with `keep` the bricks that are there or on their way. Nothing may be staged.
    pub fn forget_channel(&mut self, in_source: u16, keep: bool) {
        let of_channel = |of: &&ChannelPlace| of.in_source == in_source;
        let Some(place) = self.numbers.channels.iter().find(of_channel).copied() else { return };
        let stays = |id: &BrickId| id.channel != in_source;
        self.updates.retain(|number, update| {
            if !self.numbers.is_of(&place, *number) {
                return true;
            }
            // Copied and not published: the slot is still the host's.
            let arrived = update.slot != OWNER_FREE;
            if arrived && !keep {
                self.pool[place.atlas].push(update.slot);
            }
            arrived && keep
        });
        if !keep {
            self.slots.forget_channel(in_source);
            self.bound.retain(|id, bound| {
                if !stays(id) {
                    self.pool[place.atlas].push(bound.slot);
                }
                stays(id)
            });
            self.floor.retain(stays);
        }
        self.surveyed.retain(|block, known| {
            let stays = block.channel != in_source;
            self.surveys_pending -= usize::from(!stays && known.is_empty());
            stays
        });
        self.surveyed_in_part.retain(|block| block.channel != in_source);
        self.failed.retain(|id, _| stays(id));
        self.wanted.clear();
    }

    /// From now on channels have these numbers, judges say what shows of them, and `held` is loaded first;
    /// what stood in the places of others is forgotten, [`HostCache::forget_channel`].
    pub fn show(&mut self, numbers: BrickNumbers, judges: HashMap<u16, Judge>, held: Vec<BrickId>) {
        let shown_before = std::mem::replace(&mut self.judges, judges);
        let newly = |id: &&BrickId| !shown_before.contains_key(&id.channel);
        self.floor.extend(held.iter().filter(newly));
        self.numbers = numbers;
        self.held = held;
    }

    /// The source changed and the device was cleared: nothing is known, nothing held.
    pub fn clear(&mut self) {
        self.pool.iter_mut().for_each(Vec::clear);
        self.slots.clear();
        self.bound.clear();
        self.surveyed.clear();
        self.surveyed_in_part.clear();
        self.wanted.clear();
        self.updates.clear();
        // No round is under way, and no entry of before is left that would name one.
        self.constants.clear();
        self.constant_texels.clear();
        self.constants_written = 0;
        self.failed.clear();
        self.surveys_pending = 0;
        self.floor = self.held.iter().copied().collect();
    }

    /// An entry changes, and no slot does.
    fn set_entry(&mut self, number: u32, value: u32) {
        self.update(Update { entry: number, value, slot: OWNER_FREE, owner: OWNER_FREE });
    }

    fn update(&mut self, update: Update) {
        self.updates.insert(update.entry, update);
    }

    /// Whether the next round has something to publish.
    pub fn has_updates(&self) -> bool {
        !self.updates.is_empty()
    }

    /// Up to `most` updates for the next round.
    pub fn take_updates(&mut self, most: usize) -> Vec<Update> {
        let later = match self.updates.keys().nth(most).copied() {
            Some(key) => self.updates.split_off(&key),
            None => BTreeMap::new(),
        };
        std::mem::replace(&mut self.updates, later).into_values().collect()
    }
}
