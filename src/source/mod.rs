//! Volumes that no file holds: computed voxel by voxel, in any box, at any size.

mod computed;
mod formula;
mod mandelbulb;

pub use computed::{Computed, KINDS, computed};
