//! Bytes of files: sections of them, and what decompressors make of sections.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use flate2::read::{DeflateDecoder, MultiGzDecoder, ZlibDecoder};

use crate::error::{Error, Result};

/// Bytes that a decompressor is fed at a time.
const FEED_BYTES: usize = 64 << 10;

/// A part of a file, read from its start on.
#[derive(Clone)]
pub struct Section {
    file: Arc<File>,
    offset: u64,
    left: u64,
}

impl Section {
    /// A whole file.
    pub fn of_file(path: &Path) -> Result<Section> {
        let cannot = |why: io::Error| Error::input(format!("cannot be read: {why}"));
        let file = File::open(path).map_err(cannot)?;
        let about = file.metadata().map_err(cannot)?;
        if !about.is_file() {
            return Err(Error::input("is not a file"));
        }
        Ok(Section { file: Arc::new(file), offset: 0, left: about.len() })
    }

    /// Bytes not read yet.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// The part of the remaining bytes that starts `offset` bytes on, at most `bytes` long.
    pub fn part(&self, offset: u64, bytes: u64) -> Section {
        let offset = offset.min(self.left);
        Section {
            file: self.file.clone(),
            offset: self.offset + offset,
            left: (self.left - offset).min(bytes),
        }
    }

    /// Everything from `offset` bytes on.
    pub fn from(&self, offset: u64) -> Section {
        self.part(offset, u64::MAX)
    }
}

impl Read for Section {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let want = usize::try_from(self.left).unwrap_or(usize::MAX).min(buffer.len());
        if want == 0 {
            return Ok(0);
        }
        // Sections share one file and one cursor, so each read says where it reads.
        let mut file: &File = &self.file;
        file.seek(SeekFrom::Start(self.offset))?;
        let got = file.read(&mut buffer[..want])?;
        self.offset += got as u64;
        self.left -= got as u64;
        Ok(got)
    }
}

/// The first bytes of a file, at most `bytes`.
pub fn head(path: &Path, bytes: usize) -> Result<Vec<u8>> {
    let mut head = Vec::new();
    let section = Section::of_file(path)?;
    section
        .take(bytes as u64)
        .read_to_end(&mut head)
        .map_err(|why| Error::input(format!("cannot be read: {why}")))?;
    Ok(head)
}

/// How a section is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    None,
    Gzip,
    Zlib,
    Deflate,
    Zstd,
}

impl Coding {
    /// By the first bytes of gzip and zstd files.
    pub fn by_magic(head: &[u8]) -> Coding {
        match head {
            [0x1f, 0x8b, ..] => Coding::Gzip,
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Coding::Zstd,
            _ => Coding::None,
        }
    }

    /// The name used in messages.
    pub fn name(self) -> &'static str {
        match self {
            Coding::None => "uncompressed",
            Coding::Gzip => "gzip",
            Coding::Zlib => "zlib",
            Coding::Deflate => "deflate",
            Coding::Zstd => "zstd",
        }
    }

    /// The most bytes that one compressed byte can stand for.
    pub fn expansion_max(self) -> u64 {
        match self {
            Coding::None => 1,
            // A deflate symbol of two bits copies 258 bytes.
            Coding::Gzip | Coding::Zlib | Coding::Deflate => 1032,
            // A block of four bytes repeats one byte 128 Ki times.
            Coding::Zstd => 32 << 10,
        }
    }
}

/// Decoded bytes, read in order.
pub struct Stream {
    reader: Reader,
    coding: &'static str,
    bytes_max: u64,
}

enum Reader {
    Plain(Section),
    Coded(Box<dyn Read + Send>),
}

impl Stream {
    /// What `section` decodes to.
    pub fn new(section: Section, coding: Coding) -> Result<Stream> {
        let bytes_max = section.left().saturating_mul(coding.expansion_max());
        if coding == Coding::None {
            return Ok(Stream { reader: Reader::Plain(section), coding: coding.name(), bytes_max });
        }
        let feed = BufReader::with_capacity(FEED_BYTES, section);
        let coded: Box<dyn Read + Send> = match coding {
            Coding::None | Coding::Gzip => Box::new(MultiGzDecoder::new(feed)),
            Coding::Zlib => Box::new(ZlibDecoder::new(feed)),
            Coding::Deflate => Box::new(DeflateDecoder::new(feed)),
            Coding::Zstd => {
                let decoder = zstd::stream::read::Decoder::with_buffer(feed);
                Box::new(decoder.map_err(|why| {
                    Error::input(format!("zstd decoding cannot be set up: {why}"))
                })?)
            }
        };
        Ok(Stream { reader: Reader::Coded(coded), coding: coding.name(), bytes_max })
    }

    /// A decoder of another kind, which yields `bytes_max` bytes at most.
    pub fn from_decoder(
        decoder: Box<dyn Read + Send>,
        coding: &'static str,
        bytes_max: u64,
    ) -> Stream {
        Stream { reader: Reader::Coded(decoder), coding, bytes_max }
    }

    /// The name of the compression, for messages.
    pub fn coding(&self) -> &'static str {
        self.coding
    }

    /// The most bytes that can still come: exact for what is not compressed.
    pub fn bytes_max(&self) -> u64 {
        self.bytes_max
    }

    /// Whether [`Stream::bytes_max`] is exact.
    pub fn is_plain(&self) -> bool {
        matches!(self.reader, Reader::Plain(_))
    }

    /// Leaves out `bytes` bytes.
    pub fn skip(&mut self, bytes: u64) -> io::Result<()> {
        match &mut self.reader {
            Reader::Plain(section) => {
                if bytes > section.left() {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                *section = section.from(bytes);
            }
            Reader::Coded(coded) => {
                if io::copy(&mut coded.take(bytes), &mut io::sink())? < bytes {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
        self.bytes_max = self.bytes_max.saturating_sub(bytes);
        Ok(())
    }
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = match &mut self.reader {
            Reader::Plain(section) => section.read(buffer),
            Reader::Coded(coded) => coded.read(buffer),
        }?;
        self.bytes_max = self.bytes_max.saturating_sub(got as u64);
        Ok(got)
    }
}
