//! Numbers that host and shaders share; a test reads both this file and `shaders/common/limits.glsl`.

/// Samples between two anchors of a ray.
pub const BLOCK_SAMPLES: u32 = 32;
/// Samples of a ray that are chosen together, before any of them is composited.
pub const SAMPLES_AT_ONCE: u32 = 2;
/// Rays of one workgroup along x.
pub const GROUP_WIDTH: u32 = 8;
/// Rays of one workgroup along y.
pub const GROUP_HEIGHT: u32 = 8;
/// Optical depth taken for opaque: exp(-87) is the smallest that f32 holds as a normal number.
pub const OPAQUE_DEPTH: f32 = 87.0;

/// Entry state: nothing is known to be there, or it was given up.
pub const ENTRY_UNMAPPED: u32 = 0;
/// Entry state: unmapped, and a grant is bound to it.
pub const ENTRY_EXPECTED: u32 = 1;
/// Entry state: in a slot.
pub const ENTRY_MAPPED: u32 = 2;
/// Entry state: every voxel has one value.
pub const ENTRY_CONSTANT: u32 = 3;
/// Entry state: nothing of it is visible under the current transfer function.
pub const ENTRY_HIDDEN: u32 = 4;
/// Entry state: the source has nothing there.
pub const ENTRY_ABSENT: u32 = 5;
/// Entry state: it could not be read.
pub const ENTRY_FAILED: u32 = 6;
/// The state stands in the bits from this one up.
pub const ENTRY_STATE_SHIFT: u32 = 28;
/// Slot or constant's number.
pub const ENTRY_PAYLOAD_MASK: u32 = 0x0fff_ffff;

/// Owner of a slot that holds no brick.
pub const OWNER_FREE: u32 = 0xffff_ffff;
/// Owner of a slot promised to the host for a copy.
pub const OWNER_GRANTED: u32 = 0xffff_fffe;
/// Rank of a brick in a level that the view does not use: no ray can need it.
pub const RANK_NONE: u32 = 0xffff_ffff;
/// Instead of a slot's rank: nobody needs it.
pub const SLOT_DEAD: u32 = 0xffff_ffff;
/// Instead of a slot's rank: the host has it.
pub const SLOT_PROMISED: u32 = 0xffff_fffe;
/// Slots that one thread of tally, count and grant looks through.
pub const CHUNK_SLOTS: u32 = 32;
/// Words of 32 wishes that one thread of tally, count and grant looks through.
pub const CHUNK_WORDS: u32 = 32;
/// Threads of a workgroup of the passes that manage the cache.
pub const CACHE_GROUP: u32 = 64;
/// Ranks of wishes in substitute refinement: four a doubling of their weight.
pub const WEIGHT_RANKS: u32 = 128;
/// Place of a ray that has ended.
pub const PLACE_ENDED: u32 = 0xffff_ffff;
/// Place of a ray on its way.
pub const PLACE_RUNNING: u32 = 0xffff_fffe;
