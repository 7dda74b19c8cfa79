//! What a residency consists of, before any of it is made.

use crate::gpu::{BufferSpec, MemoryHome, Variant};
use crate::passes::brick_shape::AtlasShape;
use crate::passes::cache_buffers::RankShape;
use crate::passes::{choose, count, grant, publish, scan, tally};
use crate::residency::atlas_layout::AtlasLayout;
use crate::twins::cache::{Answer, CacheRound, Choice, ChunkCounts, Progress, Tallies};
use crate::twins::limits::{CHUNK_SLOTS, CHUNK_WORDS, WEIGHT_RANKS};
use crate::twins::publish::Update;
use crate::twins::ranks::LevelView;

/// Entries of an atlas begin at multiples of this: a chunk of wishes never holds two atlases'.
pub const ENTRY_ALIGNMENT: u32 = CHUNK_WORDS * 32;

/// One atlas of a residency.
#[derive(Clone, Copy, Debug)]
pub struct AtlasPlan {
    /// Its image.
    pub layout: AtlasLayout,
    /// Its place in the buffers that all atlases share.
    pub shape: AtlasShape,
    /// Its entries.
    pub entry_count: u32,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct ResidencyShape {
    /// How bricks are ranked.
    pub ranks: RankShape,
    /// Ranks of any view, at most.
    pub rank_count: u32,
    /// One per texel format.
    pub atlases: Vec<AtlasPlan>,
    /// Slots that one round grants in one atlas, at most.
    pub grants_max: u32,
    /// Requests that one round lists in one atlas, at most.
    pub requests_max: u32,
    /// Updates that one round publishes, at most.
    pub updates_max: u32,
}

impl ResidencyShape {
    /// Entries of all atlases together.
    pub fn entries(&self) -> u32 {
        let end = |atlas: &AtlasPlan| atlas.shape.entry_first + atlas.entry_count;
        self.atlases.last().map_or(0, end).next_multiple_of(ENTRY_ALIGNMENT)
    }

    /// Slots of all atlases together.
    pub fn slots(&self) -> u32 {
        self.atlases.iter().map(|atlas| atlas.layout.slot_count()).sum()
    }

    /// Ranks that the buffers hold.
    pub fn ranks_held(&self) -> u32 {
        if self.ranks.order.weighs() { WEIGHT_RANKS } else { self.rank_count }
    }

    /// Every buffer, in the order in which [`super::Residency`] takes them.
    pub fn buffers(&self) -> Vec<BufferSpec> {
        let words = |count: u32| u64::from(count) * 4;
        let chunks = self.atlases.iter().map(|atlas| {
            atlas.layout.slot_count().div_ceil(CHUNK_SLOTS)
                + atlas.entry_count.div_ceil(ENTRY_ALIGNMENT)
                + 1
        });
        let atlases = self.atlases.len() as u32;
        let of = |count: u32, bytes: usize| u64::from(count) * bytes as u64;
        let list = |name, bytes, home| BufferSpec { name, bytes, home };
        let mut specs = Vec::new();
        let device = [
            ("page_table", words(self.entries())),
            ("slot_owner", words(self.slots())),
            ("slot_used", words(self.slots())),
            ("usage_order_0", words(self.slots())),
            ("usage_order_1", words(self.slots())),
            ("wished", words(self.entries() / 32)),
            ("touched", words(self.entries() / 32)),
            ("progress", size_of::<Progress>() as u64),
            ("wishes_of_rank", words(self.ranks_held())),
            ("live_of_rank", words(self.ranks_held())),
            ("tallies", size_of::<Tallies>() as u64),
            ("choice", size_of::<Choice>() as u64),
            ("chunk_counts", of(chunks.max().unwrap_or(1), size_of::<ChunkCounts>())),
            ("answers", of(atlases, size_of::<Answer>())),
        ];
        specs.extend(device.map(|(name, bytes)| list(name, bytes, MemoryHome::Device)));
        specs.push(if self.ranks.order.weighs() {
            list("wish_weight", words(self.entries()), MemoryHome::Device)
        } else {
            list("slot_needed", words(self.slots()), MemoryHome::Device)
        });
        let report = size_of::<Progress>() as u64 + of(atlases, size_of::<Answer>());
        specs.extend([
            list("grants", words(self.grants_max * atlases), MemoryHome::Readback),
            list("requests", of(self.requests_max * atlases, 8), MemoryHome::Readback),
            list("report", report, MemoryHome::Readback),
        ]);
        let updates = of(self.updates_max, size_of::<Update>());
        let levels = of(self.ranks.levels, size_of::<LevelView>());
        specs.extend([
            list("updates_0", updates, MemoryHome::Upload),
            list("updates_1", updates, MemoryHome::Upload),
            list("levels", levels, MemoryHome::Upload),
        ]);
        specs
    }

    /// The passes that manage the cache, in the order of a round.
    pub fn variants(&self) -> [Variant; 6] {
        [
            publish::variant(),
            tally::variant(self.ranks),
            choose::variant(),
            count::variant(self.ranks),
            scan::variant(),
            grant::variant(self.ranks),
        ]
    }

    /// What the passes are told of an atlas in a round.
    pub fn round_of(&self, number: usize, round: u32, ranks: u32) -> CacheRound {
        let AtlasPlan { layout, shape, entry_count } = self.atlases[number];
        CacheRound {
            round,
            slot_first: shape.slot_first,
            slot_count: layout.slot_count(),
            entry_first: shape.entry_first,
            channels: shape.channels,
            word_first: shape.entry_first / 32,
            word_count: entry_count.div_ceil(32),
            ranks: if self.ranks.order.weighs() { WEIGHT_RANKS } else { ranks },
            grants_max: self.grants_max,
            requests_max: self.requests_max,
            grant_first: number as u32 * self.grants_max,
            request_first: number as u32 * self.requests_max,
            atlas: number as u32,
            live_max: layout.slot_count(),
            held: 0,
        }
    }
}
