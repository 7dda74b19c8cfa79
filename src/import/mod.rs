//! Other people's formats -> voxels -> store, in one pass and bounded memory.
//!
//! [`open`] gives runs of voxels in the file's order; a [`chain`] per channel keeps only the slices that
//! bricks and coarser levels still need; [`import`] moves the one into the other on all cores.

mod build;
mod chain;
mod coarsen;
mod convert;
mod cut;
mod input;
mod level_slices;
mod pipeline;
mod reduce;
mod slices;

pub use input::{Header, Input, Options, Run, open};
pub use pipeline::{Progress, Settings, Summary, import, import_from};
