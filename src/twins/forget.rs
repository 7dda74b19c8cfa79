//! Forgets what stands in the entries of one channel of an atlas; twin of `shaders/forget.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::cache::Cache;
use crate::twins::limits::{
    ENTRY_MAPPED, ENTRY_STATE_SHIFT, ENTRY_UNMAPPED, OWNER_FREE, OWNER_GRANTED,
};

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Push {
    /// Of the atlas.
    pub entry_first: u32,
    /// Of the atlas.
    pub channels: u32,
    /// Counts within the atlas.
    pub channel: u32,
    /// Bricks of all levels.
    pub places: u32,
    /// Of the atlas.
    pub slot_first: u32,
    /// Of the atlas.
    pub slot_count: u32,
    /// 1: the same voxels as before, bricks that are there stay.
    pub keep: u32,
    /// Counts from 1.
    pub round: u32,
}

/// Unmaps the channel's bricks, all of them or those that have no slot. Slots of other bricks count as used,
/// so that free ones are given away first.
pub fn forget(cache: &mut Cache, push: &Push) {
    for place in 0..push.places {
        let entry = push.entry_first + place * push.channels + push.channel;
        let entry = &mut cache.page_table[entry as usize];
        if push.keep == 0 || *entry >> ENTRY_STATE_SHIFT != ENTRY_MAPPED {
            *entry = ENTRY_UNMAPPED << ENTRY_STATE_SHIFT;
        }
    }
    if push.keep != 0 {
        return;
    }
    for slot in push.slot_first..push.slot_first + push.slot_count {
        let (at, owner) = (slot as usize, cache.slot_owner[slot as usize]);
        if owner < OWNER_GRANTED {
            let forgotten = (owner - push.entry_first) % push.channels == push.channel;
            cache.slot_owner[at] = if forgotten { OWNER_FREE } else { owner };
            cache.slot_used[at] = if forgotten { 0 } else { push.round };
        }
    }
}
