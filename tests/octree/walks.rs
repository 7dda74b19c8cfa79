//! Rays through the nodes of volumes of which something is known: each sample in one run, what is crossed
//! shows nothing, by f64 arithmetic on the voxels alone.

use ashfall::twins::fixed_point::Fixed3;
use ashfall::twins::octree::{box_of_node, node_of_voxel};
use ashfall::twins::octree_ranges::Ranges;
use ashfall::twins::octree_walk::{Action, Channel, Has, Ray, Run, at_voxel, walk};
use ashfall::volume::ValueRange;

use crate::random::Random;
use crate::state::{State, index, shows};
use crate::world::{PLANS, World};

/// From corner to centre origin, in the fixed point of rays.
fn fixed(position: [f64; 3]) -> Fixed3 {
    let whole = position.map(|at| (at * 4_294_967_296.0).floor() as i64);
    Fixed3 { cell: whole.map(|at| (at >> 32) as i32), fraction: whole.map(|at| at as u32) }
}

fn exact(value: Fixed3, axis: usize) -> f64 {
    f64::from(value.cell[axis]) + f64::from(value.fraction[axis]) / 4_294_967_296.0
}

/// From a random point of the hull on, as far as it goes.
pub fn ray(state: &State, random: &mut Random, level: usize) -> Ray {
    let size = state.shape.sizes[level].map(f64::from);
    let start: [f64; 3] = std::array::from_fn(|axis| random.unit() * size[axis] - 0.5);
    let mut direction: [f64; 3] = std::array::from_fn(|_| random.between(-1.0, 1.0));
    // Along an axis, too, and hardly along it.
    if random.once_in(4) {
        direction[random.index(3)] = random.one(&[0.0, 1e-7]);
        direction[random.index(3)] = 0.0;
    }
    let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt().max(1e-9);
    let step = random.between(0.1, 1.2);
    let delta = direction.map(|part| part / length * step);
    let leaves_after = (0..3).map(|axis| {
        let way =
            if delta[axis] > 0.0 { size[axis] - 0.5 - start[axis] } else { start[axis] + 0.5 };
        way / delta[axis].abs()
    });
    let samples = leaves_after.fold(3000.0, f64::min).floor() as u32;
    Ray { start: fixed(start), delta: fixed(delta), samples, level }
}

/// Centre of a sample in voxels of the ray's level, centre origin.
pub fn position(ray: &Ray, sample: u32) -> [f64; 3] {
    let at = |axis| exact(ray.start, axis) + f64::from(sample) * exact(ray.delta, axis);
    [at(0), at(1), at(2)]
}

/// Trilinear at a position of a ray, in the channel's own level; NaN where a corner is.
fn value(world: &World, state: &State, (channel, ray_level): (usize, usize), at: [f64; 3]) -> f64 {
    let of = &state.channels[channel];
    let level = drawn(world, state, channel, ray_level);
    let halvings = |level: usize| state.shape.trees[level].halvings;
    let scale = |level: usize, axis: usize| f64::from(1u32 << halvings(level)[axis]);
    let place: [f64; 3] = std::array::from_fn(|axis| {
        (at[axis] + 0.5) * scale(ray_level, axis) / scale(level, axis) - 0.5
    });
    let cell = place.map(|at| at.floor() as i64);
    let mut sum = 0.0;
    for corner in 0..8 {
        let bit = |axis: usize| corner >> axis & 1;
        let voxel = std::array::from_fn(|axis| cell[axis] + bit(axis));
        let weight = |axis: usize| {
            let within = place[axis] - cell[axis] as f64;
            if bit(axis) == 1 { within } else { 1.0 - within }
        };
        let part = weight(0) * weight(1) * weight(2);
        // A corner of no weight does not count, unless it is a hole.
        sum += part * f64::from(world.sources[of.source][level].at(voxel));
    }
    sum
}

fn drawn(world: &World, state: &State, channel: usize, ray_level: usize) -> usize {
    let last = state.shape.trees.len() - 1;
    let [from, to] = world.plan.channels[channel].map(|level| level.min(last));
    ray_level.clamp(from, to)
}

fn channels_of<'a>(world: &World, state: &'a State) -> Vec<Channel<'a>> {
    let last = state.shape.trees.len() - 1;
    state
        .channels
        .iter()
        .zip(world.plan.channels)
        .map(|(channel, levels)| Channel {
            resident: &channel.resident,
            levels: levels.map(|level| level.min(last)),
        })
        .collect()
}

pub fn walk_of(world: &World, state: &State, ray: &Ray) -> (Vec<Run>, u32) {
    walk(&state.shape, &state.words.of_leaf, &channels_of(world, state), ray)
}

