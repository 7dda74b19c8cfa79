//! Other people's formats give the voxels and transforms that other people's readers give.

mod common;

#[path = "formats/table.rs"]
mod table;
