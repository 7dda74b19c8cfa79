//! How many slots and wishes there are of each rank; twin of `shaders/tally.comp`.

use crate::twins::cache::{Cache, CacheRound, Ranking, Tallies, wishes_of_chunk};
use crate::twins::limits::{CHUNK_WORDS, SLOT_DEAD, SLOT_PROMISED};

/// Counts by rank.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tallied {
    /// `[rank]`
    pub wishes_of_rank: Vec<u32>,
    /// `[rank]` slots that may be needed again.
    pub live_of_rank: Vec<u32>,
    /// All ranks together.
    pub tallies: Tallies,
}

/// Counts slots and wishes of an atlas.
pub fn tally(cache: &Cache, shape: &CacheRound, ranking: &Ranking) -> Tallied {
    let ranks = shape.ranks as usize;
    let mut tallied = Tallied {
        wishes_of_rank: vec![0; ranks],
        live_of_rank: vec![0; ranks],
        tallies: Tallies::default(),
    };
    for slot in shape.slot_first..shape.slot_first + shape.slot_count {
        match ranking.rank_of_slot(cache, shape, slot) {
            SLOT_DEAD => tallied.tallies.dead += 1,
            SLOT_PROMISED => {}
            rank => {
                tallied.tallies.live += 1;
                tallied.live_of_rank[rank as usize] += 1;
            }
        }
    }
    for chunk in 0..shape.word_count.div_ceil(CHUNK_WORDS) {
        for entry in wishes_of_chunk(cache, shape, chunk) {
            let rank = ranking.rank_of_wish(cache, shape, entry);
            if rank < shape.ranks {
                tallied.tallies.wished += 1;
                tallied.wishes_of_rank[rank as usize] += 1;
            }
        }
    }
    tallied
}