/// What is wrong with a ray's runs.
pub fn wrong(world: &World, state: &State, ray: &Ray, runs: &[Run]) -> Result<(), String> {
    let mut next = 0;
    for run in runs {
        if run.first != next || run.end <= run.first {
            return Err(format!("{run:?} after sample {next}"));
        }
        next = run.end;
        for sample in run.first..run.end {
            let at = position(ray, sample);
            for channel in 0..state.channels.len() {
                let value = value(world, state, (channel, ray.level), at);
                let visible = !value.is_nan()
                    && shows(&state.channels[channel].intervals, ValueRange::of(value as f32));
                let what = || format!("sample {sample} of channel {channel}: {value} in {run:?}");
                match &run.action {
                    Action::Cross if visible => return Err(what()),
                    Action::OneValue(mask) if visible && mask >> channel & 1 == 0 => {
                        return Err(what());
                    }
                    Action::OneValue(mask) if !visible && mask >> channel & 1 == 1 => {
                        return Err(what());
                    }
                    Action::Take(has) => match has[channel] {
                        Has::Nothing if visible => return Err(what()),
                        Has::Nothing | Has::OneValue(_) => {}
                        Has::Level(level) => {
                            resident(world, state, (channel, ray), at, Some(level))?
                        }
                        Has::Missing => resident(world, state, (channel, ray), at, None)?,
                    },
                    _ => {}
                }
            }
        }
    }
    if next == ray.samples { Ok(()) } else { Err(format!("{next} of {} samples", ray.samples)) }
}

/// The finest level at or above the wanted one that is resident at a position is `level`; rounding may
/// take a sample to the brick beside.
fn resident(
    world: &World,
    state: &State,
    (channel, ray): (usize, &Ray),
    at: [f64; 3],
    level: Option<usize>,
) -> Result<(), String> {
    let wanted = drawn(world, state, channel, ray.level);
    let finest = |off: f64| {
        (wanted..state.shape.trees.len()).find(|level| {
            let bricks = state.shape.bricks(*level);
            let halvings = state.shape.trees[*level].halvings;
            let from = state.shape.trees[ray.level].halvings;
            let brick = std::array::from_fn(|axis| {
                let scale = f64::from(1u32 << halvings[axis]) / f64::from(1u32 << from[axis]);
                let payload = f64::from(world.plan.payload[axis]) * scale;
                let brick = ((at[axis] + 0.5 + off) / payload).max(0.0) as u32;
                brick.min(bricks[axis] - 1)
            });
            state.channels[channel].bricks[*level][index(&state.shape, *level, brick)].1
        })
    };
    let border = (0..3).any(|axis| {
        let beside = (at[axis] + 0.5).rem_euclid(1.0);
        !(1e-3..1.0 - 1e-3).contains(&beside)
    });
    // A channel that is drawn finer than the rays' level may have several bricks in one of theirs.
    let finer = wanted < ray.level;
    if border || finer || finest(0.0) == level {
        Ok(())
    } else {
        Err(format!("channel {channel} at {at:?}: {level:?} for {:?}", finest(0.0)))
    }
}

fn states(seed: u64) -> (World, Vec<State>) {
    let world = World::new(PLANS[seed as usize % PLANS.len()], seed);
    let mut states: Vec<State> = Vec::new();
    for fan_out in [2, 4] {
        let mut random = Random(seed);
        let mut state = State::new(&world, fan_out, &mut random);
        let events = 30 + seed * 60;
        for _ in 0..events {
            // Both meet the same events: they are drawn from one seed, and their shapes have the same bricks.
            let event = state.event(&mut random);
            state.happen(&world, event, &mut random);
        }
        states.push(state);
    }
    (world, states)
}

#[test]
fn every_sample_is_in_one_run_and_what_is_crossed_shows_nothing() {
    let (mut crossed, mut closed, mut taken, mut missing, mut reads) = (0, 0, 0, 0, 0u64);
    for seed in 0..30 {
        let (world, states) = states(seed);
        for state in &states {
            let mut random = Random(1000 + seed);
            for turn in 0..60 {
                let ray = ray(state, &mut random, turn % state.shape.trees.len());
                let (runs, read) = walk_of(&world, state, &ray);
                wrong(&world, state, &ray, &runs)
                    .unwrap_or_else(|why| panic!("seed {seed}, ray {turn} {ray:?}: {why}"));
                reads += u64::from(read);
                for run in &runs {
                    let samples = u64::from(run.end - run.first);
                    match &run.action {
                        Action::Cross => crossed += samples,
                        Action::OneValue(_) => closed += samples,
                        Action::Take(has) if has.contains(&Has::Missing) => missing += samples,
                        Action::Take(_) => taken += samples,
                    }
                }
            }
        }
    }
    eprintln!(
        "{crossed} crossed, {closed} closed, {taken} taken, {missing} missing, {reads} reads"
    );
    assert!([crossed, closed, taken, missing].iter().all(|count| *count > 500));
    assert!(reads < (crossed + closed + taken + missing) / 3);
}

