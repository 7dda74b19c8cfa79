//! The cache's rules written once more, naively: sets and plain loops over bricks, no chunks, no
//! histograms, no sums. The twins are compared with it over random runs.

use std::collections::{BTreeMap, BTreeSet};

use ashfall::twins::cache::{Answer, Cache, CacheRound};
use ashfall::twins::limits::{OWNER_FREE, OWNER_GRANTED, RANK_NONE, WEIGHT_RANKS};
use ashfall::twins::publish::{Update, publish};

use crate::host::Host;
use crate::invariants::{Before, holds};
use crate::random::Random;
use crate::twin_round::{self, Seen};
use crate::world::{Plan, View, World, chance};

/// What is known of a slot.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Holds {
    Nothing,
    Promised,
    Brick(u32),
}

/// Whether a slot may be given up.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Standing {
    Dead,
    Promised,
    /// Some ray may come to it, at this rank.
    Live(u32),
}

struct Model<'w> {
    world: &'w World,
    entries: Vec<u32>,
    slots: BTreeMap<u32, Holds>,
    /// Of each atlas, least recently used first.
    orders: Vec<Vec<u32>>,
    touched: BTreeSet<u32>,
}

/// What a round does, in the model's own words.
struct Wanted {
    answer: Answer,
    grants: Vec<u32>,
    requests: Vec<[u32; 2]>,
}

