//! One atlas's cache as plain data, and what the passes that manage it share; twin of
//! `shaders/common/cache.glsl`.

use bytemuck::{Pod, Zeroable};

use crate::twins::limits::{CHUNK_SLOTS, CHUNK_WORDS, ENTRY_STATE_SHIFT};

pub use crate::twins::ranking::Ranking;

/// One atlas in the buffers that all atlases share, and this round: the push constants of the passes
/// that manage the cache.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct CacheRound {
    /// Counts from 1.
    pub round: u32,
    /// The atlas's first slot.
    pub slot_first: u32,
    /// Its slots.
    pub slot_count: u32,
    /// Its first entry; a place's entries stand together, one per channel of the atlas.
    pub entry_first: u32,
    /// Channels of the atlas.
    pub channels: u32,
    /// Its first word of wishes: one bit per entry.
    pub word_first: u32,
    /// Its words of wishes.
    pub word_count: u32,
    /// How many ranks the view has.
    pub ranks: u32,
    /// Slots that the host can take this round.
    pub grants_max: u32,
    /// Requests that the list holds.
    pub requests_max: u32,
    /// The atlas's first place in the list of grants.
    pub grant_first: u32,
    /// The atlas's first place in the list of requests.
    pub request_first: u32,
    /// Its number.
    pub atlas: u32,
    /// Slots that bricks behind the nearest wish may fill.
    pub live_max: u32,
    /// Slots that the host has no brick for: as many wishes need none.
    pub held: u32,
}

impl CacheRound {
    /// Threads of tally, count and grant.
    pub fn chunks(&self) -> u32 {
        self.slot_count.div_ceil(CHUNK_SLOTS) + self.word_count.div_ceil(CHUNK_WORDS)
    }
}

/// Wishes and slots before anything is chosen.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Tallies {
    /// Slots that nobody needs.
    pub dead: u32,
    /// Slots that some ray may need again.
    pub live: u32,
    /// Wishes.
    pub wished: u32,
    /// Nothing.
    pub unused_0: u32,
}

/// How many slots are granted, and up to which ranks.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Choice {
    /// Slots granted.
    pub grants: u32,
    /// Of them those that nobody needs.
    pub dead_grants: u32,
    /// Greatest rank of a request that is listed.
    pub request_cut: u32,
    /// Least rank of a slot that is given up though it may be needed again.
    pub victim_cut: u32,
}

/// Of one chunk of slots or wishes; after scan: of all chunks before it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct ChunkCounts {
    /// Slots not used this round.
    pub unused: u32,
    /// Of them those that nobody needs.
    pub dead_unused: u32,
    /// Slots used this round that nobody needs any more.
    pub dead_used: u32,
    /// Slots whose rank is above the victim cut.
    pub above: u32,
    /// Slots whose rank is the victim cut.
    pub at: u32,
    /// Wishes to be listed.
    pub requests: u32,
    /// Nothing.
    pub unused_0: u32,
    /// Nothing.
    pub unused_1: u32,
}

/// How far the rays of a round have come.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Progress {
    /// Least rank at which a ray waits or stands; `RANK_NONE`: every ray has ended.
    pub front: u32,
    /// Rays that wait for a brick; in substitute refinement: that took a coarser one.
    pub waiting: u32,
    /// Rays that used up the round's steps.
    pub running: u32,
    /// Rays that did not wait all the round, once per dispatch.
    pub moved: u32,
}

/// What a round tells the host of one atlas.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Answer {
    /// Wishes.
    pub wished: u32,
    /// Least rank of a wish; `RANK_NONE`: there is none.
    pub first_rank: u32,
    /// Wishes of that rank.
    pub first_wishes: u32,
    /// Slots that nobody needs.
    pub dead: u32,
    /// Slots that may be needed again.
    pub live: u32,
    /// In the list of grants.
    pub grants: u32,
    /// In the list of requests.
    pub requests: u32,
    /// Bricks that rays used for the first time since the list of them was cleared.
    pub touched: u32,
}

/// Every buffer of the cache, as the device has it, and the lists of one round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cache {
    /// `[entry]`
    pub page_table: Vec<u32>,
    /// `[slot]`
    pub slot_owner: Vec<u32>,
    /// `[slot]`
    pub slot_used: Vec<u32>,
    /// `[slot]`
    pub slot_needed: Vec<u32>,
    /// `[slot]` least recently used first.
    pub usage_order: Vec<u32>,
    /// `[word]` one bit per entry.
    pub wished: Vec<u32>,
    /// `[entry]` in substitute refinement.
    pub wish_weight: Vec<u32>,
    /// `[word]` one bit per entry.
    pub touched: Vec<u32>,
    /// Of the rays.
    pub progress: Progress,
}

/// `state` and `payload` as a page-table entry.
pub const fn entry(state: u32, payload: u32) -> u32 {
    state << ENTRY_STATE_SHIFT | payload
}

/// Numbers of the bits set in a chunk of words of wishes, ascending.
pub fn wishes_of_chunk(cache: &Cache, shape: &CacheRound, chunk: u32) -> Vec<u32> {
    let start = chunk * CHUNK_WORDS;
    let end = (start + CHUNK_WORDS).min(shape.word_count);
    (start..end)
        .flat_map(|word| {
            let bits = cache.wished[(shape.word_first + word) as usize];
            (0..32).filter(move |bit| bits >> bit & 1 != 0).map(move |bit| word * 32 + bit)
        })
        .collect()
}

/// Places in the usage order of a chunk of slots.
pub fn slots_of_chunk(shape: &CacheRound, chunk: u32) -> std::ops::Range<u32> {
    chunk * CHUNK_SLOTS..((chunk + 1) * CHUNK_SLOTS).min(shape.slot_count)
}
