//! Index entries while a store is written: in memory while they are few, in a nameless file beyond.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use crate::store::layout::{PAGE_ENTRIES, checksum, entry, page};
use crate::store::writer::nameless_file;

/// Entries kept in memory at most: 32 MiB of them.
const IN_MEMORY_MAX: u64 = 1 << 20;

/// Entries by number; those never set are absent bricks.
pub enum Index {
    /// All of them.
    Memory(Vec<u8>),
    /// A sparse file.
    Spilled(File, u64),
}

impl Index {
    /// Room for `count` entries. `beside` is the store; its folder takes the file if there is one.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn new(count: u64, beside: &Path) -> io::Result<Index> {
        if count <= IN_MEMORY_MAX {
            return Ok(Index::Memory(vec![0; count as usize * entry::BYTES]));
        }
        let file = nameless_file(beside)?;
        file.set_len(count * entry::BYTES as u64)?;
        Ok(Index::Spilled(file, count))
    }

    /// How many entries there are.
    pub fn count(&self) -> u64 {
        match self {
            Index::Memory(bytes) => (bytes.len() / entry::BYTES) as u64,
            Index::Spilled(_, count) => *count,
        }
    }

    /// Sets entries from `first` on.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn set(&mut self, first: u64, bytes: &[u8]) -> io::Result<()> {
        let place = first * entry::BYTES as u64;
        match self {
            Index::Memory(all) => {
                all[place as usize..place as usize + bytes.len()].copy_from_slice(bytes);
                Ok(())
            }
            Index::Spilled(file, _) => file.write_all_at(bytes, place),
        }
    }

    /// Gives all pages, in order, each with its head.
    ///
    /// # Errors
    /// When the file cannot be read, or `take` says so.
    pub fn pages(&self, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        let count = self.count();
        let mut bytes = Vec::new();
        for number in 0..count.div_ceil(PAGE_ENTRIES as u64) {
            let first = number * PAGE_ENTRIES as u64;
            let len = (count - first).min(PAGE_ENTRIES as u64) as usize * entry::BYTES;
            let place = first * entry::BYTES as u64;
            bytes.clear();
            bytes.resize(page::BYTES + len, 0);
            page::NUMBER.set(&mut bytes, &number.to_le_bytes());
            match self {
                Index::Memory(all) => {
                    let place = place as usize;
                    bytes[page::BYTES..].copy_from_slice(&all[place..place + len]);
                }
                Index::Spilled(file, _) => file.read_exact_at(&mut bytes[page::BYTES..], place)?,
            }
            let sum = checksum(&bytes[page::CHECKSUM.end()..]);
            page::CHECKSUM.set(&mut bytes, &sum.to_le_bytes());
            take(&bytes)?;
        }
        Ok(())
    }
}