impl<'w> Model<'w> {
    fn new(world: &'w World) -> Model<'w> {
        let slots_of = |shape: &CacheRound| shape.slot_first..shape.slot_first + shape.slot_count;
        Model {
            world,
            entries: vec![0; world.entries as usize],
            slots: world.atlases.iter().flat_map(slots_of).map(|s| (s, Holds::Nothing)).collect(),
            orders: world.atlases.iter().map(|shape| slots_of(shape).collect()).collect(),
            touched: BTreeSet::new(),
        }
    }

    fn publish(&mut self, updates: &[Update]) {
        for Update { entry, value, slot, owner } in updates {
            if *entry != OWNER_FREE {
                self.entries[*entry as usize] = *value;
            }
            if *slot != OWNER_FREE {
                let holds =
                    if *owner == OWNER_FREE { Holds::Nothing } else { Holds::Brick(*owner) };
                self.slots.insert(*slot, holds);
            }
        }
    }

    /// Bricks between a brick and the one nearest to the eye, behind all bricks of finer levels in use.
    fn rank(&self, view: &View, entry: u32) -> Option<u32> {
        let brick = self.world.bricks[entry as usize]?;
        if view.levels[brick.level].rank_first == RANK_NONE {
            return None;
        }
        let away = |level: usize, brick: [u32; 3]| -> u32 {
            let eye = view.levels[level].eye_brick;
            (0..3).map(|axis| (brick[axis] as i32 - eye[axis]).unsigned_abs()).sum()
        };
        let mut rank = away(brick.level, brick.brick);
        for level in (0..brick.level).filter(|l| view.levels[*l].rank_first != RANK_NONE) {
            let last = self.world.plan.levels[level].map(|edge| edge - 1);
            let corner = |number: u32| [0, 1, 2].map(|axis| last[axis] * (number >> axis & 1));
            rank += 1 + (0..8).map(|number| away(level, corner(number))).max().unwrap();
        }
        Some(rank)
    }

    /// Heaviest first: all weights between two of four steps within a doubling are alike.
    fn rank_of_weight(weight: u32) -> u32 {
        let weight = f64::from(weight.max(1));
        let mut lighter = 0;
        let mut doubling = 1.0;
        while doubling * 2.0 <= weight {
            doubling *= 2.0;
            lighter += 4;
        }
        let quarters = ((weight / doubling - 1.0) * 4.0).floor() as u32;
        WEIGHT_RANKS - 1 - lighter - quarters
    }

    fn standing(&self, view: &View, marks: &Cache, round: u32, slot: u32) -> Standing {
        let entry = match self.slots[&slot] {
            Holds::Nothing => return Standing::Dead,
            Holds::Promised => return Standing::Promised,
            Holds::Brick(entry) => entry,
        };
        if self.world.plan.substitute {
            let level = self.world.bricks[entry as usize].expect("a brick").level;
            let stays = view.levels[level].held == 1 || marks.slot_used[slot as usize] == round;
            return if stays { Standing::Live(0) } else { Standing::Dead };
        }
        let needed = marks.slot_needed[slot as usize] == round;
        match self.rank(view, entry) {
            Some(rank) if rank > marks.progress.front => Standing::Live(rank),
            Some(rank) if rank == marks.progress.front && needed => Standing::Live(rank),
            _ => Standing::Dead,
        }
    }

    fn round(&mut self, shape: &CacheRound, view: &View, marks: &Cache) -> Wanted {
        let order = self.orders[shape.atlas as usize].clone();
        let used = |slot: &u32| marks.slot_used[*slot as usize] == shape.round;
        // Wishes that some rank holds, in the order of entries.
        let wished = |entry: &u32| marks.wished[*entry as usize / 32] >> (entry % 32) & 1 == 1;
        let entries = shape.entry_first..shape.entry_first + shape.word_count * 32;
        let mut wishes: Vec<[u32; 2]> = Vec::new();
        for entry in entries.filter(wished) {
            let rank = if self.world.plan.substitute {
                Some(Model::rank_of_weight(marks.wish_weight[entry as usize]))
            } else {
                self.rank(view, entry)
            };
            wishes.extend(rank.map(|rank| [entry, rank]));
        }
        let first = wishes.iter().map(|[_, rank]| *rank).min();
        let nearest = wishes.iter().filter(|[_, rank]| Some(*rank) == first).count();

        // Who may be given up, in the order in which slots are taken.
        let standing = |slot: &u32| self.standing(view, marks, shape.round, *slot);
        let dead: Vec<u32> =
            order.iter().copied().filter(|slot| standing(slot) == Standing::Dead).collect();
        let mut victims: Vec<u32> = dead.iter().copied().filter(|slot| !used(slot)).collect();
        victims.extend(dead.iter().copied().filter(used));
        let mut live: Vec<(u32, u32)> = Vec::new();
        for slot in &order {
            if let Standing::Live(rank) = standing(slot) {
                live.push((*slot, rank));
            }
        }
        let live_count = live.len();
        // Only a wish of a smaller rank takes a live slot.
        live.retain(|(_, rank)| first.is_some_and(|first| *rank > first));
        live.sort_by_key(|(_, rank)| std::cmp::Reverse(*rank));

        // The host has slots for the first of them.
        let held = shape.held as usize;
        let for_nearest = nearest.saturating_sub(held).min(dead.len() + live.len());
        let spare = (shape.live_max as usize).saturating_sub(live_count);
        let for_all = wishes.len().saturating_sub(held).min(dead.len()).min(spare);
        let grants = for_nearest.max(for_all).min(shape.grants_max as usize);
        let live_grants = grants.saturating_sub(dead.len());
        victims.truncate(grants);
        // In the list, those of the last rank taken stand behind those of all others, which stand in
        // the order of use.
        let taken = &live[..live_grants];
        let last_rank = taken.last().map(|(_, rank)| *rank);
        let place = |slot: u32| order.iter().position(|other| *other == slot);
        let mut taken: Vec<(bool, Option<usize>, u32)> = taken
            .iter()
            .map(|(slot, rank)| (Some(*rank) == last_rank, place(*slot), *slot))
            .collect();
        taken.sort();
        victims.extend(taken.iter().map(|(_, _, slot)| *slot));

        // Whole ranks, as many as the list holds; of the first rank as much as the list holds.
        let mut listed: BTreeSet<u32> = first.into_iter().collect();
        let mut ranks: Vec<u32> = wishes.iter().map(|[_, rank]| *rank).collect();
        ranks.sort();
        for rank in ranks.iter() {
            let up_to = ranks.iter().filter(|other| *other <= rank).count();
            if up_to <= shape.requests_max as usize {
                listed.insert(*rank);
            }
        }
        let mut requests = wishes.clone();
        requests.retain(|[_, rank]| listed.contains(rank));
        requests.truncate(shape.requests_max as usize);

        let mut fresh = 0;
        for slot in order.iter().filter(|slot| used(slot)) {
            if let Holds::Brick(entry) = self.slots[slot] {
                fresh += u32::from(self.touched.insert(entry));
            }
        }
        let answer = Answer {
            wished: wishes.len() as u32,
            first_rank: first.unwrap_or(RANK_NONE),
            first_wishes: nearest as u32,
            dead: dead.len() as u32,
            live: live_count as u32,
            grants: grants as u32,
            requests: requests.len() as u32,
            touched: fresh,
        };
        let (again, rest): (Vec<u32>, Vec<u32>) = order.iter().partition(|slot| used(slot));
        self.orders[shape.atlas as usize] = [rest, again].concat();
        for slot in &victims {
            if let Some(Holds::Brick(entry)) = self.slots.insert(*slot, Holds::Promised) {
                self.entries[entry as usize] = 0;
            }
        }
        Wanted { answer, grants: victims, requests }
    }

    fn compare(&self, cache: &Cache, shape: &CacheRound) {
        assert_eq!(cache.page_table, self.entries, "page table");
        for (slot, holds) in &self.slots {
            let owner = match holds {
                Holds::Nothing => OWNER_FREE,
                Holds::Promised => OWNER_GRANTED,
                Holds::Brick(entry) => *entry,
            };
            assert_eq!(cache.slot_owner[*slot as usize], owner, "owner of slot {slot}");
        }
        let first = shape.slot_first as usize;
        let order = &cache.usage_order[first..first + shape.slot_count as usize];
        assert_eq!(order, self.orders[shape.atlas as usize], "usage order");
        for (word, bits) in cache.touched.iter().enumerate() {
            let bit = |bit: u32| u32::from(self.touched.contains(&(word as u32 * 32 + bit))) << bit;
            assert_eq!(*bits, (0..32).map(bit).sum::<u32>(), "touched {word}");
        }
        let words = shape.word_first as usize..(shape.word_first + shape.word_count) as usize;
        assert!(cache.wished[words].iter().all(|bits| *bits == 0), "wishes are left");
    }
}

/// Worlds from tiny to larger; chunks hold 32 slots or 1024 entries, and 64 lanes share all ranks.
pub const PLANS: &[Plan] = &[
    Plan { levels: &[[1, 1, 1]], atlases: &[(1, 8)], substitute: false },
    Plan { levels: &[[4, 3, 5]], atlases: &[(1, 8)], substitute: false },
    Plan { levels: &[[9, 8, 4], [5, 4, 2], [3, 2, 1]], atlases: &[(2, 33)], substitute: false },
    Plan { levels: &[[13, 11, 7], [7, 6, 4]], atlases: &[(1, 64), (3, 100)], substitute: false },
    Plan { levels: &[[4, 3, 5], [2, 2, 3]], atlases: &[(1, 8), (1, 31)], substitute: true },
    Plan {
        levels: &[[9, 8, 4], [5, 4, 2], [3, 2, 1]],
        atlases: &[(1, 97), (2, 32)],
        substitute: true,
    },
];

fn run(seed: u64, plan: Plan, operations: u64, seen: &mut Seen) -> u64 {
    let world = World::new(plan);
    let mut random = Random(seed);
    let (mut cache, mut host, mut model) = (world.cache(), Host::new(&world), Model::new(&world));
    let mut view = world.view(&mut random);
    for round in 1.. {
        if host.operations >= operations {
            return u64::from(round);
        }
        if chance(&mut random, 0.05) {
            view = world.view(&mut random);
        }
        let updates = host.updates(&mut random, &world, &cache);
        publish(&mut cache, &updates);
        model.publish(&updates);
        let anything = chance(&mut random, 0.1);
        host.marks(&mut random, &world, &view, &mut cache, (round, anything));
        for atlas in 0..world.atlases.len() {
            let what = format!("seed {seed} of {plan:?}, round {round}, atlas {atlas}");
            let shape = world.shape(&mut random, atlas, round, &view);
            let wanted = model.round(&shape, &view, &cache);
            let before = Before::of(&cache, &world, &view, &shape);
            let got = twin_round::round(&mut cache, &shape, &world.ranking(&view));
            assert_eq!(got.answer, wanted.answer, "{what}: {shape:?}");
            assert_eq!(got.lists.grants, wanted.grants, "{what}: grants, {shape:?}");
            assert_eq!(got.lists.requests, wanted.requests, "{what}: requests, {shape:?}");
            model.compare(&cache, &shape);
            seen.add(&shape, &got);
            host.takes(atlas, &got.lists, &cache);
            let held = before.guarded(&got.lists, &got.answer);
            held.and_then(|()| holds(&cache, &world, &host))
                .unwrap_or_else(|why| panic!("{what}: {why}"));
        }
    }
    unreachable!()
}

#[test]
fn twins_follow_the_rules_over_a_hundred_thousand_operations() {
    let mut seen = Seen::default();
    for (seed, plan) in (100..).zip(PLANS) {
        let rounds = run(seed, *plan, 100_000, &mut seen);
        eprintln!("{plan:?}: {rounds} rounds");
    }
    eprintln!("{seen:?}");
    seen.assert_all(20);
}

#[test]
#[ignore = "half a minute"]
fn twins_follow_the_rules_over_a_million_operations() {
    for (seed, plan) in (200..).zip(PLANS.iter().cycle()).take(4 * PLANS.len()) {
        run(seed, *plan, 200_000, &mut Seen::default());
    }
}
