//! Numbers of bricks: places over all levels, entries over all atlases and channels.

use crate::residency::{AtlasPlan, ENTRY_ALIGNMENT};
use crate::source::Description;
use crate::volume::BrickId;

/// Where a channel of the scene has its bricks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelPlace {
    /// Number of the channel in the source.
    pub in_source: u16,
    /// Its atlas.
    pub atlas: usize,
    /// Its number among the atlas's channels.
    pub in_atlas: u32,
}

/// From entries to bricks and back. A place is a brick of some level, whatever the channel: levels one
/// after another, finest first, x fastest.
#[derive(Clone, Debug)]
pub struct BrickNumbers {
    /// First place and bricks along each axis of every level.
    levels: Vec<(u32, [u32; 3])>,
    /// In the scene's order.
    pub channels: Vec<ChannelPlace>,
    /// First entry and channels of every atlas.
    atlases: Vec<(u32, u32)>,
    places: u32,
}

/// Places that 28 bits hold: what an entry's number and a wish's bit are made for.
const PLACES_MAX: u64 = 1 << 28;

impl BrickNumbers {
    /// Numbers of a volume's bricks, `channels` in the scene's order; nothing where there are too many.
    pub fn new(
        description: &Description,
        channels: Vec<ChannelPlace>,
        atlases: usize,
    ) -> Option<BrickNumbers> {
        let mut levels = Vec::new();
        let mut places = 0u64;
        for level in 0..description.levels.count() as u8 {
            let bricks = description.grid(level)?.bricks();
            levels.push((places as u32, bricks.to_array()));
            places += u64::try_from(bricks.voxel_count()).ok()?;
            if places * channels.len() as u64 > PLACES_MAX {
                return None;
            }
        }
        let mut first = 0;
        let of_atlas = |atlas| {
            let count = channels.iter().filter(|channel| channel.atlas == atlas).count() as u32;
            let this = (first, count);
            first = (first + places as u32 * count).next_multiple_of(ENTRY_ALIGNMENT);
            this
        };
        let atlases = (0..atlases).map(of_atlas).collect();
        Some(BrickNumbers { levels, channels, atlases, places: places as u32 })
    }

    /// First entry, channels and entries of an atlas.
    pub fn atlas(&self, atlas: usize) -> (u32, u32, u32) {
        let (first, channels) = self.atlases[atlas];
        (first, channels, self.places * channels)
    }

    /// First place of a level.
    pub fn first_place(&self, level: usize) -> u32 {
        self.levels[level].0
    }

    /// Bricks along each axis of a level.
    pub fn bricks(&self, level: usize) -> [u32; 3] {
        self.levels[level].1
    }

    /// Entry of a brick of the source; nothing where the scene does not show its channel.
    pub fn entry(&self, id: BrickId) -> Option<u32> {
        let channel = self.channels.iter().find(|channel| channel.in_source == id.channel)?;
        let (first, channels) = self.atlases[channel.atlas];
        let (first_place, [across, down, _]) = self.levels[usize::from(id.level)];
        let place = first_place + (id.z * down + id.y) * across + id.x;
        Some(first + place * channels + channel.in_atlas)
    }

    /// The brick of an atlas's entry.
    pub fn brick(&self, atlas: usize, entry: u32) -> BrickId {
        let (first, channels) = self.atlases[atlas];
        let (place, in_atlas) = ((entry - first) / channels, (entry - first) % channels);
        let level = self.levels.iter().rposition(|(first, _)| place >= *first).unwrap_or(0);
        let (first_place, [across, down, _]) = self.levels[level];
        let within = place - first_place;
        let channel = self
            .channels
            .iter()
            .find(|channel| channel.atlas == atlas && channel.in_atlas == in_atlas)
            .map_or(0, |channel| channel.in_source);
        BrickId {
            volume: 0,
            channel,
            level: level as u8,
            x: within % across,
            y: within / across % down,
            z: within / (across * down),
        }
    }

    /// Whether an entry is of the channel that has this place.
    pub fn is_of(&self, place: &ChannelPlace, entry: u32) -> bool {
        let (first, channels, count) = self.atlas(place.atlas);
        let at = entry.checked_sub(first).filter(|at| *at < count);
        at.is_some_and(|at| at % channels == place.in_atlas)
    }

    /// The atlas of a brick's channel.
    pub fn atlas_of(&self, id: BrickId) -> usize {
        let channel = self.channels.iter().find(|channel| channel.in_source == id.channel);
        channel.map_or(0, |channel| channel.atlas)
    }
}

impl AtlasPlan {
    /// Whether an entry is the atlas's.
    pub fn has(&self, entry: u32) -> bool {
        entry.checked_sub(self.shape.entry_first).is_some_and(|at| at < self.entry_count)
    }
}
