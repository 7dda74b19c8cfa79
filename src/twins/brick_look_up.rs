//! What a channel has in a brick, and what is wished for where it has nothing yet; twin of
//! `shaders/common/brick_look_up.glsl`, but for the papers' order.

use crate::twins::bits::each_bit;
use crate::twins::cache::Cache;
use crate::twins::filter::Texels;
use crate::twins::limits::{
    ENTRY_CONSTANT, ENTRY_EXPECTED, ENTRY_FAILED, ENTRY_MAPPED, ENTRY_PAYLOAD_MASK,
    ENTRY_STATE_SHIFT, ENTRY_UNMAPPED,
};
use crate::twins::octree::Leaves;
use crate::twins::ranks::{LevelView, place_of_brick};
use crate::twins::ray_block::MET_CHANNELS_SHIFT;
use crate::twins::transfer::TransferSegment;

/// A channel of one value per voxel, as the shader sees it.
pub struct Channel<'a> {
    /// The atlas's first entry, its channels, and this one among them.
    pub entry_first: u32,
    /// See `entry_first`.
    pub channels: u32,
    /// See `entry_first`.
    pub channel: u32,
    /// The atlas's first slot.
    pub slot_first: u32,
    /// Slots of the atlas along x and y.
    pub slots_across: [u32; 2],
    /// The atlas.
    pub atlas: Texels<'a, f32>,
    /// The channel's transfer function.
    pub segments: &'a [TransferSegment],
    /// Level that it is drawn at where rays are in a finer one.
    pub finest: u32,
    /// Of how many samples it takes one.
    pub sample_every: u32,
}

/// The scene as the shader sees it.
pub struct Scene<'a> {
    /// In the scene's order.
    pub channels: &'a [Channel<'a>],
    /// Of the view.
    pub levels: &'a [LevelView],
    /// Texels of bricks of one value.
    pub constants: &'a [[f32; 4]],
    /// Voxels of a brick along each axis.
    pub payload: [i32; 3],
    /// Texels of a slot along each axis.
    pub slot: [i32; 3],
    /// Bricks of nothing are crossed in one step.
    pub skipping: bool,
    /// Boxes of nothing are, and channels that show nothing in a run need no brick there.
    pub octree: Option<Leaves<'a>>,
    /// Boxes of one value are one sample.
    pub closed_form: bool,
}

/// What one channel has in a brick.
#[derive(Clone, Copy)]
pub struct Found {
    /// Its voxels, or what stands for them.
    pub has: Has,
    /// Of the brick itself, whatever stands in for it.
    pub state: u32,
    /// How many levels coarser what it has is, per axis.
    pub shift: [u32; 3],
}

/// Voxels of a channel in a brick.
#[derive(Clone, Copy)]
pub enum Has {
    /// It shows nothing there.
    Nothing,
    /// Everywhere this texel.
    Constant(f32),
    /// In a slot.
    Slot {
        /// The texel of the cell 0 of the brick's level, less 1.
        origin: [i32; 3],
    },
}

/// Marks what a ray that waits at a place needs of these channels; true where it has to wait.
pub fn mark_place(cache: &mut Cache, scene: &Scene, round: u32, place: u32, met: u32) -> bool {
    let mut waits = false;
    let channels = if scene.octree.is_some() { met >> MET_CHANNELS_SHIFT } else { u32::MAX };
    for at in each_bit(channels).take_while(|at| (*at as usize) < scene.channels.len()) {
        let channel = &scene.channels[at as usize];
        let entry = channel.entry_first + place * channel.channels + channel.channel;
        let value = cache.page_table[entry as usize];
        match value >> ENTRY_STATE_SHIFT {
            ENTRY_MAPPED => {
                let slot = (channel.slot_first + (value & ENTRY_PAYLOAD_MASK)) as usize;
                cache.slot_used[slot] = round;
                cache.slot_needed[slot] = round;
            }
            ENTRY_UNMAPPED => {
                cache.wished[(entry >> 5) as usize] |= 1 << (entry & 31);
                waits = true;
            }
            ENTRY_EXPECTED => waits = true,
            _ => {}
        }
    }
    waits
}

/// Entry of a channel's brick.
fn entry_of(scene: &Scene, channel: &Channel, level: usize, brick: [i32; 3]) -> usize {
    let place = place_of_brick(&scene.levels[level], brick);
    (channel.entry_first + place * channel.channels + channel.channel) as usize
}

/// What a channel has in a brick of a level.
pub fn look_up(
    cache: &mut Cache,
    scene: &Scene,
    channel: &Channel,
    (level, brick): (usize, [i32; 3]),
    round: u32,
) -> Found {
    let value = cache.page_table[entry_of(scene, channel, level, brick)];
    let (state, payload) = (value >> ENTRY_STATE_SHIFT, value & ENTRY_PAYLOAD_MASK);
    let has = match state {
        ENTRY_MAPPED => {
            cache.slot_used[(channel.slot_first + payload) as usize] = round;
            let [across, down] = channel.slots_across;
            let row = payload / across;
            let slot = [payload % across, row % down, row / down].map(|at| at as i32);
            let origin =
                std::array::from_fn(|a| slot[a] * scene.slot[a] - brick[a] * scene.payload[a]);
            Has::Slot { origin }
        }
        ENTRY_CONSTANT => Has::Constant(scene.constants[payload as usize][3]),
        _ => Has::Nothing,
    };
    Found { has, state, shift: [0; 3] }
}

/// As [`look_up`], at the channel's own level, but with what the finest coarser level has where the brick is not there; a brick that
/// nobody has asked for is wished for, as urgently as `weight` says.
pub fn substitute(
    cache: &mut Cache,
    scene: &Scene,
    channel: &Channel,
    (level, brick): (usize, [i32; 3]),
    round: u32,
    weight: u32,
) -> Found {
    let shift_to = |coarser: usize| -> [u32; 3] {
        let halvings = [coarser, level].map(|level| scene.levels[level].halvings);
        std::array::from_fn(|a| halvings[0][a] - halvings[1][a])
    };
    let above = |shift: [u32; 3]| std::array::from_fn(|a| brick[a] >> shift[a]);
    let own_level = level.max(channel.finest as usize);
    let shift = shift_to(own_level);
    let own_brick = above(shift);
    let found = look_up(cache, scene, channel, (own_level, own_brick), round);
    let mut found = Found { shift, ..found };
    let missed = found.state;
    if missed == ENTRY_UNMAPPED {
        let entry = entry_of(scene, channel, own_level, own_brick);
        cache.wished[entry >> 5] |= 1 << (entry & 31);
        cache.wish_weight[entry] += weight;
    }
    for coarser in own_level + 1..scene.levels.len() {
        if found.state > ENTRY_EXPECTED && found.state != ENTRY_FAILED {
            break;
        }
        let shift = shift_to(coarser);
        found = Found { shift, ..look_up(cache, scene, channel, (coarser, above(shift)), round) };
    }
    Found { state: missed, ..found }
}
