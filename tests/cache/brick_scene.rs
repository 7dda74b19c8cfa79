//! Small random volumes cut into bricks, which lie in random slots of atlases.

use ashfall::gpu::{Image, ImageFormat};
use ashfall::passes::brick_shape::{AtlasShape, BrickShape};
use ashfall::passes::cache_buffers::{RankOrder, RankShape};
use ashfall::passes::march_shape::{ChannelShape, FilterShape, MacrocellUse, Shape};
use ashfall::render::open_both_ends;
use ashfall::twins::brick_look_up::{Channel, Scene};
use ashfall::twins::filter::Texels;
use ashfall::twins::ranks::LevelView;
use ashfall::twins::ray_march;
use ashfall::twins::transfer::TransferSegment;
use ashfall::volume::{Levels, Size3, ValueRange};

use crate::common::device::Device;
use crate::leaves::LeafWords;
use crate::random::Random;
use crate::world::{Brick, Plan, World, below, chance, draw};

/// What a scene is made of, and what its shader can do.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    pub size: [u32; 3],
    pub payload: [u32; 3],
    /// The finest in use.
    pub level: usize,
    /// How many are in use, as the way along a ray grows.
    pub levels: usize,
    /// Coarser levels stand in for what is missing.
    pub substitute: bool,
    /// Channels of each atlas.
    pub atlases: &'static [u32],
    pub filter: FilterShape,
    pub early_stop: Option<f32>,
    /// Some voxels are NaN.
    pub holes: bool,
    pub segments: u32,
    pub preintegrated: bool,
    /// Level that each channel is drawn at where rays are in a finer one; of those that are not listed 0.
    pub finest: &'static [u32],
    /// Of how many samples each channel takes one; of those that are not listed 1.
    pub sample_every: &'static [u32],
    /// Boxes of one value are one sample, and there are some.
    pub closed_form: bool,
}

/// What a ray leaves out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipping {
    Nothing,
    Bricks,
    Boxes,
}

pub struct BrickScene {
    pub spec: Spec,
    pub levels: Levels,
    pub world: World,
    /// Atlas and number in there of each channel.
    pub places: Vec<(usize, u32)>,
    /// Voxels of each level that bricks are of, with an apron of the repeated edge, of each channel.
    voxels: Vec<Vec<Vec<f32>>>,
    pub segments: Vec<Vec<TransferSegment>>,
    slots_across: [u32; 3],
    /// Of each atlas.
    texels: Vec<Vec<f32>>,
    /// `[entry]` slot within the atlas where the brick's voxels lie.
    pub slot_of_entry: Vec<u32>,
    /// `[entry]` the brick shows nothing.
    pub is_nothing: Vec<bool>,
    pub constants: Vec<[f32; 4]>,
    pub leaf_words: LeafWords,
}

impl Spec {
    /// Levels that bricks are of.
    pub fn brick_levels(&self, levels: &Levels) -> std::ops::Range<usize> {
        self.level..if self.substitute { levels.count() } else { self.level + self.levels }
    }
}

/// Voxels of levels: two axes are reduced before the third.
const SPACING: [f64; 3] = [1.0, 1.0, 1.7];
/// Values below this are invisible.
const VISIBLE: f32 = 0.3;
/// In texels that nobody may read: no picture survives it.
const NONSENSE: f32 = 1.0e37;

