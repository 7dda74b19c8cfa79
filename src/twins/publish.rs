//! Begins a round: what arrived becomes visible; twin of `shaders/publish.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::cache::{Cache, Progress};
use crate::twins::limits::{OWNER_FREE, RANK_NONE};

/// One thing that the host learned since the last round.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Update {
    /// Entry that changes; `OWNER_FREE`: none.
    pub entry: u32,
    /// Of the entry from now on.
    pub value: u32,
    /// Slot that changes its owner; `OWNER_FREE`: none.
    pub slot: u32,
    /// Of that slot from now on.
    pub owner: u32,
}

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Push {
    /// How many updates there are.
    pub update_count: u32,
}

/// Applies all updates; each entry and slot stands in one at most.
pub fn publish(cache: &mut Cache, updates: &[Update]) {
    cache.progress = Progress { front: RANK_NONE, ..Progress::default() };
    for update in updates {
        if update.entry != OWNER_FREE {
            cache.page_table[update.entry as usize] = update.value;
        }
        if update.slot != OWNER_FREE {
            cache.slot_owner[update.slot as usize] = update.owner;
        }
    }
}
