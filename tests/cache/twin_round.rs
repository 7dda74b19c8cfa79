//! A round of one atlas by the twins of all passes that manage the cache.

use ashfall::twins::cache::{Answer, Cache, CacheRound, Choice, ChunkCounts, Ranking};
use ashfall::twins::choose::choose;
use ashfall::twins::count::count;
use ashfall::twins::grant::{Lists, grant};
use ashfall::twins::scan::scan;
use ashfall::twins::tally::tally;

/// What the passes wrote beside the cache itself.
pub struct Outcome {
    pub choice: Choice,
    pub scanned: Vec<ChunkCounts>,
    pub answer: Answer,
    pub lists: Lists,
}

pub fn round(cache: &mut Cache, shape: &CacheRound, ranking: &Ranking) -> Outcome {
    let tallied = tally(cache, shape, ranking);
    let (choice, mut answer) = choose(&tallied, shape);
    let counts = count(cache, shape, ranking, &choice);
    let scanned = scan(&counts, shape, &mut answer);
    let lists = grant(cache, shape, ranking, &choice, &scanned, &mut answer);
    Outcome { choice, scanned, answer, lists }
}

/// How often rounds came to what is rare: a run that never does proves little.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Live slots were given up, some of the last rank and some beyond.
    pub live_grants: u32,
    pub parted_rank: u32,
    /// The guard held the grants below the nearest wishes.
    pub guarded: u32,
    /// Not all wishes were listed; not even all of the first rank.
    pub unlisted: u32,
    pub parted_requests: u32,
    /// Every slot was promised or live.
    pub full: u32,
}

impl Seen {
    pub fn add(&mut self, shape: &CacheRound, outcome: &Outcome) {
        let Outcome { choice, scanned, answer, .. } = outcome;
        let all = scanned[scanned.len() - 1];
        let live = choice.grants - choice.dead_grants;
        self.live_grants += u32::from(live > 0);
        self.parted_rank +=
            u32::from(live > all.above && live < all.above + all.at && all.above > 0);
        let first = answer.first_wishes.saturating_sub(shape.held);
        self.guarded += u32::from(answer.grants < first.min(shape.grants_max));
        self.unlisted += u32::from(answer.requests < answer.wished);
        self.parted_requests += u32::from(answer.requests < answer.first_wishes);
        self.full += u32::from(answer.dead == 0 && answer.live > 0);
    }

    /// Every one often enough.
    pub fn assert_all(&self, least: u32) {
        let Seen { live_grants, parted_rank, guarded, unlisted, parted_requests, full } = *self;
        let all = [live_grants, parted_rank, guarded, unlisted, parted_requests, full];
        assert!(all.iter().all(|times| *times >= least), "{self:?}");
    }
}