impl BrickScene {
    pub fn new(random: &mut Random, spec: Spec) -> BrickScene {
        let Spec { size, payload, .. } = spec;
        let [payload_size, size] = [payload, size].map(Size3::from_array);
        let several = spec.substitute || spec.levels > 1;
        let spacing = if several { SPACING } else { [1.0; 3] };
        let levels = Levels::of(size, spacing, payload_size);
        let of_bricks = spec.brick_levels(&levels);
        assert!(of_bricks.end <= levels.count() && !of_bricks.is_empty(), "{spec:?}");
        let bricks = |level: ashfall::volume::Level| {
            let size = level.size.to_array();
            std::array::from_fn(|axis| size[axis].div_ceil(payload[axis]))
        };
        let bricks: Vec<[u32; 3]> = levels.iter().map(bricks).collect();
        let voxel_size = |level: usize| levels.get(level as u8).expect("it").size.to_array();
        let of_channel: u32 =
            bricks[of_bricks.clone()].iter().map(|bricks| bricks.iter().product::<u32>()).sum();
        let most = of_channel * spec.atlases.iter().max().unwrap();
        let slots_across = [5, 3, (most + 4).div_ceil(15)];
        let slots = slots_across.iter().product();
        let atlases: Vec<(u32, u32)> = spec.atlases.iter().map(|c| (*c, slots)).collect();
        let world = World::new(Plan {
            levels: bricks.leak(),
            atlases: atlases.leak(),
            substitute: spec.substitute,
        });
        let mut places: Vec<(usize, u32)> = Vec::new();
        for (atlas, channels) in spec.atlases.iter().enumerate() {
            places.extend((0..*channels).map(|channel| (atlas, channel)));
        }
        places.sort_by_key(|(atlas, channel)| (*channel, *atlas));
        // Nothing is where no channel has anything.
        let blocks = below(random, 1 << 20);
        // Now and then channels have nothing in places of their own.
        let apart = u32::from(places.len() > 1 && !spec.substitute && chance(random, 0.5));
        let mut of_level = |level| -> Vec<_> {
            let size = voxel_size(level);
            let of_channel = |channel| blocks + apart * channel;
            let channels = (0..places.len() as u32).map(of_channel);
            channels.map(|blocks| random_voxels(random, blocks, size, &spec)).collect()
        };
        let voxels: Vec<_> = of_bricks.clone().map(&mut of_level).collect();
        let sizes: Vec<_> = of_bricks.clone().map(voxel_size).collect();
        let mut segments: Vec<_> =
            places.iter().map(|_| transfer(random, spec.segments, spec.holes)).collect();
        if spec.preintegrated {
            segments.iter_mut().for_each(open_both_ends);
        }
        let leaf_words = LeafWords::new(
            &levels,
            spec.payload,
            (places.len(), spec.finest),
            VISIBLE,
            |level, channel, start, end| {
                let at = level.checked_sub(spec.level)?;
                let voxels = &voxels.get(at)?[channel];
                Some(range_in_box(voxels, sizes[at], start, end))
            },
        );
        let texels_of_slot = payload.iter().map(|edge| edge + 2).product::<u32>();
        let mut scene = BrickScene {
            spec,
            texels: vec![vec![NONSENSE; (slots * texels_of_slot) as usize]; spec.atlases.len()],
            slot_of_entry: vec![0; world.entries as usize],
            is_nothing: vec![false; world.entries as usize],
            constants: (0..8).map(|_| [0; 4].map(|_| random.unit() as f32)).collect(),
            levels,
            world,
            places,
            voxels,
            segments,
            slots_across,
            leaf_words,
        };
        scene.constants[7] = [f32::NAN; 4];
        let mut free = vec![(0..slots).collect::<Vec<u32>>(); spec.atlases.len()];
        for entry in 0..scene.world.entries {
            let brick = scene.world.bricks[entry as usize];
            if let Some(brick) = brick.filter(|brick| of_bricks.contains(&brick.level)) {
                let atlas = scene.atlas_of(entry);
                let slot = draw(random, &mut free[atlas]).expect("slots for all");
                scene.place(entry, atlas, slot, sizes[brick.level - of_bricks.start]);
            }
        }
        scene
    }

    pub fn atlas_of(&self, entry: u32) -> usize {
        self.world.atlases.iter().rposition(|shape| entry >= shape.entry_first).expect("an atlas")
    }

    fn slot_size(&self) -> [u32; 3] {
        self.spec.payload.map(|edge| edge + 2)
    }

    fn atlas_size(&self) -> [u32; 3] {
        let slot = self.slot_size();
        std::array::from_fn(|axis| self.slots_across[axis] * slot[axis])
    }

    /// Copies a brick's voxels, apron included, into its slot.
    fn place(&mut self, entry: u32, atlas: usize, slot: u32, size: [u32; 3]) {
        let shape = self.world.atlases[atlas];
        let number = (entry - shape.entry_first) % shape.channels;
        let channel = self.places.iter().position(|p| *p == (atlas, number)).expect("a channel");
        let Brick { level, brick } = self.world.bricks[entry as usize].expect("a brick");
        let voxels = &self.voxels[level - self.spec.level][channel];
        let [across, down, _] = self.slots_across;
        let slot_at = [slot % across, slot / across % down, slot / across / down];
        let (slot_size, [width, height, _]) = (self.slot_size(), self.atlas_size());
        let mut visible = false;
        for z in 0..slot_size[2] {
            for y in 0..slot_size[1] {
                for x in 0..slot_size[0] {
                    let local = [x, y, z];
                    // As in the image with its apron: one more than the voxel.
                    let at: [u32; 3] =
                        std::array::from_fn(|a| brick[a] * self.spec.payload[a] + local[a]);
                    if (0..3).any(|axis| at[axis] > size[axis] + 1) {
                        continue;
                    }
                    let row = at[2] * (size[1] + 2) + at[1];
                    let voxel = voxels[(row * (size[0] + 2) + at[0]) as usize];
                    visible |= voxel >= VISIBLE;
                    let to: [u32; 3] =
                        std::array::from_fn(|a| slot_at[a] * slot_size[a] + local[a]);
                    let texel = (to[2] * height + to[1]) * width + to[0];
                    self.texels[atlas][texel as usize] = voxel;
                }
            }
        }
        self.slot_of_entry[entry as usize] = slot;
        self.is_nothing[entry as usize] = !visible;
    }

