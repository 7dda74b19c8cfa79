//! VTK's compressed arrays: a table of block sizes, then blocks that are compressed one by one.

use std::collections::VecDeque;
use std::io::{self, Read};

use flate2::read::ZlibDecoder;

use crate::error::{Error, Result};
use crate::import::stream::Stream;
use crate::import::text::shown;

/// The table of block sizes is refused beyond this many bytes.
const TABLE_BYTES_MAX: u64 = 64 << 20;
/// Blocks are refused beyond this many bytes; VTK's own have 32 KiB.
const BLOCK_BYTES_MAX: u64 = 64 << 20;

/// How blocks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compressor {
    Zlib,
    Lz4,
}

impl Compressor {
    /// By the file's attribute; `None` where nothing is compressed.
    pub fn of(name: Option<&str>) -> Result<Option<Compressor>> {
        match name {
            None | Some("") => Ok(None),
            Some("vtkZLibDataCompressor") => Ok(Some(Compressor::Zlib)),
            Some("vtkLZ4DataCompressor") => Ok(Some(Compressor::Lz4)),
            Some(other) => Err(Error::input(format!(
                "compressor \"{}\" is not supported: none, zlib and LZ4 are",
                shown(other)
            ))),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Compressor::Zlib => "zlib",
            Compressor::Lz4 => "LZ4",
        }
    }

    /// The most bytes that one compressed byte can stand for.
    fn expansion_max(self) -> u64 {
        match self {
            Compressor::Zlib => 1032,
            Compressor::Lz4 => 255,
        }
    }
}

/// The whole numbers before an array.
#[derive(Clone, Copy)]
pub struct Numbers {
    /// Eight bytes each, not four.
    pub wide: bool,
    pub big_endian: bool,
}

impl Numbers {
    /// Bytes of one number.
    pub fn bytes(self) -> u64 {
        if self.wide { 8 } else { 4 }
    }

    /// The next one.
    pub fn read(self, reader: &mut dyn Read) -> Result<u64> {
        let mut bytes = [0; 8];
        let used = &mut bytes[..self.bytes() as usize];
        reader
            .read_exact(used)
            .map_err(|why| Error::input(format!("its array cannot be read: {why}")))?;
        if self.big_endian {
            used.reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }
}

/// The voxels of an array that starts with its table, of a file with `file_bytes` left, which needs
/// `bytes` decoded bytes.
pub fn stream(
    mut reader: Box<dyn Read + Send>,
    compressor: Compressor,
    numbers: Numbers,
    file_bytes: u64,
    bytes: u128,
) -> Result<Stream> {
    let count = numbers.read(&mut reader)?;
    let (block, last) = (numbers.read(&mut reader)?, numbers.read(&mut reader)?);
    // A last block of 0 bytes is a whole one.
    let whole = if last == 0 { count } else { count.saturating_sub(1) };
    let promised = u128::from(whole) * u128::from(block) + u128::from(last);
    if promised != bytes {
        return Err(Error::input(format!(
            "its array has {promised} bytes in {count} blocks, but its size and type need {bytes}"
        )));
    }
    let table_bytes = count.saturating_mul(numbers.bytes());
    let bytes_max = file_bytes.saturating_mul(compressor.expansion_max());
    if table_bytes > file_bytes.min(TABLE_BYTES_MAX)
        || block.max(last) > BLOCK_BYTES_MAX.min(bytes_max)
        || last > block
    {
        return Err(Error::input(format!(
            "its array promises {count} blocks of {block} bytes, which its {file_bytes} bytes cannot hold"
        )));
    }
    let mut sizes = VecDeque::new();
    for index in 0..count {
        let size = numbers.read(&mut reader)?;
        let decoded = if index + 1 == count && last > 0 { last } else { block };
        if size > file_bytes.min(BLOCK_BYTES_MAX) {
            return Err(Error::input(format!("block {index} of its array promises {size} bytes")));
        }
        sizes.push_back((size as usize, decoded as usize));
    }
    let blocks = Blocks { reader, compressor, sizes, packed: Vec::new(), ready: Vec::new(), at: 0 };
    Ok(Stream::from_decoder(Box::new(blocks), compressor.name(), bytes_max.min(promised as u64)))
}

struct Blocks {
    reader: Box<dyn Read + Send>,
    compressor: Compressor,
    /// Compressed and decoded bytes of the blocks to come.
    sizes: VecDeque<(usize, usize)>,
    packed: Vec<u8>,
    ready: Vec<u8>,
    at: usize,
}

impl Blocks {
    fn unpack(&mut self, packed: usize, decoded: usize) -> io::Result<()> {
        self.packed.resize(packed, 0);
        self.reader.read_exact(&mut self.packed)?;
        self.ready.resize(decoded, 0);
        let damaged = |why: String| io::Error::new(io::ErrorKind::InvalidData, why);
        match self.compressor {
            Compressor::Zlib => {
                let mut decoder = ZlibDecoder::new(&self.packed[..]);
                decoder.read_exact(&mut self.ready).map_err(|why| damaged(why.to_string()))?;
                if decoder.read(&mut [0])? > 0 {
                    return Err(damaged(format!("a block decodes to more than {decoded} bytes")));
                }
            }
            Compressor::Lz4 => {
                let got = lz4_flex::block::decompress_into(&self.packed, &mut self.ready)
                    .map_err(|why| damaged(why.to_string()))?;
                if got != decoded {
                    return Err(damaged(format!("a block decodes to {got} bytes, not {decoded}")));
                }
            }
        }
        self.at = 0;
        Ok(())
    }
}

impl Read for Blocks {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.ready.len() {
            let Some((packed, decoded)) = self.sizes.pop_front() else { return Ok(0) };
            self.unpack(packed, decoded)?;
        }
        let got = buffer.len().min(self.ready.len() - self.at);
        buffer[..got].copy_from_slice(&self.ready[self.at..self.at + got]);
        self.at += got;
        Ok(got)
    }
}
