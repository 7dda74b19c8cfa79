//! Entry numbers: which place in the index a brick has.

use crate::source::Description;
use crate::volume::{BrickId, Levels, Size3};

/// Counts bricks level by level, channel by channel, x fastest (docs/FORMAT.md, Definitions).
#[derive(Clone, Debug)]
pub struct Numbering {
    channels: u64,
    /// Per level: number of its first brick, and its bricks along each axis.
    levels: Vec<(u64, Size3)>,
    count: u64,
}

impl Numbering {
    /// Of a volume's bricks, or nothing where they are too many to count in 63 bits.
    pub fn of(levels: &Levels, payload: Size3, channels: usize) -> Option<Numbering> {
        let channels = channels as u64;
        let mut rows = Vec::with_capacity(levels.count());
        let mut count = 0u64;
        for level in levels.iter() {
            let bricks = crate::volume::BrickGrid { size: level.size, payload }.bricks();
            rows.push((count, bricks));
            let here = u64::try_from(bricks.voxel_count()).ok()?.checked_mul(channels)?;
            count = count.checked_add(here).filter(|&count| count <= i64::MAX as u64)?;
        }
        Some(Numbering { channels, levels: rows, count })
    }

    /// Of a described volume.
    pub fn of_description(description: &Description) -> Option<Numbering> {
        Numbering::of(&description.levels, description.payload, description.channels.len())
    }

    /// All bricks.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The entry number of a brick that the volume has.
    pub fn entry_number(&self, id: BrickId) -> u64 {
        let (first, bricks) = self.levels[usize::from(id.level)];
        let plane = u64::from(bricks.x) * u64::from(bricks.y);
        first
            + u64::from(id.channel) * plane * u64::from(bricks.z)
            + u64::from(id.z) * plane
            + u64::from(id.y) * u64::from(bricks.x)
            + u64::from(id.x)
    }

    /// The brick of an entry number below [`Numbering::count`].
    pub fn brick(&self, entry_number: u64) -> BrickId {
        debug_assert!(entry_number < self.count);
        let level = self.levels.partition_point(|&(first, _)| first <= entry_number) - 1;
        let (first, bricks) = self.levels[level];
        let [nx, ny, nz] = bricks.to_array().map(u64::from);
        let rest = entry_number - first;
        let (rest, x) = (rest / nx, rest % nx);
        let (rest, y) = (rest / ny, rest % ny);
        let (channel, z) = (rest / nz, rest % nz);
        debug_assert!(channel < self.channels);
        BrickId {
            volume: 0,
            channel: channel as u16,
            level: level as u8,
            x: x as u32,
            y: y as u32,
            z: z as u32,
        }
    }
}
