//! The members of a ZIP archive, stored or deflated, with their checksums; ZIP64 too.
//!
//! Source: PKWARE APPNOTE 6.3

use std::io::{self, Read};

use flate2::{Crc, read::DeflateDecoder};

use crate::error::{Error, Result};
use crate::import::bytes::{exactly, u16_at, u32_at, u64_at};
use crate::import::stream::{Coding, Section, Stream};

/// The end record is looked for in this many bytes: its own 22 and the longest comment.
const END_BYTES_MAX: u64 = 22 + 0xffff;
/// Directories are refused beyond this many bytes.
const DIRECTORY_BYTES_MAX: u64 = 16 << 20;

/// One member.
pub struct Member {
    pub name: String,
    archive: Section,
    method: u16,
    encrypted: bool,
    crc: u32,
    packed: u64,
    bytes: u64,
    offset: u64,
}

/// All members, in the directory's order.
pub fn members(archive: &Section) -> Result<Vec<Member>> {
    let (mut at, bytes) = directory_of(archive)?;
    if bytes > DIRECTORY_BYTES_MAX {
        return Err(Error::input(format!(
            "its directory has {bytes} bytes; {DIRECTORY_BYTES_MAX} can be read"
        )));
    }
    let end = at.saturating_add(bytes);
    let mut members = Vec::new();
    while at < end {
        let entry = read(archive, at, 46)?;
        if !entry.starts_with(b"PK\x01\x02") {
            return Err(damaged());
        }
        let (name, extra) =
            (u64::from(u16_at(&entry, 28, false)), u64::from(u16_at(&entry, 30, false)));
        let rest = read(archive, at + 46, name + extra)?;
        let (name_bytes, extra_bytes) = rest.split_at(name as usize);
        let mut wide = wide_fields(extra_bytes);
        let mut widened = |short: u32| {
            if short == u32::MAX { wide.next().ok_or_else(damaged) } else { Ok(u64::from(short)) }
        };
        // In this order: the wide field holds only what is too large, in turn.
        let bytes = widened(u32_at(&entry, 24, false))?;
        let packed = widened(u32_at(&entry, 20, false))?;
        let offset = widened(u32_at(&entry, 42, false))?;
        members.push(Member {
            name: String::from_utf8_lossy(name_bytes).into_owned(),
            archive: archive.clone(),
            method: u16_at(&entry, 10, false),
            encrypted: u16_at(&entry, 8, false) & 1 == 1,
            crc: u32_at(&entry, 16, false),
            packed,
            bytes,
            offset,
        });
        at += 46 + name + extra + u64::from(u16_at(&entry, 32, false));
    }
    Ok(members)
}

impl Member {
    /// The member's bytes; its checksum is met at their end.
    pub fn stream(&self) -> Result<Stream> {
        if self.encrypted {
            return Err(Error::input("is encrypted, which is not supported"));
        }
        let local = read(&self.archive, self.offset, 30)?;
        if !local.starts_with(b"PK\x03\x04") {
            return Err(damaged());
        }
        let skip = 30 + u64::from(u16_at(&local, 26, false)) + u64::from(u16_at(&local, 28, false));
        let packed = self.archive.part(self.offset.saturating_add(skip), self.packed);
        if packed.left() < self.packed {
            return Err(damaged());
        }
        let (inner, coding): (Box<dyn Read + Send>, _) = match self.method {
            0 => (Box::new(packed), Coding::None),
            8 => (
                Box::new(DeflateDecoder::new(io::BufReader::with_capacity(64 << 10, packed))),
                Coding::Deflate,
            ),
            other => {
                return Err(Error::input(format!(
                    "compression {other} of an archive is not supported: stored and deflated are"
                )));
            }
        };
        let bytes_max = self.packed.saturating_mul(coding.expansion_max()).min(self.bytes);
        let checked = Checked { inner, crc: Crc::new(), expected: self.crc };
        Ok(Stream::from_decoder(Box::new(checked), coding.name(), bytes_max))
    }
}

/// Meets the checksum where the bytes end.
struct Checked<R> {
    inner: R,
    crc: Crc,
    expected: u32,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.inner.read(buffer)?;
        self.crc.update(&buffer[..got]);
        if got == 0 && !buffer.is_empty() && self.crc.sum() != self.expected {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "its checksum is wrong"));
        }
        Ok(got)
    }
}

/// Offset and length of the central directory.
fn directory_of(archive: &Section) -> Result<(u64, u64)> {
    let length = archive.left();
    let start = length.saturating_sub(END_BYTES_MAX);
    let tail = read(archive, start, length - start)?;
    let at = tail
        .windows(4)
        .rposition(|four| four == b"PK\x05\x06")
        .filter(|at| at + 22 <= tail.len())
        .ok_or_else(|| Error::input("is not a whole archive: its end record is missing"))?;
    let record = &tail[at..];
    let (bytes, offset) = (u32_at(record, 12, false), u32_at(record, 16, false));
    if bytes != u32::MAX && offset != u32::MAX {
        return Ok((u64::from(offset), u64::from(bytes)));
    }
    let locator = (start + at as u64).checked_sub(20).ok_or_else(damaged)?;
    let locator = read(archive, locator, 20)?;
    let wide = read(archive, u64_at(&locator, 8, false), 56)?;
    if !locator.starts_with(b"PK\x06\x07") || !wide.starts_with(b"PK\x06\x06") {
        return Err(damaged());
    }
    Ok((u64_at(&wide, 48, false), u64_at(&wide, 40, false)))
}

/// The numbers of the ZIP64 extra field, if there is one.
fn wide_fields(mut extra: &[u8]) -> impl Iterator<Item = u64> {
    let mut found = Vec::new();
    while extra.len() >= 4 {
        let (kind, bytes) = (u16_at(extra, 0, false), usize::from(u16_at(extra, 2, false)));
        let Some(field) = extra.get(4..4 + bytes) else { break };
        if kind == 1 {
            found = field.chunks_exact(8).map(|number| u64_at(number, 0, false)).collect();
        }
        extra = &extra[4 + bytes..];
    }
    found.into_iter()
}

fn read(archive: &Section, offset: u64, bytes: u64) -> Result<Vec<u8>> {
    exactly(archive, offset, bytes).map_err(|_| damaged())
}

fn damaged() -> Error {
    Error::input("the archive's directory is damaged: get the whole file")
}
