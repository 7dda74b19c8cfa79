//! What a host and rays may do between two rounds of the cache, at random.

use std::collections::BTreeSet;

use ashfall::twins::cache::{Cache, entry};
use ashfall::twins::grant::Lists;
use ashfall::twins::limits::{
    ENTRY_ABSENT, ENTRY_CONSTANT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_HIDDEN, ENTRY_MAPPED,
    ENTRY_PAYLOAD_MASK, ENTRY_STATE_SHIFT, ENTRY_UNMAPPED, OWNER_FREE, OWNER_GRANTED, RANK_NONE,
};
use ashfall::twins::publish::Update;
use ashfall::twins::ranks::rank_of_place;

use crate::random::Random;
use crate::world::{View, World, below, chance, draw, pick};

/// A granted slot that waits for its brick.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    pub atlas: usize,
    pub entry: u32,
    pub slot: u32,
    /// The page table says that it is expected.
    pub told: bool,
}

/// The host's own knowledge.
#[derive(Default)]
pub struct Host {
    /// Of each atlas: granted slots.
    pub hands: Vec<Vec<u32>>,
    pub bound: Vec<Bound>,
    /// Of each atlas: entries that were requested.
    asked: Vec<BTreeSet<u32>>,
    /// Touches, wishes, arrivals and so on, so far.
    pub operations: u64,
    /// Much arrives, little is lost and rays stand near the eye: slots are scarce.
    pressing: bool,
}

const NOBODY: u32 = OWNER_FREE;

fn of_entry(entry: u32, value: u32) -> Update {
    Update { entry, value, slot: NOBODY, owner: NOBODY }
}

fn freed(slot: u32) -> Update {
    Update { entry: NOBODY, value: 0, slot, owner: OWNER_FREE }
}

impl Host {
    pub fn new(world: &World) -> Host {
        let none = vec![Vec::new(); world.atlases.len()];
        Host { hands: none, asked: vec![BTreeSet::new(); world.atlases.len()], ..Host::default() }
    }

    /// What grant listed; what is there by now needs no slot.
    pub fn takes(&mut self, atlas: usize, lists: &Lists, cache: &Cache) {
        self.hands[atlas].extend(&lists.grants);
        let bound: BTreeSet<u32> = self.bound.iter().map(|bound| bound.entry).collect();
        let fresh = lists.requests.iter().map(|[entry, _]| *entry);
        let missing = |at: &u32| cache.page_table[*at as usize] == entry(ENTRY_UNMAPPED, 0);
        self.asked[atlas].extend(fresh.filter(|at| missing(at) && !bound.contains(at)));
    }

    /// Arrivals, failures, bindings, resets; each entry and slot at most once.
    pub fn updates(&mut self, random: &mut Random, world: &World, cache: &Cache) -> Vec<Update> {
        if chance(random, 0.02) {
            self.pressing = chance(random, 0.7);
        }
        let mut updates = Vec::new();
        for bound in std::mem::take(&mut self.bound) {
            let Bound { atlas, entry: at, slot, told } = bound;
            let local = slot - world.atlases[atlas].slot_first;
            match random.unit() * if self.pressing { 0.4 } else { 1.0 } {
                0.0..0.4 => {
                    let value = entry(ENTRY_MAPPED, local);
                    updates.push(Update { entry: at, value, slot, owner: at });
                }
                0.4..0.47 => {
                    let value = entry(ENTRY_FAILED, 0);
                    updates.push(Update { entry: at, value, slot, owner: OWNER_FREE });
                }
                0.47..0.5 => {
                    updates.extend(told.then(|| of_entry(at, entry(ENTRY_UNMAPPED, 0))));
                    self.hands[atlas].push(slot);
                }
                0.5..0.7 if !told => {
                    updates.push(of_entry(at, entry(ENTRY_EXPECTED, 0)));
                    self.bound.push(Bound { told: true, ..bound });
                }
                _ => self.bound.push(bound),
            }
        }
        for (atlas, shape) in world.atlases.iter().enumerate() {
            let mut asked: Vec<u32> = std::mem::take(&mut self.asked[atlas]).into_iter().collect();
            let binds = pick(random, &[0, 1, 3, 8, 40]);
            for _ in 0..if self.pressing { 1000 } else { binds } {
                let Some(at) = draw(random, &mut asked) else { break };
                if chance(random, if self.pressing { 0.01 } else { 0.15 }) {
                    let state =
                        pick(random, &[ENTRY_CONSTANT, ENTRY_HIDDEN, ENTRY_ABSENT, ENTRY_FAILED]);
                    updates.push(of_entry(at, entry(state, below(random, 1000))));
                    continue;
                }
                let Some(slot) = draw(random, &mut self.hands[atlas]) else { break };
                match random.unit() {
                    0.0..0.3 => {
                        let value = entry(ENTRY_MAPPED, slot - shape.slot_first);
                        updates.push(Update { entry: at, value, slot, owner: at });
                    }
                    part => {
                        let told = part < 0.7;
                        updates.extend(told.then(|| of_entry(at, entry(ENTRY_EXPECTED, 0))));
                        self.bound.push(Bound { atlas, entry: at, slot, told });
                    }
                }
            }
            // Most wishes grow old; what is still wanted comes again.
            asked.retain(|_| chance(random, 0.5));
            self.asked[atlas].extend(asked);
            if chance(random, 0.1) {
                updates.extend(draw(random, &mut self.hands[atlas]).map(freed));
            }
            if !self.pressing || chance(random, 0.05) {
                self.reset(random, world, cache, atlas, &mut updates);
            }
        }
        self.operations += updates.len() as u64;
        updates
    }

