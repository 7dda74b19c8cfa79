//! How many slots are granted, and up to which ranks; twin of `shaders/choose.comp`.

use crate::twins::cache::{Answer, CacheRound, Choice};
use crate::twins::limits::RANK_NONE;
use crate::twins::tally::Tallied;

/// For as many wishes as the host has slots for none is granted. Wishes of the first rank may take slots of later ranks; others only slots that nobody needs, and of
/// those not so many that the next first rank would have to take them back.
pub fn choose(tallied: &Tallied, shape: &CacheRound) -> (Choice, Answer) {
    let Tallied { wishes_of_rank, live_of_rank, tallies } = tallied;
    let first = wishes_of_rank.iter().position(|wishes| *wishes > 0);
    let first_wishes = first.map_or(0, |rank| wishes_of_rank[rank]);
    let live_above = first.map_or(0, |rank| live_of_rank[rank + 1..].iter().sum::<u32>());
    let mut request_cut = 0;
    let mut wishes_up_to = 0;
    for (rank, wishes) in wishes_of_rank.iter().enumerate() {
        wishes_up_to += wishes;
        if wishes_up_to <= shape.requests_max || first == Some(rank) {
            request_cut = request_cut.max(rank as u32);
        }
    }
    let nearest = first_wishes.saturating_sub(shape.held).min(tallies.dead + live_above);
    let wanted = tallies.wished.saturating_sub(shape.held);
    let room = tallies.dead.min(shape.live_max.saturating_sub(tallies.live));
    let grants = nearest.max(wanted.min(room)).min(shape.grants_max);
    let dead_grants = grants.min(tallies.dead);
    let live_grants = grants - dead_grants;
    let mut victim_cut = RANK_NONE;
    if live_grants > 0 {
        let mut live = 0;
        let from_far = live_of_rank.iter().enumerate().rev();
        let cut = from_far.map(|(rank, count)| (rank, *count)).find(|(_, count)| {
            live += count;
            live >= live_grants
        });
        victim_cut = cut.map_or(RANK_NONE, |(rank, _)| rank as u32);
    }
    let answer = Answer {
        wished: tallies.wished,
        first_rank: first.map_or(RANK_NONE, |rank| rank as u32),
        first_wishes,
        dead: tallies.dead,
        live: tallies.live,
        grants,
        requests: 0,
        touched: 0,
    };
    (Choice { grants, dead_grants, request_cut, victim_cut }, answer)
}
