//! The words as types: sizes, voxel formats, transforms, levels, bricks, ranges. Pure arithmetic.

mod brick;
mod dense;
mod format;
mod level;
mod macrocells;
mod range;
mod size;
mod transform;
mod voxel;
mod voxels;

pub use brick::{BRICK_APRON, BRICK_PAYLOAD_DEFAULT, BrickBox, BrickGrid, BrickId};
pub use dense::{ChannelVoxels, VolumeVoxels};
pub use format::{RawLayout, VoxelFormat};
pub use level::{Level, Levels};
pub use macrocells::{MACROCELL_CELLS, Macrocells};
pub use range::ValueRange;
pub use size::Size3;
pub use transform::WorldFromVoxel;
pub use voxel::Voxel;
pub(crate) use voxel::with_voxel_type;
pub use voxels::{Voxels, sanitized};
