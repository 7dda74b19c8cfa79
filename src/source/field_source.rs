//! Bricks of a function of space, of any size, evaluated when they are read: no file, no memory.

use crate::error::Result;
use crate::source::brick_source::no_such_brick;
use crate::source::{BrickEntry, BrickSource, ChannelDescription, Computed, Description};
use crate::volume::{
    BRICK_APRON, BrickId, Levels, Size3, ValueRange, VoxelFormat, Voxels, WorldFromVoxel,
};

/// A volume given by a formula.
pub trait Field: Send + Sync {
    /// Of its voxels.
    fn format(&self) -> VoxelFormat;
    /// Level-0 voxels `start + i * stride` for i below `size`, x fastest, all inside the volume.
    fn fill(&self, start: [u32; 3], size: Size3, stride: [u32; 3]) -> Voxels;
    /// Bounds of the level-0 voxels of a box, cheap: empty space is known without evaluating it.
    fn bounds(&self, start: [u32; 3], size: Size3) -> ValueRange;
}

impl Field for Computed {
    fn format(&self) -> VoxelFormat {
        Computed::format(self)
    }

    fn fill(&self, start: [u32; 3], size: Size3, stride: [u32; 3]) -> Voxels {
        if stride == [1; 3] {
            return Computed::fill(self, start, size);
        }
        let at = |axis: usize, i: u32| start[axis] + i * stride[axis];
        let values = (0..size.z).flat_map(|k| {
            (0..size.y).flat_map(move |j| {
                (0..size.x).map(move |i| self.value(at(0, i), at(1, j), at(2, k)))
            })
        });
        match Computed::format(self) {
            VoxelFormat::F32 => Voxels::F32(values.collect()),
            // Every other kind is u8, and its values are whole.
            _ => Voxels::U8(values.map(|value| value as u8).collect()),
        }
    }

    fn bounds(&self, start: [u32; 3], size: Size3) -> ValueRange {
        Computed::bounds(self, start, size)
    }
}

/// A [`Field`] as one channel in bricks.
///
/// Levels are *sampled*, not averaged, since averages over a volume that fits nowhere would cost
/// its evaluation: coarse voxel i is level-0 voxel i * scale + scale / 2 (clamped to the volume), the
/// upper one of the two next to the coarse voxel's centre. Level 0 is exact.
pub struct FieldSource<F> {
    field: F,
    description: Description,
}

impl<F: Field> FieldSource<F> {
    /// Cuts `field` of `size` voxels into bricks of `payload`.
    pub fn new(
        name: &str,
        field: F,
        size: Size3,
        payload: Size3,
        world_from_voxel: WorldFromVoxel,
    ) -> FieldSource<F> {
        let spacing = world_from_voxel.spacing().to_array();
        let channel = ChannelDescription {
            format: field.format(),
            slope: 1.0,
            intercept: 0.0,
            nan_voxels: 0,
            infinite_voxels: 0,
            absent_voxels: 0,
            range: field.bounds([0; 3], size),
        };
        let description = Description {
            name: name.to_owned(),
            payload,
            levels: Levels::of(size, spacing, payload),
            world_from_voxel,
            unit: None,
            provenance: format!("computed: {name}, {size}\nlevels: sampled\n"),
            channels: vec![channel],
        };
        FieldSource { field, description }
    }

    /// Level-0 voxel that stands for coarse voxel `voxel`, which may lie one outside the level.
    fn level_0_voxel(&self, id: BrickId, axis: usize, voxel: i64) -> u32 {
        let level = self.description.levels.get(id.level).expect("checked by the caller");
        let last = i64::from(level.size.to_array()[axis]) - 1;
        let scale = i64::from(level.scale[axis]);
        let voxel = voxel.clamp(0, last) * scale + scale / 2;
        voxel.min(i64::from(self.description.size().to_array()[axis]) - 1) as u32
    }

    /// Per axis: the distinct level-0 voxels the brick needs, first and last.
    fn level_0_box(&self, id: BrickId) -> ([u32; 3], [u32; 3]) {
        let (payload, _) = self.description.brick(id);
        let apron = i64::from(BRICK_APRON);
        let first =
            |axis: usize| self.level_0_voxel(id, axis, i64::from(payload.start[axis]) - apron);
        let last =
            |axis: usize| self.level_0_voxel(id, axis, i64::from(payload.end[axis]) - 1 + apron);
        (std::array::from_fn(first), std::array::from_fn(last))
    }
}

impl<F: Field> BrickSource for FieldSource<F> {
    fn description(&self) -> &Description {
        &self.description
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        if !self.description.has(id) {
            return Err(no_such_brick(&self.description, id));
        }
        let (first, last) = self.level_0_box(id);
        let size = std::array::from_fn(|axis| last[axis] - first[axis] + 1);
        let range = self.field.bounds(first, Size3::from_array(size));
        // Of RGBA the range tells of alpha alone. Elsewhere equal bounds leave one value, whose bits
        // one voxel tells.
        if range.least == range.greatest && self.field.format() != VoxelFormat::Rgba8 {
            let one = self.field.fill(first, Size3::cube(1), [1; 3]);
            let mut voxel = [0; 4];
            voxel[..one.bytes().len()].copy_from_slice(one.bytes());
            return Ok(BrickEntry::Constant(voxel));
        }
        Ok(BrickEntry::Stored { range, loss: f32::NAN })
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        bytes.clear();
        if let BrickEntry::Constant(voxel) = self.entry(id)? {
            let voxel = &voxel[..self.field.format().bytes()];
            bytes.extend(voxel.iter().cycle().take(self.description.brick_bytes(id)));
            return Ok(());
        }
        let (payload, stored) = self.description.brick(id);
        let scale = self.description.levels.get(id.level).expect("entry() looked").scale;
        let inner = payload.size();
        // The payload's own voxels lie at one stride, but for a last one that the far face clamps;
        // evaluating planes one by one keeps clamped and repeated voxels exact.
        let voxel_bytes = self.field.format().bytes();
        let at = |axis: usize, i: u32| {
            self.level_0_voxel(id, axis, i64::from(payload.start[axis]) + i64::from(i) - 1)
        };
        let mut previous_plane: Option<(u32, usize)> = None;
        for k in 0..stored.z {
            let z = at(2, k);
            if let Some((same, start)) = previous_plane.filter(|&(before, _)| before == z) {
                let plane = stored.x as usize * stored.y as usize * voxel_bytes;
                bytes.extend_from_within(start..start + plane);
                previous_plane = Some((same, start));
                continue;
            }
            previous_plane = Some((z, bytes.len()));
            for j in 0..stored.y {
                let y = at(1, j);
                let one = |x: u32| self.field.fill([x, y, z], Size3::cube(1), [1; 3]);
                bytes.extend_from_slice(one(at(0, 0)).bytes());
                let row = Size3::new(inner.x - 1, 1, 1);
                if row.x > 0 {
                    let stride = [scale[0], 1, 1];
                    bytes.extend_from_slice(self.field.fill([at(0, 1), y, z], row, stride).bytes());
                }
                bytes.extend_from_slice(one(at(0, inner.x)).bytes());
                bytes.extend_from_slice(one(at(0, inner.x + 1)).bytes());
            }
        }
        Ok(())
    }
}
