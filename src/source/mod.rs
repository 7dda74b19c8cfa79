//! Where bricks come from: one trait over stores, computed volumes of any size, and the faulty wrappers
//! of tests.

mod brick_source;
mod computed;
mod description;
pub mod faulty;
mod field_source;
mod formula;
mod mandelbulb;

pub(crate) use brick_source::no_such_brick;
pub use brick_source::{BrickEntry, BrickSource, read_checked, read_checked_telling};
pub use computed::{Computed, KINDS, computed};
pub use description::{ChannelDescription, Description};
pub use field_source::{Field, FieldSource};
