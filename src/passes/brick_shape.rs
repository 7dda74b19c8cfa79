//! What shapes the shader that marches through bricks: only what the scene has gets into it.

use crate::gpu::Variant;
use crate::passes::cache_buffers::{RankOrder, RankShape};
use crate::passes::march_shape::Shape;
use crate::twins::limits::BLOCK_SAMPLES;

/// Where an atlas stands in the buffers that all atlases share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AtlasShape {
    /// Its first entry; a place's entries stand together, one per channel of the atlas.
    pub entry_first: u32,
    /// Its channels.
    pub channels: u32,
    /// Its first slot.
    pub slot_first: u32,
    /// Slots along x and y.
    pub slots_across: [u32; 2],
}

/// How the leaves of a residency octree lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct OctreeShape {
    /// Voxels along the edges of a leaf of level 0.
    pub leaf: [u32; 3],
    /// Bits of a leaf's word: 8, 16 or 32.
    pub word_bits: u32,
    /// Whether a brick is sampled only where all coarser ones around it are resident: for a bench.
    pub ancestors: bool,
}

/// What shapes the variant.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct BrickShape {
    /// Channels, filter, early stop, NaN: as without bricks.
    pub march: Shape,
    /// For each channel its atlas and its number in there.
    pub places: Vec<(usize, u32)>,
    /// One per texel format.
    pub atlases: Vec<AtlasShape>,
    /// How bricks are ranked.
    pub ranks: RankShape,
    /// For each channel the level that it is drawn at where rays are in a finer one; for substitution alone.
    pub finest: Vec<u32>,
    /// Whether some view uses several levels.
    pub several_levels: bool,
    /// Views of the scene.
    pub views: usize,
    /// Whether bricks of nothing are crossed in one step.
    pub skipping: bool,
    /// Whether boxes of nothing are, and how leaves lie.
    pub octree: Option<OctreeShape>,
    /// Whether boxes of one value are crossed in one sample; with an octree alone.
    pub closed_form: bool,
    /// Whether rays remember what they met.
    pub show_states: bool,
    /// Whether rays mark the slots that they use: off for `bench overhead` alone.
    pub marks: bool,
    /// Voxels of a brick along each axis.
    pub payload: [u32; 3],
    /// Texels of a slot along each axis.
    pub slot: [u32; 3],
}

/// Runs of samples in one brick that a ray looks up at a time; as in brick_march.glsl.
const RUNS: u32 = 4;

impl BrickShape {
    /// Turns of all loops of the shader over one block of samples, at most. Loops over coarser levels are
    /// left out: a ray that often takes what stands in has few samples in all.
    pub fn turns_of_block(&self) -> u32 {
        let channels = self.places.len() as u32;
        let boxes = match self.octree {
            Some(OctreeShape { ancestors: true, .. }) => {
                BLOCK_SAMPLES + RUNS * channels * (1 + self.ranks.levels)
            }
            Some(_) => BLOCK_SAMPLES + RUNS * channels,
            None => 0,
        };
        self.march.turns_of_block() + RUNS + boxes
    }

    /// Whether some channel is drawn at another level than rays are in.
    pub fn channel_levels(&self) -> bool {
        self.finest.iter().any(|finest| *finest > 0)
    }

    /// The variant of march_bricks.
    pub fn variant(&self) -> Variant {
        let (mut declare, mut look_up, mut mark) = (String::new(), String::new(), String::new());
        for (index, (atlas, channel)) in self.places.iter().enumerate() {
            let AtlasShape { entry_first, channels, slot_first, slots_across: [x, y] } =
                self.atlases[*atlas];
            let finest = self.finest.get(index).copied().unwrap_or(0);
            let bit = 1u32.checked_shl(index as u32).unwrap_or(0);
            declare += &format!("FOUND(channel_{index}) ");
            look_up += &format!(
                "LOOK_UP(channel_{index}, {bit}u, {entry_first}u, {channels}u, {channel}u, {slot_first}u, uvec2({x}, {y}), {finest}u) "
            );
            mark +=
                &format!("MARK({bit}u, {entry_first}u, {channels}u, {channel}u, {slot_first}u) ");
        }
        let triple = |[x, y, z]: [u32; 3]| format!("uvec3({x}, {y}, {z})");
        let atlas_of_channel: Vec<_> = self.places.iter().map(|(atlas, _)| *atlas).collect();
        let mut variant = Variant::plain("march_bricks").define("LEVELS", self.ranks.levels);
        if self.ranks.order.weighs() {
            variant = variant.define("WEIGHTS", 1);
        }
        if self.ranks.order == RankOrder::Substitute {
            variant = variant.define("SUBSTITUTE", 1);
        }
        let variant = self
            .march
            .define(variant, &declare, &atlas_of_channel)
            .define("LOOK_UP_CHANNELS", look_up.trim_end())
            .define("MARK_CHANNELS", mark.trim_end())
            .define("ATLASES", self.atlases.len())
            .define("PAYLOAD", triple(self.payload))
            .define("SLOT", triple(self.slot));
        let mut flags = vec![
            ("SKIPPING", self.skipping && self.octree.is_none()),
            ("CLOSED_FORM", self.closed_form),
            ("SHOW_STATES", self.show_states),
            ("UNMARKED", !self.marks),
            ("CHANNEL_LEVELS", self.channel_levels()),
        ];
        flags.retain(|(_, defined)| *defined);
        let mut variant = flags.iter().fold(variant, |variant, (name, _)| variant.define(*name, 1));
        if let Some(octree) = self.octree {
            variant = variant
                .define("OCTREE", 1)
                .define("LEAF", triple(octree.leaf))
                .define("WORD_BITS", octree.word_bits);
            if octree.ancestors {
                variant = variant.define("ANCESTORS", 1);
            }
        }
        if self.several_levels {
            variant = variant.define("SEVERAL_LEVELS", 1).define("VIEWS", self.views);
        }
        variant
    }
}