    /// Now and then many entries are forgotten, as at a new epoch or transfer function.
    fn reset(
        &self,
        random: &mut Random,
        world: &World,
        cache: &Cache,
        atlas: usize,
        updates: &mut Vec<Update>,
    ) {
        let shape = &world.atlases[atlas];
        let entries: Vec<u32> = if chance(random, 0.02) {
            let channel = below(random, shape.channels);
            let places = shape.word_count * 32 / shape.channels;
            let start = below(random, places);
            let end = places.min(start + below(random, places));
            (start..end).map(|at| shape.entry_first + at * shape.channels + channel).collect()
        } else {
            (0..2).map(|_| shape.entry_first + below(random, shape.word_count * 32)).collect()
        };
        let now = pick(random, &[ENTRY_UNMAPPED, ENTRY_UNMAPPED, ENTRY_HIDDEN]);
        let mut changed: BTreeSet<u32> = updates.iter().map(|update| update.entry).collect();
        changed.extend(self.bound.iter().map(|bound| bound.entry));
        for at in entries.into_iter().filter(|at| !changed.contains(at)) {
            let value = cache.page_table[at as usize];
            if world.bricks[at as usize].is_none() || value >> ENTRY_STATE_SHIFT == ENTRY_UNMAPPED {
                continue;
            }
            let mut update = of_entry(at, entry(now, 0));
            if value >> ENTRY_STATE_SHIFT == ENTRY_MAPPED {
                update.slot = shape.slot_first + (value & ENTRY_PAYLOAD_MASK);
                update.owner = OWNER_FREE;
            }
            updates.push(update);
        }
    }

    /// What rays mark in a round, as the march would: used and needed slots, wishes, the front.
    /// `anything`: wishes of entries that are there, too.
    pub fn marks(
        &mut self,
        random: &mut Random,
        world: &World,
        view: &View,
        cache: &mut Cache,
        (round, anything): (u32, bool),
    ) {
        let mut ranks = vec![0, RANK_NONE, below(random, view.ranks)];
        for shape in &world.atlases {
            let rank_of = |entry: u32| {
                rank_of_place(&view.levels, (entry - shape.entry_first) / shape.channels)
            };
            let touches = pick(random, &[0, 4, 12, 12, shape.slot_count.min(200)]);
            let needed = pick(random, &[0.0, 0.3, 0.9]);
            for _ in 0..touches {
                let slot = (shape.slot_first + below(random, shape.slot_count)) as usize;
                let owner = cache.slot_owner[slot];
                if owner >= OWNER_GRANTED && chance(random, 0.9) {
                    continue;
                }
                cache.slot_used[slot] = round;
                if chance(random, needed) {
                    cache.slot_needed[slot] = round;
                }
                if owner < OWNER_GRANTED {
                    ranks.push(rank_of(owner));
                }
                self.operations += 1;
            }
            let wishes = pick(random, &[0, 1, 10, 10, 150]);
            let start = below(random, shape.word_count * 32);
            let close = chance(random, 0.5);
            for wish in 0..wishes {
                let at = if close { start + wish } else { below(random, shape.word_count * 32) };
                let at = shape.entry_first + at % (shape.word_count * 32);
                let state = cache.page_table[at as usize] >> ENTRY_STATE_SHIFT;
                if world.bricks[at as usize].is_none() || (state != ENTRY_UNMAPPED && !anything) {
                    continue;
                }
                cache.wished[at as usize / 32] |= 1 << (at % 32);
                if world.plan.substitute {
                    let bits = below(random, 25);
                    let weight = &mut cache.wish_weight[at as usize];
                    *weight = weight.saturating_add(
                        below(random, 1 << bits) * (chance(random, 0.5) as u32 * 62 + 1),
                    );
                }
                if chance(random, 0.2) {
                    ranks.push(rank_of(at));
                }
                self.operations += 1;
            }
        }
        let near = self.pressing && chance(random, 0.4);
        cache.progress.front = if near { below(random, 3) } else { pick(random, &ranks) };
        if self.pressing && chance(random, 0.6) {
            stand_at_the_first_wish(world, view, cache, round);
        }
        cache.progress.waiting = below(random, 100);
        cache.progress.running = below(random, 3);
    }
}

/// As in truth: the front is where rays wait, and bricks of that rank that are there are needed.
fn stand_at_the_first_wish(world: &World, view: &View, cache: &mut Cache, round: u32) {
    let rank_of = |entry: u32| {
        let shape = world.atlases.iter().rfind(|shape| entry >= shape.entry_first);
        let shape = shape.expect("an atlas");
        rank_of_place(&view.levels, (entry - shape.entry_first) / shape.channels)
    };
    let wished = |entry: &u32| cache.wished[*entry as usize / 32] >> (entry % 32) & 1 == 1;
    let Some(front) = (0..world.entries).filter(wished).map(rank_of).min() else { return };
    cache.progress.front = front;
    for (slot, owner) in cache.slot_owner.iter().enumerate() {
        if *owner < OWNER_GRANTED && rank_of(*owner) == front {
            cache.slot_used[slot] = round;
            cache.slot_needed[slot] = round;
        }
    }
}
