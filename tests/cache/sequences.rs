//! The cache's shaders against their twins over long random runs, and faults planted in the shaders.

use ashfall::twins::publish::publish;

use crate::common::device::{Device, device};
use crate::faults::{Fault, all_noticed};
use crate::host::Host;
use crate::invariants::{Before, holds};
use crate::model::PLANS;
use crate::on_device::{CacheOnDevice, compare};
use crate::random::Random;
use crate::twin_round::{self, Seen};
use crate::world::{Plan, World, chance};

/// 2,000 slots, 5 levels and 3 channels; and more chunks than scan has lanes.
const LARGE: &[Plan] = &[
    Plan {
        levels: &[[24, 20, 18], [12, 10, 9], [6, 5, 5], [3, 3, 3], [2, 2, 2]],
        atlases: &[(3, 2000)],
        substitute: false,
    },
    Plan {
        levels: &[[64, 30, 18], [32, 15, 9], [16, 8, 5]],
        atlases: &[(1, 700), (2, 2100)],
        substitute: false,
    },
    Plan {
        levels: &[[24, 20, 18], [12, 10, 9], [6, 5, 5], [3, 3, 3], [2, 2, 2]],
        atlases: &[(2, 1100), (1, 40)],
        substitute: true,
    },
];

/// How many rounds went well, or what did not.
fn run(
    device: &Device,
    seed: u64,
    plan: Plan,
    operations: u64,
    seen: &mut Seen,
) -> Result<u64, String> {
    let world = World::new(plan);
    let mut random = Random(seed);
    let (mut cache, mut host) = (world.cache(), Host::new(&world));
    let mut view = world.view(&mut random);
    let mut on_device = CacheOnDevice::new(device, &world, &cache);
    let exact = !plan.substitute;
    for round in 1.. {
        if host.operations >= operations {
            return Ok(u64::from(round));
        }
        let what = |why: String| format!("seed {seed} of {plan:?}, round {round}: {why}");
        if chance(&mut random, 0.05) {
            view = world.view(&mut random);
        }
        let updates = host.updates(&mut random, &world, &cache);
        publish(&mut cache, &updates);
        on_device.publish(&view, &updates, round as usize % 2);
        let got = on_device.read().map_err(what)?;
        compare(&got, &cache, exact).map_err(|why| what(format!("publish: {why}")))?;

        host.marks(&mut random, &world, &view, &mut cache, (round, false));
        on_device.mark(&cache);
        let atlases = 0..world.atlases.len();
        let shapes: Vec<_> =
            atlases.map(|atlas| world.shape(&mut random, atlas, round, &view)).collect();
        on_device.round(&shapes);
        let (mut outcomes, mut guards) = (Vec::new(), Vec::new());
        for (atlas, shape) in shapes.iter().enumerate() {
            guards.push(Before::of(&cache, &world, &view, shape));
            let outcome = twin_round::round(&mut cache, shape, &world.ranking(&view));
            seen.add(shape, &outcome);
            host.takes(atlas, &outcome.lists, &cache);
            outcomes.push(outcome);
        }
        let got = on_device.read().map_err(what)?;
        on_device.compare(&got, &cache, &shapes, &outcomes).map_err(what)?;
        holds(&got, &world, &host).map_err(what)?;
        for (guard, outcome) in guards.iter().zip(&outcomes) {
            guard.guarded(&outcome.lists, &outcome.answer).map_err(what)?;
        }
    }
    unreachable!()
}

fn run_all(seed: u64, small: u64, large: u64) {
    let Some(device) = device() else { return };
    let mut seen = Seen::default();
    // Of the smallest world a round holds hardly an operation.
    let small = |plan: &Plan| if plan.levels == PLANS[0].levels { small / 10 } else { small };
    let plans =
        PLANS.iter().map(|plan| (plan, small(plan))).chain(LARGE.iter().map(|p| (p, large)));
    for (seed, (plan, operations)) in (seed..).zip(plans) {
        let begun = std::time::Instant::now();
        let rounds = run(&device, seed, *plan, operations, &mut seen);
        let rounds = rounds.unwrap_or_else(|why| panic!("{why}"));
        eprintln!("{plan:?}: {operations} operations, {rounds} rounds, {:.1?}", begun.elapsed());
    }
    eprintln!("{seen:?}");
    seen.assert_all(20);
}

#[test]
fn shaders_equal_the_twins_over_a_hundred_thousand_operations() {
    run_all(300, 40_000, 40_000);
}

#[test]
#[ignore = "minutes"]
fn shaders_equal_the_twins_over_a_million_operations() {
    for seed in (400..).step_by(20).take(3) {
        run_all(seed, 50_000, 50_000);
    }
}

