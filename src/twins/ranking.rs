//! Whether a slot may be given up, and how urgent a wish is; twin of `shaders/common/ranking.glsl` but for
//! the papers' order, which is there to show where it stands still.

use crate::twins::cache::{Cache, CacheRound};
use crate::twins::limits::{OWNER_FREE, OWNER_GRANTED, SLOT_DEAD, SLOT_PROMISED, WEIGHT_RANKS};
use crate::twins::ranks::{LevelView, level_of_place, rank_of_place};

/// How the cache ranks.
#[derive(Clone, Copy, Debug)]
pub struct Ranking<'a> {
    /// Of the view.
    pub levels: &'a [LevelView],
    /// Wishes by weight; slots by use, but what this round used stays.
    pub substitute: bool,
}

impl Ranking<'_> {
    /// SLOT_DEAD, SLOT_PROMISED, or the rank at which the slot's brick may still be needed.
    pub fn rank_of_slot(&self, cache: &Cache, shape: &CacheRound, slot: u32) -> u32 {
        let at = slot as usize;
        let owner = match cache.slot_owner[at] {
            OWNER_GRANTED => return SLOT_PROMISED,
            OWNER_FREE => return SLOT_DEAD,
            owner => owner,
        };
        let place = (owner - shape.entry_first) / shape.channels;
        if self.substitute {
            let held = self.levels[level_of_place(self.levels, place)].held != 0;
            let stays = held || cache.slot_used[at] == shape.round;
            return if stays { 0 } else { SLOT_DEAD };
        }
        let (rank, front) = (rank_of_place(self.levels, place), cache.progress.front);
        let passed = rank < front || (rank == front && cache.slot_needed[at] != shape.round);
        if rank >= shape.ranks || passed { SLOT_DEAD } else { rank }
    }

    /// `entry` counts from the atlas's first.
    pub fn rank_of_wish(&self, cache: &Cache, shape: &CacheRound, entry: u32) -> u32 {
        if !self.substitute {
            return rank_of_place(self.levels, entry / shape.channels);
        }
        let weight = cache.wish_weight[(shape.entry_first + entry) as usize].max(1);
        let doublings = 31 - weight.leading_zeros();
        let quarter = match doublings.checked_sub(2) {
            Some(shift) => weight >> shift,
            None => weight << (2 - doublings),
        };
        WEIGHT_RANKS - 1 - (doublings * 4 + (quarter & 3))
    }
}
