//! Blocks of bricks, surveyed together.

use crate::volume::{BrickGrid, BrickId};

/// Bricks along each axis of a block.
pub const BLOCK_EDGE: u32 = 8;

/// A cube of bricks of one level and channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Block {
    /// Index of the volume in the scene.
    pub volume: u16,
    /// Index of the channel in the volume.
    pub channel: u16,
    /// Level, 0 finest.
    pub level: u8,
    /// Block coordinates at that level: brick coordinates in [`BLOCK_EDGE`]s.
    pub x: u32,
    /// See `x`.
    pub y: u32,
    /// See `x`.
    pub z: u32,
}

impl Block {
    /// The block that a brick lies in.
    pub fn of(id: BrickId) -> Block {
        let BrickId { volume, channel, level, x, y, z } = id;
        let [x, y, z] = [x, y, z].map(|place| place / BLOCK_EDGE);
        Block { volume, channel, level, x, y, z }
    }

    /// Its brick of the smallest coordinates, whether or not there is one.
    pub fn first(self) -> BrickId {
        let Block { volume, channel, level, x, y, z } = self;
        let [x, y, z] = [x, y, z].map(|place| place.saturating_mul(BLOCK_EDGE));
        BrickId { volume, channel, level, x, y, z }
    }

    /// The place of a brick among [`Block::bricks`] of its block; nothing outside of `grid`.
    pub fn index(id: BrickId, grid: BrickGrid) -> Option<usize> {
        let bricks = grid.bricks().to_array();
        let at = [id.x, id.y, id.z];
        if (0..3).any(|axis| at[axis] >= bricks[axis]) {
            return None;
        }
        let within = at.map(|place| place % BLOCK_EDGE);
        // At the far edges blocks are smaller.
        let edge = |axis: usize| BLOCK_EDGE.min(bricks[axis] - (at[axis] - within[axis]));
        Some(((within[2] * edge(1) + within[1]) * edge(0) + within[0]) as usize)
    }

    /// Its bricks within `grid`, x fastest, then y, then z.
    pub fn bricks(self, grid: BrickGrid) -> impl Iterator<Item = BrickId> {
        let first = self.first();
        let bricks = grid.bricks();
        let along = |start: u32, count: u32| start..start.saturating_add(BLOCK_EDGE).min(count);
        let (xs, ys) = (along(first.x, bricks.x), along(first.y, bricks.y));
        along(first.z, bricks.z).flat_map(move |z| {
            let xs = xs.clone();
            ys.clone().flat_map(move |y| xs.clone().map(move |x| BrickId { x, y, z, ..first }))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Size3;

    const ID: BrickId = BrickId { volume: 2, channel: 1, level: 3, x: 0, y: 0, z: 0 };

    #[test]
    fn blocks_part_the_grid() {
        let grid = BrickGrid { size: Size3::new(9 * 4, 17 * 4 - 3, 3), payload: Size3::cube(4) };
        let mut bricks = Vec::new();
        for [x, y] in [[0, 0], [1, 0], [0, 1], [1, 1], [0, 2], [1, 2]] {
            let block = Block { x, y, ..Block::of(ID) };
            let own: Vec<BrickId> = block.bricks(grid).collect();
            assert!(own.iter().all(|&id| Block::of(id) == block) && own[0] == block.first());
            assert!(own.is_sorted_by_key(|id| (id.z, id.y, id.x)), "{own:?}");
            for (index, id) in own.iter().enumerate() {
                assert_eq!(Block::index(*id, grid), Some(index), "{id:?}");
            }
            bricks.extend(own);
        }
        bricks.sort_unstable();
        bricks.dedup();
        assert_eq!(bricks.len(), 9 * 17);
        for outside in [[9, 0, 0], [0, 17, 0], [0, 0, 1], [u32::MAX; 3]] {
            let [x, y, z] = outside;
            assert_eq!(Block::index(BrickId { x, y, z, ..ID }, grid), None);
        }
    }

    #[test]
    fn a_block_outside_has_no_brick() {
        let grid = BrickGrid { size: Size3::cube(64), payload: Size3::cube(8) };
        for far in [1, u32::MAX / BLOCK_EDGE, u32::MAX] {
            assert_eq!(Block { z: far, ..Block::of(ID) }.bricks(grid).count(), 0);
        }
        let whole: Vec<_> = Block::of(ID).bricks(grid).collect();
        assert_eq!(whole.len(), 512);
        assert!(whole.iter().enumerate().all(|(at, id)| Block::index(*id, grid) == Some(at)));
    }
}
