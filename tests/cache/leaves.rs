//! A residency octree over the random volumes of brick_scene.rs: words that know nothing, and words that
//! know every leaf's voxels.

use ashfall::passes::brick_shape::OctreeShape;
use ashfall::twins::octree::{Leaves, LevelLeaves, Nodes, bits_of_word, packed};
use ashfall::twins::octree_ranges::{Coding, Ranges, Work, update_ranges};
use ashfall::twins::octree_shape::{Shape, Wanted};
use ashfall::twins::octree_words::{Shown, Words};
use ashfall::volume::{Levels, Size3, ValueRange};

/// See the module.
pub struct LeafWords {
    leaf: [u32; 3],
    pub levels: Vec<LevelLeaves>,
    pub bits: u32,
    /// Of which nothing is known; of which all is.
    pub words: [Vec<u32>; 2],
}

impl LeafWords {
    /// Of `channels` channels, drawn at levels `finest` where rays are in finer ones; `of_box` says which values lie in a box of voxels, ends excluded, of a level
    /// and channel, and nothing where no voxels are.
    pub fn new(
        levels: &Levels,
        payload: [u32; 3],
        (channels, finest): (usize, &[u32]),
        visible: f32,
        of_box: impl Fn(usize, usize, [i64; 3], [i64; 3]) -> Option<ValueRange>,
    ) -> LeafWords {
        let wanted = Wanted { leaf: [2; 3], fan_out: 2, nodes_max: u64::MAX };
        let shape = Shape::new(levels, Size3::from_array(payload), &wanted).expect("few nodes");
        let mut work = Work::default();
        let mut ranges = vec![Ranges::unknown(Coding::Float, shape.nodes()); channels];
        for (channel, ranges) in ranges.iter_mut().enumerate() {
            for (level, tree) in shape.trees.iter().enumerate() {
                let edge = shape.leaf_edges(level);
                let of = |leaf: [u32; 3]| {
                    let start: [i64; 3] = std::array::from_fn(|a| i64::from(leaf[a] * edge[a]) - 1);
                    let end = |a: usize| {
                        let end = ((leaf[a] + 1) * edge[a]).min(shape.sizes[level][a]);
                        i64::from(end) + 1
                    };
                    let range = of_box(level, channel, start, std::array::from_fn(end));
                    range.unwrap_or_else(|| Coding::Float.unknown())
                };
                let all = Nodes::all(shape.lowest(tree));
                update_ranges(&shape, level, ranges, all, of, &mut work);
            }
        }
        let shows = |range: ValueRange| range.greatest >= visible;
        let shown = |(at, ranges)| {
            let finest = finest.get(at).map_or(0, |finest| *finest as usize);
            Shown { ranges, shows: &shows, levels: [finest, 31] }
        };
        let shown: Vec<_> = ranges.iter().enumerate().map(shown).collect();
        let unknown = Words::unknown(&shape, channels);
        let mut known = unknown.clone();
        for (level, tree) in shape.trees.iter().enumerate() {
            let all = Nodes::all(shape.lowest(tree));
            known.update(&shape, &shown, level, all, &mut work);
        }
        let bits = bits_of_word(channels as u32);
        let words = [unknown, known].map(|words| {
            let mut all = vec![0; words.of_leaf.len().div_ceil(32 / bits as usize)];
            for (at, word) in words.of_leaf.iter().enumerate() {
                let bit = at as u32 * bits;
                all[(bit / 32) as usize] |= packed(*word, bits) << (bit % 32);
            }
            all
        });
        LeafWords { leaf: shape.leaf, levels: shape.level_leaves(), bits, words }
    }

    pub fn shape(&self) -> OctreeShape {
        OctreeShape { leaf: self.leaf, word_bits: self.bits, ancestors: false }
    }

    pub fn leaves(&self, known: bool) -> Leaves<'_> {
        let words = &self.words[usize::from(known)];
        Leaves { leaf: self.leaf, levels: &self.levels, words, bits: self.bits }
    }
}