    pub fn shape(&self, skipping: Skipping) -> BrickShape {
        let atlas = |shape: &ashfall::twins::cache::CacheRound| AtlasShape {
            entry_first: shape.entry_first,
            channels: shape.channels,
            slot_first: shape.slot_first,
            slots_across: [self.slots_across[0], self.slots_across[1]],
        };
        let channel = ChannelShape::Scalar { segments: self.segments[0].len() as u32 };
        BrickShape {
            march: Shape {
                channels: vec![channel; self.places.len()],
                filter: self.spec.filter,
                early_stop: self.spec.early_stop.is_some(),
                nan_voxels: true,
                preintegrated: self.spec.preintegrated,
                macrocells: MacrocellUse::Unused,
                sample_every: self.spec.sample_every.to_vec(),
            },
            places: self.places.clone(),
            atlases: self.world.atlases.iter().map(atlas).collect(),
            ranks: RankShape {
                levels: self.levels.count() as u32,
                order: match self.spec.substitute {
                    true => RankOrder::Substitute,
                    false => RankOrder::Guarded,
                },
            },
            finest: self.spec.finest.to_vec(),
            several_levels: self.spec.levels > 1,
            views: 1,
            skipping: skipping == Skipping::Bricks,
            octree: (skipping == Skipping::Boxes).then(|| self.leaf_words.shape()),
            closed_form: self.spec.closed_form && skipping == Skipping::Boxes,
            show_states: true,
            marks: true,
            payload: self.spec.payload,
            slot: self.slot_size(),
        }
    }

    pub fn images(&self, device: &Device) -> Vec<Image> {
        let size = self.atlas_size();
        let image = |texels: &Vec<f32>| match self.spec.filter {
            FilterShape::Quads => {
                let quads = self.quads(texels);
                device.image(size, ImageFormat::Rgba32Sfloat, bytemuck::cast_slice(&quads))
            }
            _ => device.image(size, ImageFormat::R32Sfloat, bytemuck::cast_slice(texels)),
        };
        self.texels.iter().map(image).collect()
    }

    /// Each texel with its neighbours in x, y and xy, of its own slot alone.
    fn quads(&self, texels: &[f32]) -> Vec<[f32; 4]> {
        let ([width, height, _], slot) = (self.atlas_size(), self.slot_size());
        let quad = |at: usize| {
            let (x, y) = (at as u32 % width, at as u32 / width % height);
            let right = (x + 1) % slot[0] != 0;
            let below = (y + 1) % slot[1] != 0;
            let get = |inside: bool, ahead: u32| match inside {
                true => texels[at + ahead as usize],
                false => NONSENSE,
            };
            [texels[at], get(right, 1), get(below, width), get(right && below, width + 1)]
        };
        (0..texels.len()).map(quad).collect()
    }

    /// As the twin takes it.
    pub fn with_scene<T>(
        &self,
        levels: &[LevelView],
        known: bool,
        skipping: Skipping,
        take: impl FnOnce(&Scene) -> T,
    ) -> T {
        let channel = |(index, (atlas, number)): (usize, &(usize, u32))| {
            let shape = &self.world.atlases[*atlas];
            Channel {
                entry_first: shape.entry_first,
                channels: shape.channels,
                channel: *number,
                slot_first: shape.slot_first,
                slots_across: [self.slots_across[0], self.slots_across[1]],
                atlas: Texels { size: self.atlas_size(), texels: &self.texels[*atlas] },
                segments: &self.segments[index],
                finest: self.spec.finest.get(index).copied().unwrap_or(0),
                sample_every: self.spec.sample_every.get(index).copied().unwrap_or(1),
            }
        };
        let channels: Vec<_> = self.places.iter().enumerate().map(channel).collect();
        take(&Scene {
            channels: &channels,
            levels,
            constants: &self.constants,
            payload: self.spec.payload.map(|edge| edge as i32),
            slot: self.slot_size().map(|edge| edge as i32),
            skipping: skipping == Skipping::Bricks,
            octree: (skipping == Skipping::Boxes).then(|| self.leaf_words.leaves(known)),
            closed_form: self.spec.closed_form && skipping == Skipping::Boxes,
        })
    }

