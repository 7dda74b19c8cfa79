//! Passes: one file per shader: its variants, what it reads and writes, its dispatch.

pub mod cast;
pub mod march;
pub mod march_shape;
pub mod probe;
pub mod rays;
pub mod resolve;
mod sources;

pub use sources::SOURCES;
