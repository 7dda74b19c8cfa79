//! What each chunk of slots and wishes adds to the lists; twin of `shaders/count.comp`.

use crate::twins::cache::{
    Cache, CacheRound, Choice, ChunkCounts, Ranking, slots_of_chunk, wishes_of_chunk,
};
use crate::twins::limits::{CHUNK_SLOTS, CHUNK_WORDS, RANK_NONE, SLOT_DEAD, SLOT_PROMISED};

/// Counts of every chunk of slots, then of wishes.
pub fn count(
    cache: &Cache,
    shape: &CacheRound,
    ranking: &Ranking,
    choice: &Choice,
) -> Vec<ChunkCounts> {
    let of_slots = (0..shape.slot_count.div_ceil(CHUNK_SLOTS)).map(|chunk| {
        let mut counts = ChunkCounts::default();
        for index in slots_of_chunk(shape, chunk) {
            let slot = cache.usage_order[(shape.slot_first + index) as usize];
            let used = cache.slot_used[slot as usize] == shape.round;
            counts.unused += u32::from(!used);
            match ranking.rank_of_slot(cache, shape, slot) {
                SLOT_DEAD if used => counts.dead_used += 1,
                SLOT_DEAD => counts.dead_unused += 1,
                SLOT_PROMISED => {}
                _ if choice.victim_cut == RANK_NONE => {}
                rank => {
                    counts.above += u32::from(rank > choice.victim_cut);
                    counts.at += u32::from(rank == choice.victim_cut);
                }
            }
        }
        counts
    });
    let of_wishes = (0..shape.word_count.div_ceil(CHUNK_WORDS)).map(|chunk| {
        let ranks = wishes_of_chunk(cache, shape, chunk)
            .into_iter()
            .map(|entry| ranking.rank_of_wish(cache, shape, entry));
        let requests = ranks.filter(|rank| *rank <= choice.request_cut).count();
        ChunkCounts { requests: requests as u32, ..ChunkCounts::default() }
    });
    of_slots.chain(of_wishes).collect()
}
