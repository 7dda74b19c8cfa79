//! Gives slots to the host and lists what it should load; twin of `shaders/grant.comp`.

use crate::twins::cache::{
    Answer, Cache, CacheRound, Choice, ChunkCounts, Ranking, entry, slots_of_chunk, wishes_of_chunk,
};
use crate::twins::limits::{
    CHUNK_SLOTS, CHUNK_WORDS, ENTRY_UNMAPPED, OWNER_FREE, OWNER_GRANTED, RANK_NONE, SLOT_DEAD,
    SLOT_PROMISED,
};

/// What the host reads after a round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lists {
    /// Slots for the host.
    pub grants: Vec<u32>,
    /// Entry and rank of bricks to load, in the order of entries.
    pub requests: Vec<[u32; 2]>,
}

/// Grants and lists; the usage order is made anew, wishes are cleared. `scanned` as from scan.
pub fn grant(
    cache: &mut Cache,
    shape: &CacheRound,
    ranking: &Ranking,
    choice: &Choice,
    scanned: &[ChunkCounts],
    answer: &mut Answer,
) -> Lists {
    let all = scanned[scanned.len() - 1];
    let slot_chunks = shape.slot_count.div_ceil(CHUNK_SLOTS);
    let mut order_next = cache.usage_order.clone();
    let mut lists = Lists {
        grants: vec![0; choice.grants as usize],
        requests: vec![[0; 2]; answer.requests as usize],
    };
    for chunk in 0..slot_chunks {
        let mut before = scanned[chunk as usize];
        for index in slots_of_chunk(shape, chunk) {
            let slot = cache.usage_order[(shape.slot_first + index) as usize];
            let owner = cache.slot_owner[slot as usize];
            let used = cache.slot_used[slot as usize] == shape.round;
            let place = if used { all.unused + index - before.unused } else { before.unused };
            before.unused += u32::from(!used);
            order_next[(shape.slot_first + place) as usize] = slot;
            if used && owner < OWNER_GRANTED {
                let (word, bit) = ((owner >> 5) as usize, 1 << (owner & 31));
                answer.touched += u32::from(cache.touched[word] & bit == 0);
                cache.touched[word] |= bit;
            }
            let granted = match ranking.rank_of_slot(cache, shape, slot) {
                SLOT_DEAD => {
                    let number =
                        if used { all.dead_unused + before.dead_used } else { before.dead_unused };
                    before.dead_used += u32::from(used);
                    before.dead_unused += u32::from(!used);
                    (number < choice.dead_grants).then_some(number)
                }
                SLOT_PROMISED => None,
                _ if choice.victim_cut == RANK_NONE => None,
                rank if rank > choice.victim_cut => {
                    before.above += 1;
                    Some(choice.dead_grants + before.above - 1)
                }
                rank if rank == choice.victim_cut => {
                    before.at += 1;
                    Some(choice.dead_grants + all.above + before.at - 1)
                }
                _ => None,
            };
            let Some(granted) = granted.filter(|number| *number < choice.grants) else { continue };
            if owner != OWNER_FREE {
                cache.page_table[owner as usize] = entry(ENTRY_UNMAPPED, 0);
            }
            cache.slot_owner[slot as usize] = OWNER_GRANTED;
            lists.grants[granted as usize] = slot;
        }
    }
    for chunk in 0..shape.word_count.div_ceil(CHUNK_WORDS) {
        let mut request = scanned[(slot_chunks + chunk) as usize].requests;
        for wish in wishes_of_chunk(cache, shape, chunk) {
            let rank = ranking.rank_of_wish(cache, shape, wish);
            if rank <= choice.request_cut {
                if request < shape.requests_max {
                    lists.requests[request as usize] = [shape.entry_first + wish, rank];
                }
                request += 1;
            }
            if ranking.substitute {
                cache.wish_weight[(shape.entry_first + wish) as usize] = 0;
            }
        }
    }
    let (first, count) = (shape.word_first as usize, shape.word_count as usize);
    cache.wished[first..first + count].fill(0);
    cache.usage_order = order_next;
    lists
}