#[test]
fn both_fan_outs_take_the_same_samples() {
    let mut compared = 0;
    for seed in 0..18 {
        let (world, states) = states(seed);
        let [two, four] = &states[..] else { unreachable!("two fan-outs") };
        let mut random = Random(2000 + seed);
        for turn in 0..60 {
            let level = turn % two.shape.trees.len();
            let alike = two.shape.leaf_edges(level) == four.shape.leaf_edges(level);
            let ray = ray(two, &mut random, level);
            let [two_runs, four_runs] = [two, four].map(|state| taken(&world, state, &ray));
            for sample in 0..ray.samples as usize {
                let at = position(&ray, sample as u32);
                // On a border of boxes rounding may choose either side.
                let border = at.iter().any(|at| {
                    let beside = (at + 0.5).rem_euclid(1.0);
                    !(1e-3..1.0 - 1e-3).contains(&beside)
                });
                if alike && !border {
                    compared += 1;
                    assert_eq!(
                        two_runs[sample], four_runs[sample],
                        "seed {seed}, {ray:?}, {sample}"
                    );
                }
            }
        }
    }
    eprintln!("{compared} samples compared");
    assert!(compared > 20_000, "{compared}");
}

#[test]
fn a_voxel_has_nothing_or_one_value_or_a_level_or_is_missing() {
    let mut counts = [0; 4];
    for seed in 0..18 {
        let (world, states) = states(seed);
        for state in &states {
            let mut random = Random(3000 + seed);
            let ranges: Vec<&Ranges> = state.channels.iter().map(|of| &of.ranges).collect();
            for turn in 0..200 {
                let level = turn % state.shape.trees.len();
                let voxel = state.shape.sizes[level].map(|edge| random.below(edge.into()) as i32);
                let channels = channels_of(&world, state);
                let words = &state.words.of_leaf;
                let got = at_voxel(&state.shape, words, &channels, &ranges, (level, voxel));
                let at = voxel.map(f64::from);
                for (channel, has) in got.iter().enumerate() {
                    let value = value(&world, state, (channel, level), at);
                    let intervals = &state.channels[channel].intervals;
                    let visible = shows(intervals, ValueRange::of(value as f32));
                    let ray = Ray { start: fixed(at), delta: fixed([0.0; 3]), samples: 1, level };
                    let what = format!("seed {seed}, {voxel:?} of level {level}: {has:?}, {value}");
                    match *has {
                        Has::Nothing => assert!(value.is_nan() || !visible, "{what}"),
                        Has::OneValue(one) => assert_eq!(f64::from(one), value, "{what}"),
                        Has::Level(_) | Has::Missing => {
                            let found =
                                if let Has::Level(level) = has { Some(*level) } else { None };
                            resident(&world, state, (channel, &ray), at, found)
                                .unwrap_or_else(|why| panic!("{what}: {why}"));
                        }
                    }
                    let kind = match has {
                        Has::Nothing => 0,
                        Has::OneValue(_) => 1,
                        Has::Level(_) => 2,
                        Has::Missing => 3,
                    };
                    counts[kind] += 1;
                }
            }
        }
    }
    eprintln!("{counts:?}");
    assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
}

/// Channels that show, for each sample.
fn taken(world: &World, state: &State, ray: &Ray) -> Vec<u32> {
    let (runs, _) = walk_of(world, state, ray);
    let mut of_sample = Vec::new();
    for run in &runs {
        let mask = match &run.action {
            Action::Cross => 0,
            Action::OneValue(mask) => *mask,
            Action::Take(has) => {
                let bit = |(at, has): (usize, &Has)| u32::from(*has != Has::Nothing) << at;
                has.iter().enumerate().map(bit).sum()
            }
        };
        of_sample.extend(std::iter::repeat_n(mask, (run.end - run.first) as usize));
    }
    of_sample
}

#[test]
fn a_ray_through_nothing_reads_hardly_a_word() {
    let plan = PLANS[0];
    let world = World::new(plan, 5);
    for fan_out in [2, 4] {
        let mut random = Random(5);
        let mut state = State::new(&world, fan_out, &mut random);
        for channel in &mut state.channels {
            channel.intervals.clear();
        }
        state.reclassify(&world);
        let root = state.shape.tiers.last().expect("a tier");
        let tree = &state.shape.trees[0];
        let node = node_of_voxel(state.shape.leaf, tree, root, [3; 3]);
        let (first, edge) = box_of_node(state.shape.leaf, tree, root, node);
        assert!((0..3).all(|axis| first[axis] == 0 && edge[axis] >= plan.size[axis] as i32));
        for _ in 0..50 {
            let ray = ray(&state, &mut random, 0);
            let (runs, reads) = walk_of(&world, &state, &ray);
            assert!(runs.iter().all(|run| run.action == Action::Cross));
            // One box of 32 leaves, and one more read where rounding leaves the last sample over.
            assert!(reads <= 2, "{reads} reads of {} samples", ray.samples);
        }
    }
}
