//! Faults of the shaders that march through bricks, each noticed by marching.rs.

use crate::faults::Fault;

/// In one level.
#[rustfmt::skip]
pub const FAULTS: &[Fault] = &[
    ("rays.comp", "block_of_ray[ray] = fresh_block(push.level);", "block_of_ray[ray] = fresh_block(0u);"),
    ("march_bricks.comp", "place = PLACE_RUNNING;\n        bool", "bool"),
    ("march_bricks.comp", "waits = place < PLACE_RUNNING;", "waits = false;"),
    ("march_bricks.comp", "atomicMin(round_progress.front, rank)", "atomicMax(round_progress.front, rank)"),
    ("march_bricks.comp", "push.last != 0u && (counted || !all_ended)", "push.last != 0u && counted"),
    ("common/brick_look_up.glsl", "return state <= ENTRY_EXPECTED;", "return state < ENTRY_EXPECTED;"),
    ("common/brick_look_up.glsl", "        round_needed[slot] = round;\n", "        round_needed[slot] = 0u;\n"),
    ("common/brick_look_up.glsl", "if (state == ENTRY_UNMAPPED) {\n        wish(entry);", "if (state <= ENTRY_EXPECTED) {\n        wish(entry);"),
    ("common/brick_march.glsl", "missing = missing || found.state <= ENTRY_EXPECTED;", "missing = found.state <= ENTRY_EXPECTED;"),
    ("common/brick_march.glsl", "nothing_here = nothing_here && found.has", "nothing_here = found.has"),
    ("common/brick_march.glsl", "(position + 0.5)) / (step_voxel + still)", "(position - 1.5)) / (step_voxel + still)"),
    ("common/brick_march.glsl", "mix(vec3(near), vec3(near + edge)", "mix(vec3(near + edge), vec3(near + edge)"),
    ("common/brick_march.glsl", "shown_to < known ? known : sample_index", "shown_to < known ? known + 3u : sample_index"),
    ("common/brick_march.glsl", "shown_to = shows ? end : shown_to;", "shown_to = shows ? end - 1u : shown_to;"),
    ("common/brick_march.glsl", "shown_to == 0u ? end : sample_index", "shown_to == 0u ? end + 1u : sample_index"),
    ("common/brick_march.glsl", "run < RUNS && known < samples && !missing", "run < RUNS && !missing"),
    ("common/brick_march.glsl", "if (run == 2u) { NAME##_2 = found; }", "if (run == 2u) { NAME##_1 = found; }"),
    ("common/brick_march.glsl", "sample_index > skipped ? sample_index - skipped : 0u", "0u"),
    ("common/brick_march.glsl", "partial.sample_index = state.next_sample < geometry.sample_count ? sample_index : 0u;", "partial.sample_index = 0u;"),
    ("common/brick_march.glsl", "partial.transmitted = block.transmitted;", "partial.transmitted = 1.0;"),
    ("common/brick_march.glsl", "if (attenuate(state.optical_depth).transmitted < early_stop)", "if (state.optical_depth > 0.0 && attenuate(state.optical_depth).transmitted < 2.0 * early_stop)"),
    ("common/brick_look_up.glsl", "found.origin += anchor_cell + 1;", "found.origin += anchor_cell;"),
    ("common/brick_march.glsl", "LEAVE_OUT_NAN(texel, classified) \\\n        classified.a = has == HAS_NOTHING ? 0.0 : classified.a; \\\n        mix_in(medium, classified.rgb", "mix_in(medium, classified.rgb"),
    ("common/brick_look_up.glsl", "round_used[slot_first + payload] = round;", "round_used[payload] = round;"),
    ("common/filter.glsl", "near.xz * without.x + near.yw", "near.xy * without.x + near.yw"),
    ("common/classify.glsl", "precise float lost = state.optical_depth_rest + ", "precise float lost = "),
];

/// Where levels change.
#[rustfmt::skip]
pub const FAULTS_OF_LEVELS: &[Fault] = &[
    ("march_bricks.comp", "                geometry_of_ray[ray] = geometry;\n", ""),
    ("march_bricks.comp", "ended && partial.level + 1u < LEVELS", "ended && partial.level + 2u < LEVELS"),
    ("march_bricks.comp", "in_level.per_scale_step.w, in_level.depth,", "in_level.per_scale_step.w, dvec2(in_level.depth.x, 1.0e300),"),
    ("march_bricks.comp", "push.tile.origin_pixel + pixel, push.volume_size", "pixel, push.volume_size"),
    ("march_bricks.comp", "                state.next_sample = 0u;\n", ""),
    ("common/brick_march.glsl", "                partial.level = LEVELS;\n", ""),
];

