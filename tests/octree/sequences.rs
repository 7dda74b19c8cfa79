//! The twin, updated by what happens, against the model, computed anew.

use crate::model::differs;
use crate::random::Random;
use crate::state::State;
use crate::world::{PLANS, World};

pub fn run(seed: u64, steps: u64) -> State {
    let plan = PLANS[seed as usize % PLANS.len()];
    let fan_out = [2, 4][seed as usize / PLANS.len() % 2];
    let world = World::new(plan, seed);
    let mut random = Random(seed);
    let mut state = State::new(&world, fan_out, &mut random);
    // The model takes the square of the leaves.
    let between = (state.shape.words() as u64).clamp(200, 2000);
    for step in 0..=steps {
        if step % between == 0 || step == steps {
            differs(&world, &state).unwrap_or_else(|why| {
                panic!("seed {seed}, fan-out {fan_out} of {plan:?}, step {step}: {why}")
            });
        }
        let event = state.event(&mut random);
        state.happen(&world, event, &mut random);
    }
    state
}

fn run_all(seeds: std::ops::Range<u64>, steps: u64) {
    for seed in seeds {
        let begun = std::time::Instant::now();
        let state = run(seed, steps);
        eprintln!(
            "seed {seed}: {} nodes, {} words, ranges {:?}, words {:?}, resident {:?}, {} sent, {:.1?}",
            state.shape.nodes(),
            state.shape.words(),
            state.of_ranges,
            state.of_words,
            state.of_resident,
            state.sent,
            begun.elapsed()
        );
    }
}

#[test]
fn the_twin_follows_the_rules_over_a_hundred_thousand_events() {
    run_all(0..12, 8_500);
}

#[test]
#[ignore = "minutes"]
fn the_twin_follows_the_rules_over_a_million_events() {
    run_all(12..36, 42_000);
}
