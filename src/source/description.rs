//! What a brick source holds, known without reading a brick.

use crate::volume::{
    BrickBox, BrickGrid, BrickId, Levels, Size3, ValueRange, VoxelFormat, WorldFromVoxel,
};

/// One volume in bricks.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// For messages and scenes.
    pub name: String,
    /// Payload voxels per axis of a brick.
    pub payload: Size3,
    /// Finest first; level 0 has the volume's size.
    pub levels: Levels,
    /// Voxel (corner origin) of level 0 to world.
    pub world_from_voxel: WorldFromVoxel,
    /// Of world lengths, where known.
    pub unit: Option<String>,
    /// What the voxels came from, one fact a line.
    pub provenance: String,
    /// At least one.
    pub channels: Vec<ChannelDescription>,
}

/// One channel of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelDescription {
    /// Of every brick of the channel.
    pub format: VoxelFormat,
    /// Scaled value = slope * stored value + intercept.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// Voxels of level 0 that were NaN in the input.
    pub nan_voxels: u64,
    /// Voxels that were infinite in the input and are now the largest finite value of their sign.
    pub infinite_voxels: u64,
    /// Voxels that the input does not have.
    pub absent_voxels: u64,
    /// Least and greatest stored value of level 0, or bounds of them; empty when there is none.
    pub range: ValueRange,
}

impl Description {
    /// Voxels of level 0.
    pub fn size(&self) -> Size3 {
        self.levels.get(0).expect("there is a level 0").size
    }

    /// How level `level` is cut into bricks, or nothing where there is no such level.
    pub fn grid(&self, level: u8) -> Option<BrickGrid> {
        let level = self.levels.get(level)?;
        Some(BrickGrid { size: level.size, payload: self.payload })
    }

    /// Whether the volume has such a brick. The id's volume is the scene's business and not looked at.
    pub fn has(&self, id: BrickId) -> bool {
        self.grid(id.level).is_some_and(|grid| {
            let bricks = grid.bricks();
            usize::from(id.channel) < self.channels.len()
                && id.x < bricks.x
                && id.y < bricks.y
                && id.z < bricks.z
        })
    }

    /// The brick's payload box and how many voxels along each axis are read of it, apron included.
    ///
    /// # Panics
    /// When the volume has no such brick.
    pub fn brick(&self, id: BrickId) -> (BrickBox, Size3) {
        assert!(self.has(id), "{id} is no brick of this volume");
        let grid = self.grid(id.level).expect("has() looked");
        let brick = [id.x, id.y, id.z];
        (grid.payload_box(brick), grid.stored_size(brick))
    }

    /// Bytes that a read of the brick gives.
    ///
    /// # Panics
    /// When the volume has no such brick.
    pub fn brick_bytes(&self, id: BrickId) -> usize {
        let (_, size) = self.brick(id);
        let format = self.channels[usize::from(id.channel)].format;
        size.len().expect("a brick fits memory") * format.bytes()
    }

    /// A brick of the greatest size: the first.
    pub fn brick_largest(&self) -> BrickId {
        BrickId { volume: 0, channel: 0, level: 0, x: 0, y: 0, z: 0 }
    }

    /// Every brick, in the order of the store's index: level, channel, z, y, x.
    pub fn bricks(&self) -> impl Iterator<Item = BrickId> + '_ {
        let levels = 0..self.levels.count() as u8;
        let channels = self.channels.len() as u16;
        levels.flat_map(move |level| {
            let Size3 { x: nx, y: ny, z: nz } = self.grid(level).expect("in range").bricks();
            (0..channels).flat_map(move |channel| {
                (0..nz).flat_map(move |z| {
                    (0..ny).flat_map(move |y| {
                        (0..nx).map(move |x| BrickId { volume: 0, channel, level, x, y, z })
                    })
                })
            })
        })
    }
}
