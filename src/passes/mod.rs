//! Passes: one file per shader: its variants, what it reads and writes, its dispatch.

pub mod brick_shape;
pub mod cache_buffers;
pub mod cast;
pub mod choose;
pub mod count;
pub mod forget;
pub mod grant;
pub mod march;
pub mod march_bricks;
pub mod march_shape;
pub mod octree_resident;
pub mod place;
pub mod probe;
pub mod publish;
pub mod rays;
pub mod resolve;
pub mod scan;
mod sources;
pub mod tally;

pub use sources::SOURCES;
