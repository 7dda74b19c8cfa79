//! Other people's formats give the voxels and transforms that other people's readers give.

mod common;
mod folder;
mod random;

#[path = "formats/arrays.rs"]
mod arrays;
#[path = "formats/hostile.rs"]
mod hostile;
#[path = "formats/pages.rs"]
mod pages;
#[path = "formats/plain.rs"]
mod plain;
#[path = "formats/table.rs"]
mod table;
#[path = "formats/write.rs"]
mod write;
