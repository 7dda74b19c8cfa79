//! The brick file: one random-access file of bricks, drawn byte by byte in docs/FORMAT.md.
//!
//! [`Writer`] takes encoded bricks in any order and gives a whole file or none; [`Store`] reads it as a
//! `BrickSource`; [`verify()`] reads every byte.

mod describe;
mod encode;
mod entry;
mod flusher;
mod index;
pub mod layout;
mod numbering;
mod pages;
mod reader;
mod verify;
mod writer;

pub use encode::{Compression, Encoded, encode, entry_of};
pub use numbering::Numbering;
pub use reader::Store;
pub use verify::{Damage, Report, verify};
pub use writer::{Writer, remove_partial_files};
pub(crate) use writer::{disk_error, nameless_file};
