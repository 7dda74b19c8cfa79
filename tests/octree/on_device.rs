//! The pass that keeps place words, against its twin over long random runs, and faults planted in it.

use ashfall::gpu::Buffer;
use ashfall::passes::octree_resident::{Resources, record, variant};
use ashfall::twins::octree_resident::{CHANGES_MAX, Change, Places, Push, octree_resident};

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::shader_faults::{Fault, all_noticed};
use crate::world::{PLANS, Plan};
use ashfall::volume::VoxelFormat;

/// Behind the words: what is written there is seen.
const BEHIND: usize = 8;
const CHANNELS: u32 = 3;

/// Many more bricks than lanes, at several levels.
const LARGE: Plan = Plan {
    size: [200, 130, 70],
    spacing: [1.0, 1.0, 2.0],
    payload: [8; 3],
    leaf: [8; 3],
    format: VoxelFormat::U8,
    channels: &[[0, 31]],
};

struct Run {
    places: Vec<Places>,
    words: Vec<u32>,
    /// Of every channel, level and brick: whether it is there.
    there: std::collections::BTreeSet<(u32, u32, [u32; 3])>,
}

impl Run {
    /// Bricks that come and go at random, each once.
    fn changes(&mut self, random: &mut Random) -> Vec<Change> {
        let mut changes = Vec::new();
        let mut met = std::collections::BTreeSet::new();
        // Now and then more than one dispatch takes.
        let many = random.once_in(10);
        let count = if many { 2 * u64::from(CHANGES_MAX) } else { random.below(150) };
        for _ in 0..count {
            let channel = random.below(CHANNELS.into()) as u32;
            let level = random.index(self.places.len()) as u32;
            // Coarse ones are few: once in four times any level, else the finest.
            let level = if random.once_in(4) { level } else { 0 };
            let brick = self.places[level as usize].bricks.map(|n| random.below(n.into()) as u32);
            let key = (channel, level, brick);
            if !met.insert(key) {
                continue;
            }
            let here = self.there.remove(&key);
            if !here {
                self.there.insert(key);
            }
            let first_word = channel * (self.words.len() as u32 / CHANNELS);
            let there = u32::from(!here);
            changes.push(Change { brick, level, first_word, there, ..Change::default() });
        }
        changes
    }
}

fn run(device: &Device, seed: u64, plan: Plan, rounds: u32) -> Result<u64, String> {
    let shape = plan.shape(2);
    let places = Places::of(&shape);
    let count = places.last().map_or(0, |last| last.first + last.bricks.iter().product::<u32>());
    let words = vec![0u32; (count * CHANNELS) as usize];
    let mut run = Run { places, words, there: Default::default() };
    let mut random = Random(seed);
    let pipeline = device.pipeline(&variant());
    let resident = device.filled("resident", &[&run.words[..], &[7; BEHIND]].concat());
    let of_levels = device.filled("places_of_levels", &run.places);
    let mut operations = 0;
    for round in 0..rounds {
        let changes = run.changes(&mut random);
        if changes.is_empty() {
            continue;
        }
        operations += changes.len() as u64;
        let list: Buffer = device.filled("changes", &changes);
        let resources =
            Resources { places_of_levels: &of_levels, changes: &list, resident: &resident };
        device.run(|recorder| {
            for first in (0..changes.len() as u32).step_by(CHANGES_MAX as usize) {
                let push = Push {
                    first_change: first,
                    change_count: CHANGES_MAX.min(changes.len() as u32 - first),
                    level_count: run.places.len() as u32,
                };
                record(recorder, &pipeline, &resources, &push);
            }
            recorder.host_read(&resident);
        });
        octree_resident(&run.places, &mut run.words, &changes, &mut Default::default());
        let got: Vec<u32> = device.values(&resident);
        let wanted = [&run.words[..], &[7; BEHIND]].concat();
        if let Some(at) = (0..got.len()).find(|at| got[*at] != wanted[*at]) {
            return Err(format!(
                "seed {seed}, round {round} of {plan:?}: word {at} is {:b} for {:b}",
                got[at], wanted[at]
            ));
        }
    }
    Ok(operations)
}

#[test]
fn the_shader_equals_the_twin_over_random_runs() {
    let Some(device) = device() else { return };
    for (seed, plan) in (700..).zip(PLANS.iter().chain([&LARGE])) {
        let begun = std::time::Instant::now();
        let changes = run(&device, seed, *plan, 60).unwrap_or_else(|why| panic!("{why}"));
        eprintln!("{:?}: {changes} changes, {:.1?}", plan.size, begun.elapsed());
    }
}

#[rustfmt::skip]
const FAULTS: &[Fault] = &[
    ("octree_resident.comp", "brick.z * places.bricks.y", "brick.z * places.bricks.x"),
    ("octree_resident.comp", "level <= change.level; ++level", "level < change.level; ++level"),
    ("octree_resident.comp", "<< shift, places.bricks) - start", "<< shift, places.bricks + 1u) - start"),
    ("octree_resident.comp", "for (uint at = lane; at < count;", "for (uint at = lane + 1u; at < count;"),
    ("octree_resident.comp", "for (uint step = 1u;", "for (uint step = 2u;"),
    ("octree_resident.comp", "level < push.level_count &&", "level + 1u < push.level_count &&"),
    ("octree_resident.comp", "min((at + 1u) << halved, finer.bricks)", "min(at << halved, finer.bricks)"),
    ("octree_resident.comp", "ended |= other ? 0u : 1u << turn;", "ended |= other ? 0u : 2u << turn;"),
    ("octree_resident.comp", "ended |= other ? 0u : 1u << turn;", "ended |= other ? 1u << turn : 0u;"),
    ("octree_resident.comp", "change_of[push.first_change + index];\n        uvec3", "change_of[index];\n        uvec3"),
    ("octree_resident.comp", "return first_word + places.first", "return places.first"),
];

#[test]
fn planted_faults_are_noticed() {
    let Some(mut device) = device() else { return };
    let plans = [PLANS[0], LARGE];
    for plan in plans {
        run(&device, 800, plan, 40).unwrap_or_else(|why| panic!("{why}"));
    }
    all_noticed(&mut device, FAULTS, |device| {
        plans.iter().find_map(|plan| run(device, 800, *plan, 40).err())
    });
}
