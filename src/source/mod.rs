//! Where bricks come from: one trait over stores, computed volumes and the faulty wrappers of tests.

mod brick_source;
mod description;
pub mod faulty;
mod field_source;

pub use brick_source::{BrickEntry, BrickSource, read_checked};
pub use description::{ChannelDescription, Description};
pub use field_source::{Field, FieldSource};