#[rustfmt::skip]
const FAULTS: &[Fault] = &[
    ("publish.comp", "= update.value;", "= update.value | 1u;"),
    ("publish.comp", "Progress(RANK_NONE, 0u, 0u, 0u)", "Progress(0u, 0u, 0u, 0u)"),
    ("common/ranking.glsl", "rank < front || ", ""),
    ("common/ranking.glsl", "rank < front ", "rank <= front "),
    ("common/ranking.glsl", "round_needed[slot] != cache.round", "round_needed[slot] > cache.round"),
    ("common/ranking.glsl", "(owner - cache.entry_first)", "owner"),
    ("common/ranks.glsl", "level = place >= ", "level = place > "),
    ("common/ranking.glsl", "& 3u;", "& 1u;"),
    ("tally.comp", "if (rank < cache.ranks) {", "{"),
    ("choose.comp", "bool first = wishes_up_to == 0u", "bool first = wishes_up_to <= 1u"),
    ("choose.comp", "tally.live - live_up_to", "tally.live - live_before"),
    ("choose.comp", "wishes_up_to <= cache.requests_max", "wishes_up_to < cache.requests_max"),
    ("choose.comp", "first || wishes_up_to <=", "wishes_up_to <="),
    ("choose.comp", "if (live_from >= live_grants)", "if (live_from > live_grants)"),
    ("choose.comp", "tally.live - live_before;", "tally.live;"),
    ("choose.comp", "atomicMax(victim_cut, rank)", "atomicMin(victim_cut, rank)"),
    ("choose.comp", "min(dead, cache.live_max - tally.live)", "dead"),
    ("choose.comp", "first_wishes - min(first_wishes, cache.held)", "first_wishes"),
    ("choose.comp", "tally.wished - min(tally.wished, cache.held)", "tally.wished"),
    ("choose.comp", "live_of[rank] = 0u;", "live_of[rank] &= 1u;"),
    ("choose.comp", "tally = Tallies(0u, 0u, 0u, 0u);", "tally = Tallies(0u, tally.live, 0u, 0u);"),
    ("count.comp", "counts.above += rank > ", "counts.above += rank >= "),
    ("count.comp", "counts.dead_used += used ?", "counts.dead_used += !used ?"),
    ("scan.comp", "other < lane", "other + 1u < lane"),
    ("scan.comp", "min(before.requests, cache.requests_max)", "before.requests"),
    ("grant.comp", "all.unused + index - before.unused", "all.unused + before.dead_used"),
    ("grant.comp", "used ? all.dead_unused + before.dead_used : before.dead_unused", "before.dead_unused + before.dead_used"),
    ("grant.comp", "entries[owner] = ENTRY_UNMAPPED <<", "entries[owner] = ENTRY_EXPECTED <<"),
    ("grant.comp", "owner_of_slot[slot] = OWNER_GRANTED;", "owner_of_slot[slot] = OWNER_FREE;"),
    ("grant.comp", "chosen.dead_grants + all.above + before.at", "chosen.dead_grants + before.at"),
    ("grant.comp", "wishes_in_word[cache.word_first + word] = 0u;", "wishes_in_word[cache.word_first + word] &= 1u;"),
    ("grant.comp", "request < cache.requests_max", "request <= cache.requests_max"),
    ("grant.comp", "rank <= chosen.request_cut", "rank < chosen.request_cut"),
    ("grant.comp", "weight_of_entry[cache.entry_first + entry] = 0u;", "weight_of_entry[entry] = 0u;"),
    ("grant.comp", "(atomicOr(touched_in_word[owner >> 5u], bit) & bit) == 0u", "(atomicOr(touched_in_word[owner >> 5u], bit) | bit) != 0u"),
];

/// Each fault is noticed by some short run.
#[test]
fn planted_faults_are_noticed() {
    let Some(mut device) = device() else { return };
    // Least work first. Without a fault there is nothing to notice.
    let plans = [PLANS[2], PLANS[4], PLANS[3], PLANS[1], LARGE[1]];
    for plan in plans {
        run(&device, 500, plan, 8_000, &mut Seen::default()).unwrap_or_else(|why| panic!("{why}"));
    }
    all_noticed(&mut device, FAULTS, |device| {
        let runs = (500..504).flat_map(|seed| plans.map(|plan| (seed, plan)));
        let mut wrong =
            runs.map(|(seed, plan)| run(device, seed, plan, 8_000, &mut Seen::default()));
        wrong.find_map(Result::err)
    });
}
