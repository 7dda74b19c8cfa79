//! Twins: for each shader a file of the same name with the same arithmetic, as plain functions of
//! slices, overflow and absence included. Also the structs that host and shaders share.
//!
//! A twin is compared with its shader number by number; it is no reference: what both get wrong, only
//! `reference/` can tell.

pub mod bits;
pub mod brick_look_up;
pub mod brick_march;
pub mod cache;
pub mod cast;
pub mod choose;
pub mod classify;
pub mod count;
pub mod exponential;
pub mod filter;
pub mod fixed_point;
pub mod forget;
pub mod grant;
pub mod limits;
pub mod macrocells;
pub mod march;
pub mod march_bricks;
pub mod octree;
pub mod octree_ranges;
pub mod octree_resident;
pub mod octree_shape;
pub mod octree_walk;
pub mod octree_words;
pub mod place;
pub mod preintegrate;
pub mod probe;
pub mod publish;
pub mod ranking;
pub mod ranks;
pub mod ray;
pub mod ray_block;
pub mod ray_march;
pub mod ray_resolve;
pub mod ray_setup;
pub mod rays;
pub mod resolve;
pub mod scan;
pub mod tally;
pub mod transfer;
