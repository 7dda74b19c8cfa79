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
    /// Nothing.
    pub unused_0: u32,
}

/// Unmaps the channel's bricks, all of them or those that have no slot.
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
        let owner = &mut cache.slot_owner[slot as usize];
        if *owner < OWNER_GRANTED && (*owner - push.entry_first) % push.channels == push.channel {
            *owner = OWNER_FREE;
        }
    }
}
