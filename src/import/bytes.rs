//! Whole numbers in bytes, and exact pieces of files.

use std::io::{self, Read};

use crate::import::stream::Section;

/// The number at a place that is known to lie in `bytes`.
pub fn u16_at(bytes: &[u8], at: usize, big_endian: bool) -> u16 {
    let two = [bytes[at], bytes[at + 1]];
    if big_endian { u16::from_be_bytes(two) } else { u16::from_le_bytes(two) }
}

/// As [`u16_at`].
pub fn u32_at(bytes: &[u8], at: usize, big_endian: bool) -> u32 {
    let four = std::array::from_fn(|index| bytes[at + index]);
    if big_endian { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
}

/// As [`u16_at`].
pub fn u64_at(bytes: &[u8], at: usize, big_endian: bool) -> u64 {
    let eight = std::array::from_fn(|index| bytes[at + index]);
    if big_endian { u64::from_be_bytes(eight) } else { u64::from_le_bytes(eight) }
}

/// `bytes` bytes of a section from `offset` on. Nothing is allocated unless the section has them.
///
/// # Errors
/// `UnexpectedEof` where it has not.
pub fn exactly(section: &Section, offset: u64, bytes: u64) -> io::Result<Vec<u8>> {
    let mut part = section.part(offset, bytes);
    if part.left() < bytes {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    let mut out = vec![0; bytes as usize];
    part.read_exact(&mut out)?;
    Ok(out)
}