/// Where coarser levels stand in.
#[rustfmt::skip]
pub const FAULTS_OF_STAND_INS: &[Fault] = &[
    ("march_bricks.comp", "if (push.last != 0u && (block_of_ray[ray].met", "if (push.last > 1u && (block_of_ray[ray].met"),
    ("march_bricks.comp", "bool counted = all_ended && (partial.met & MET_PENDING) != 0u;", "bool counted = all_ended;"),
    ("common/brick_march.glsl", "1u + uint(transmitted * 255.0)", "1u + uint(transmitted * 254.0)"),
    ("common/brick_march.glsl", "attenuate(state.optical_depth).transmitted * block.transmitted", "attenuate(state.optical_depth).transmitted"),
    ("common/brick_look_up.glsl", "atomicAdd(weight_of_entry[entry], weight);", "weight_of_entry[entry] = weight;"),
    ("common/brick_look_up.glsl", "level_views[level].halvings;\n        ivec3 above", "0u;\n        ivec3 above"),
    ("common/brick_look_up.glsl", "ivec3 above = brick >> ivec3(shift);", "ivec3 above = (brick + 1) >> ivec3(shift);"),
    ("common/brick_look_up.glsl", "bool wanted = missed <= ENTRY_EXPECTED || missed == ENTRY_FAILED;", "bool wanted = missed <= ENTRY_EXPECTED;"),
    ("common/brick_look_up.glsl", "wanted = found.state <= ENTRY_EXPECTED || found.state == ENTRY_FAILED;", "wanted = found.state <= ENTRY_EXPECTED;"),
    ("common/brick_look_up.glsl", "    found.state = missed;\n", ""),
    ("common/brick_look_up.glsl", "        found.shift = shift;\n", "        found.shift = shift.zyx;\n"),
    ("common/brick_march.glsl", "partial.met |= missing ? MET_PENDING : 0u;", "partial.met = missing ? MET_PENDING : 0u;"),
    ("common/brick_march.glsl", "((rest + 0.5) + position)", "((rest + 0.25) + position)"),
    ("common/brick_march.glsl", "vec3(ivec3(1) << shift) - 0.5;", "vec3(ivec3(1) << shift) - 0.25;"),
    ("common/brick_march.glsl", "mix(position, coarse, notEqual(shift, ivec3(0)))", "coarse"),
];

/// Among the leaves of an octree.
#[rustfmt::skip]
pub const FAULTS_OF_OCTREE: &[Fault] = &[
    ("march_bricks.comp", "if ((channels & BIT) != 0u) { \\\n        waits = mark(", "{ \\\n        waits = mark("),
    ("common/octree.glsl", "(leaf.z * of_level.leaves.y + leaf.y)", "(leaf.z * of_level.leaves.x + leaf.y)"),
    ("common/octree.glsl", "shift = box.shows == 0u ? shift : min(shift, of_level.brick_shift);", ""),
    ("common/octree.glsl", "((leaf >> shift) << shift) * edge", "leaf * edge"),
    ("common/octree.glsl", "box.edge = ivec3(edge << shift);", "box.edge = ivec3(edge);"),
    ("common/brick_march.glsl", "bool seeks = block.depth == 0.0;", "bool seeks = true;"),
    ("common/brick_march.glsl", "end = shows ? min(end, samples) : end;", ""),
    ("common/brick_march.glsl", "shown &= bits_between(0u, known);", ""),
    ("common/brick_march.glsl", "run_end = begins.yzw;", "run_end = begins.xyz;"),
    ("common/brick_march.glsl", "known = missing ? first : known;", ""),
    ("common/brick_march.glsl", "lengths_world[which] = there ? geometry.step_world : 0.0;", "lengths_world[which] = geometry.step_world;"),
    ("common/brick_march.glsl", "(partial.met & MET_STATES) | (needed << MET_CHANNELS_SHIFT)", "partial.met | (needed << MET_CHANNELS_SHIFT)"),
    ("common/bits.glsl", "return below & ~left_out;", "return below;"),
];

/// Where channels take fewer samples than rays.
#[rustfmt::skip]
pub const FAULTS_OF_RATES: &[Fault] = &[
    ("common/classify.glsl", "samples) >> number & 1u", "samples) >> (number ^ 1u) & 1u"),
    ("common/classify.glsl", "number < (samples & ~(STEPS - 1u)) ? float(STEPS) : 1.0", "float(STEPS)"),
    ("common/classify.glsl", "return whole < 32u ? taken | 0xffffffffu << whole : taken;", "return taken;"),
    ("common/classify.glsl", "others.extinction + steps * medium.extinction", "steps * medium.extinction"),
    ("common/classify.glsl", "steps * medium.extinction);\n#endif", "medium.extinction);\n#endif"),
    ("common/brick_march.glsl", "sampled |= (box.shows & BIT) != 0u ? samples_taken_of(STEPS, SAMPLES, samples) : 0u;", "sampled |= samples_taken_of(STEPS, SAMPLES, samples);"),
    ("common/brick_march.glsl", "            here &= sampled;\n", ""),
    ("common/brick_march.glsl", "uint number = at;", "uint number = at + 1u;"),
    ("common/brick_march.glsl", "uint number = sample_index;", "uint number = sample_index - partial.sample_index;"),
];

/// Where boxes of one value are one sample.
#[rustfmt::skip]
pub const FAULTS_OF_CLOSED_FORM: &[Fault] = &[
    ("common/octree.glsl", "box.alike = (word & (1u << WORD_CHANNELS)) != 0u;", "box.alike = true;"),
    ("common/brick_march.glsl", "here & (here - 1u)", "here"),
    ("common/brick_march.glsl", "~(alike >> at >> 1u)", "~(alike >> at)"),
    ("common/brick_march.glsl", "        shown &= ~alike;\n", ""),
    ("common/brick_march.glsl", "shows && box.alike ?", "shows ?"),
];
