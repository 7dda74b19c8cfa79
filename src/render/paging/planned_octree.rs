//! What a residency octree takes, as plans say it.

use serde::Serialize;

use crate::render::paging::leaf_words::LeafWords;
use crate::render::paging::plan::PagingPlan;
use crate::twins::octree::bits_of_word;
use crate::twins::octree_ranges::Coding;

/// See the module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedOctree {
    /// Voxels along the edges of a leaf.
    pub leaf: [u32; 3],
    /// Channels that have a bit in every word.
    pub channels: usize,
    /// Leaves of the trees of all levels.
    pub leaves: u64,
    /// Bits of a leaf's word.
    pub word_bits: u32,
    /// Device memory of all words, bytes.
    pub device_bytes: u64,
    /// Host memory of ranges and words, bytes, out of ram_mib.
    pub host_bytes: u64,
}

impl PagingPlan {
    /// Nothing where rays use no octree.
    pub fn planned_octree(&self) -> Option<PlannedOctree> {
        let octree = self.octree.as_ref()?;
        let channels = self.numbers.channels.len();
        let codings: Vec<Coding> =
            self.judges.values().map(|judge| Coding::of(judge.format)).collect();
        Some(PlannedOctree {
            leaf: octree.leaf,
            channels,
            leaves: octree.words() as u64,
            word_bits: bits_of_word(channels as u32),
            device_bytes: LeafWords::bytes(octree, channels),
            host_bytes: LeafWords::host_bytes(octree, &codings),
        })
    }
}
