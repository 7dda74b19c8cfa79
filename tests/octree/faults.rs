//! Faults planted in an octree's state and in its updates: model or rays notice each.

use ashfall::twins::octree::{ONE_VALUE, RISE_SHIFT, SHOWS};
use ashfall::twins::octree_ranges::Work;
use ashfall::volume::ValueRange;

use crate::model::differs;
use crate::random::Random;
use crate::state::State;
use crate::walks::{ray, walk_of, wrong};
use crate::world::{PLANS, World};

fn made(seed: u64) -> (World, State, Random) {
    let world = World::new(PLANS[seed as usize % PLANS.len()], seed);
    let mut random = Random(seed);
    let mut state = State::new(&world, 2, &mut random);
    for _ in 0..600 {
        let event = state.event(&mut random);
        state.happen(&world, event, &mut random);
    }
    (world, state, random)
}

/// Changes a state; false where it has nothing to change.
type Fault = fn(&mut State, &mut Random) -> bool;

/// One node or place that does not follow from the others.
const OF_STATE: &[Fault] = &[
    |state, random| {
        let words = &mut state.channels[0].ranges.words;
        let at = random.index(words.len());
        words[at] ^= 1;
        true
    },
    |state, random| {
        let levels = &mut state.channels[0].resident.levels;
        let at = random.index(levels.len());
        levels[at] ^= 1;
        true
    },
    // Another channel's brick is still there.
    |state, _| {
        let bricks = state.channels[0].bricks.clone();
        let before = state.channels[0].resident.clone();
        state.channels[0].resident.forget();
        state.channels[0].bricks = bricks;
        state.channels[0].resident != before
    },
    // A range is learned and its words are not made again.
    |state, _| {
        let of = &state.words.of_leaf;
        let at = of.iter().position(|word| word & SHOWS != 0);
        at.map(|at| state.words.of_leaf[at] &= !SHOWS).is_some()
    },
    |state, _| {
        let at = state.words.of_leaf.iter().position(|word| word >> RISE_SHIFT != 0);
        at.map(|at| state.words.of_leaf[at] -= 1 << RISE_SHIFT).is_some()
    },
    // What leaves is not told to the places beneath or above.
    |state, random| {
        let shape = &state.shape;
        let level = random.index(shape.trees.len());
        let brick = shape.bricks(level).map(|count| random.below(count.into()) as u32);
        let of = &mut state.channels[0];
        let before = of.resident.clone();
        let place = of.resident.places[level].place(brick);
        of.resident.leaves(level, brick, &mut Work::default());
        let there = before.levels[place] >> level & 1 == 1;
        let after = of.resident.levels[place];
        of.resident = before;
        of.resident.levels[place] = after;
        there
    },
];

#[test]
fn the_model_notices_a_state_that_does_not_follow() {
    for (number, fault) in OF_STATE.iter().enumerate() {
        let mut noticed = 0;
        for seed in 1..7 {
            let (world, mut state, mut random) = made(seed);
            differs(&world, &state).unwrap_or_else(|why| panic!("without a fault: {why}"));
            if fault(&mut state, &mut random) {
                let found = differs(&world, &state);
                assert!(found.is_err(), "fault {number} in seed {seed} is not noticed");
                noticed += 1;
            }
        }
        assert!(noticed > 1, "fault {number} could be planted {noticed} times");
    }
}

/// Wrong words, with which a ray goes wrong.
const OF_WORDS: &[Fault] = &[
    // A channel that shows is left out.
    |state, _| {
        let mut some = false;
        for word in &mut state.words.of_leaf {
            some |= *word & 1 == 1;
            *word &= !1;
        }
        some
    },
    // Boxes one tier too large.
    |state, _| {
        let shape = &state.shape;
        for tree in &shape.trees {
            let leaves = shape.lowest(tree).nodes.iter().product::<u32>();
            let first = tree.first_word as usize;
            for word in &mut state.words.of_leaf[first..first + leaves as usize] {
                if *word >> RISE_SHIFT < tree.rise_max {
                    *word += 1 << RISE_SHIFT;
                }
            }
        }
        true
    },
    // Everything has one value.
    |state, _| {
        state.words.of_leaf.iter_mut().for_each(|word| *word |= ONE_VALUE);
        true
    },
    // No brick is there.
    |state, _| {
        state.channels.iter_mut().for_each(|channel| channel.resident.forget());
        true
    },
];

#[test]
fn rays_notice_wrong_words() {
    for (number, fault) in OF_WORDS.iter().enumerate() {
        let noticed = (0..6).any(|seed| {
            let (world, mut state, mut random) = made(seed);
            fault(&mut state, &mut random)
                && (0..200).any(|turn| {
                    let ray = ray(&state, &mut random, turn % state.shape.trees.len());
                    let (runs, _) = walk_of(&world, &state, &ray);
                    wrong(&world, &state, &ray, &runs).is_err()
                })
        });
        assert!(noticed, "fault {number} is not noticed");
    }
}

/// An update that ends one tier too early leaves a range that does not hold its children's.
#[test]
fn an_update_that_stops_too_early_is_noticed() {
    let (world, mut state, _) = made(0);
    let tree = state.shape.trees[0];
    let of = &mut state.channels[0].ranges;
    let root = state.shape.tiers.len() - 1;
    let number = tree.number(&state.shape.tiers[root], [0; 3]);
    let range = of.get(number);
    of.set(number, ValueRange { greatest: range.least, ..range });
    let why = differs(&world, &state).expect_err("a wrong root");
    assert!(why.contains("range of node"), "{why}");
}
