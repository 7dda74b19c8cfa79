//! The brick file: one random-access file of bricks, drawn byte by byte in docs/FORMAT.md.

pub mod layout;
