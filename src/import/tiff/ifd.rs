//! The directories of a TIFF or BigTIFF file and the values of their tags.

use std::collections::HashSet;
use std::io;

use crate::error::{Error, Result};
use crate::import::bytes::exactly;
use crate::import::stream::Section;

/// Where a file's directories are and how its numbers lie.
pub struct File {
    /// The whole file.
    pub bytes: Section,
    pub big_endian: bool,
    big: bool,
    first: u64,
}

/// One directory: a page.
#[derive(Clone)]
pub struct Directory {
    entries: Vec<Entry>,
}

#[derive(Clone, Copy)]
struct Entry {
    tag: u16,
    kind: u16,
    count: u64,
    /// Where its values are in the file.
    offset: u64,
}

impl File {
    /// Reads a file's header.
    pub fn open(bytes: Section) -> Result<File> {
        let mut file = File { bytes, big_endian: false, big: false, first: 0 };
        let start = file.read(0, 4)?;
        file.big_endian = start.starts_with(b"MM");
        file.big = match file.number(&start[2..4]) {
            42 => false,
            43 => true,
            _ => return Err(Error::input("is not a TIFF file: its first bytes are wrong")),
        };
        let first = if file.big { file.read(8, 8)? } else { file.read(4, 4)? };
        file.first = file.number(&first);
        Ok(file)
    }

    /// The offsets of all directories in the file's own order.
    pub fn directories(&self) -> Result<Vec<u64>> {
        let mut offsets = Vec::new();
        let mut seen = HashSet::new();
        let mut offset = self.first;
        while offset != 0 {
            if !seen.insert(offset) {
                return Err(Error::input("its directories go round in a circle"));
            }
            offsets.push(offset);
            offset = self.parse(offset)?.1;
        }
        if offsets.is_empty() {
            return Err(Error::input("has no page"));
        }
        Ok(offsets)
    }

    /// The directory at an offset.
    pub fn directory(&self, offset: u64) -> Result<Directory> {
        Ok(self.parse(offset)?.0)
    }

    fn parse(&self, offset: u64) -> Result<(Directory, u64)> {
        let (count_bytes, entry_bytes, word) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let count = self.number(&self.read(offset, count_bytes)?);
        // 65535 is what the format allows; BigTIFF only has a wider field.
        if count > 0xffff {
            return Err(Error::input(format!("a directory promises {count} tags")));
        }
        let start = offset + count_bytes;
        let table = self.read(start, count * entry_bytes + word)?;
        let entries = table.chunks_exact(entry_bytes as usize).take(count as usize).enumerate();
        let entries = entries.map(|(index, entry)| {
            let word = word as usize;
            let (kind, count) =
                (self.number(&entry[2..4]) as u16, self.number(&entry[4..4 + word]));
            let value = &entry[4 + word..];
            let bytes = count.saturating_mul(kind_bytes(kind));
            let offset = if bytes <= word as u64 {
                start + index as u64 * entry_bytes + 4 + word as u64
            } else {
                self.number(value)
            };
            Entry { tag: self.number(&entry[..2]) as u16, kind, count, offset }
        });
        let directory = Directory { entries: entries.collect() };
        Ok((directory, self.number(&table[table.len() - word as usize..])))
    }

    /// Bytes of the file, all of them or an error.
    fn read(&self, offset: u64, bytes: u64) -> Result<Vec<u8>> {
        exactly(&self.bytes, offset, bytes).map_err(|why| {
            Error::input(match why.kind() {
                io::ErrorKind::UnexpectedEof => format!(
                    "the file is truncated: it has {} bytes, but {bytes} are promised at byte {offset}",
                    self.bytes.left()
                ),
                _ => format!("cannot be read at byte {offset}: {why}"),
            })
        })
    }

    /// A whole number of up to eight bytes in the file's order.
    fn number(&self, bytes: &[u8]) -> u64 {
        let push = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        if self.big_endian { bytes.iter().fold(0, push) } else { bytes.iter().rev().fold(0, push) }
    }

    /// The values of a tag that holds whole numbers, at most `count_max` of them.
    pub fn unsigned(&self, page: &Directory, tag: u16, count_max: u64) -> Result<Option<Vec<u64>>> {
        let Some(entry) = page.entry(tag) else { return Ok(None) };
        let bytes = match entry.kind {
            1 | 3 | 4 | 13 | 16 | 18 => kind_bytes(entry.kind),
            kind => {
                return Err(Error::input(format!("tag {tag} has type {kind}, not whole numbers")));
            }
        };
        if entry.count == 0 || entry.count > count_max {
            return Err(Error::input(format!(
                "tag {tag} has {} values, 1 to {count_max} are possible here",
                entry.count
            )));
        }
        let values = self.read(entry.offset, entry.count * bytes)?;
        Ok(Some(values.chunks_exact(bytes as usize).map(|value| self.number(value)).collect()))
    }

    /// The value of a tag that holds one whole number.
    pub fn one(&self, page: &Directory, tag: u16) -> Result<Option<u64>> {
        Ok(self.unsigned(page, tag, 1)?.map(|values| values[0]))
    }

    /// The text of a tag, up to its first zero byte.
    pub fn text(&self, page: &Directory, tag: u16) -> Result<Option<String>> {
        let Some(entry) = page.entry(tag).filter(|entry| matches!(entry.kind, 1 | 2 | 7)) else {
            return Ok(None);
        };
        let bytes = self.read(entry.offset, entry.count)?;
        let text = bytes.split(|byte| *byte == 0).next().unwrap_or(&[]);
        Ok(Some(String::from_utf8_lossy(text).into_owned()))
    }

    /// A fraction; `None` also where it is not a positive number.
    pub fn fraction(&self, page: &Directory, tag: u16) -> Result<Option<f64>> {
        let Some(entry) = page.entry(tag).filter(|entry| entry.kind == 5 && entry.count == 1)
        else {
            return Ok(None);
        };
        let bytes = self.read(entry.offset, 8)?;
        let (above, below) = (self.number(&bytes[..4]), self.number(&bytes[4..]));
        Ok((above > 0 && below > 0).then(|| above as f64 / below as f64))
    }
}

impl Directory {
    fn entry(&self, tag: u16) -> Option<Entry> {
        self.entries.iter().find(|entry| entry.tag == tag).copied()
    }
}

/// Bytes of one value; types not known count as bytes.
fn kind_bytes(kind: u16) -> u64 {
    match kind {
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => 1,
    }
}