    /// A level as one image per channel.
    pub fn whole(&self, level: usize) -> Vec<ray_march::Channel<'_>> {
        let size = self.levels.get(level as u8).expect("the level").size.to_array();
        let size = size.map(|edge| edge + 2);
        let channel = |(voxels, segments)| ray_march::Channel::Scalar {
            texels: Texels { size, texels: voxels },
            segments,
        };
        let voxels = self.voxels[level - self.spec.level].iter().map(|voxels| &voxels[..]);
        voxels.zip(self.segments.iter().map(|segments| &segments[..])).map(channel).collect()
    }
}

/// Boxes of invisible values in between of visible ones; the edge is repeated around the volume.
/// Of voxels with their apron; the box ends before `end`.
fn range_in_box(voxels: &[f32], size: [u32; 3], start: [i64; 3], end: [i64; 3]) -> ValueRange {
    let stored = size.map(|edge| i64::from(edge) + 2);
    let mut range = ValueRange::EMPTY;
    for z in start[2]..end[2] {
        for y in start[1]..end[1] {
            for x in start[0]..end[0] {
                let at = ((z + 1) * stored[1] + y + 1) * stored[0] + x + 1;
                range = range.with(voxels[at as usize]);
            }
        }
    }
    range
}

fn random_voxels(random: &mut Random, seed: u32, size: [u32; 3], spec: &Spec) -> Vec<f32> {
    let mut inner = vec![0.0; size.iter().product::<u32>() as usize];
    for (index, voxel) in inner.iter_mut().enumerate() {
        let index = index as u32;
        let at = [index % size[0], index / size[0] % size[1], index / size[0] / size[1]];
        let block: [u32; 3] = std::array::from_fn(|axis| at[axis] / (spec.payload[axis] * 3 / 2));
        let of_block = Random(u64::from(seed ^ (block[0] | block[1] << 7 | block[2] << 14))).unit();
        *voxel = match random.unit() {
            _ if spec.closed_form && of_block < 0.7 => 0.31 + of_block as f32,
            part if of_block < 0.6 || spec.closed_form => part as f32 * 0.29,
            part => part as f32,
        };
        if spec.holes && chance(random, 0.02) {
            *voxel = f32::NAN;
        }
    }
    let mut voxels = Vec::new();
    for z in 0..size[2] + 2 {
        for y in 0..size[1] + 2 {
            for x in 0..size[0] + 2 {
                let inside = |at: u32, axis: usize| at.saturating_sub(1).min(size[axis] - 1);
                let [x, y, z] = [inside(x, 0), inside(y, 1), inside(z, 2)];
                voxels.push(inner[((z * size[1] + y) * size[0] + x) as usize]);
            }
        }
    }
    voxels
}

/// Nothing below [`VISIBLE`], pieces with jumps between them above. `falling`: windowed values fall as
/// voxels grow, so that 0, which a NaN might be taken for, is visible.
fn transfer(random: &mut Random, segments: u32, falling: bool) -> Vec<TransferSegment> {
    let segment = |index: u32| {
        let mut part = || random.unit() as f32;
        let (nothing, begins_at) = if falling {
            (index + 1 == segments, (1.0 - VISIBLE) * index as f32 / (segments - 1) as f32)
        } else {
            let later = (1.0 - VISIBLE) * (index.max(1) - 1) as f32 / segments as f32;
            (index == 0, if index == 0 { 0.0 } else { VISIBLE + later })
        };
        let seen = if nothing { 0.0 } else { 1.0 };
        TransferSegment {
            start: [part(), part(), part(), part() * 2.0 * seen],
            slope: [part(), part(), part(), (part() - 0.5) * seen],
            begins_at,
            window_scale: if falling { -1.0 } else { 1.0 },
            window_offset: if falling { 1.0 } else { 0.0 },
            unused_0: 0.0,
        }
    };
    (0..segments).map(segment).collect()
}
