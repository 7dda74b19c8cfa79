//! Strips and tiles: decompression, and the predictors that are undone after it.

use std::collections::VecDeque;
use std::io::{self, BufReader, Read};

use flate2::read::ZlibDecoder;
use weezl::{BitOrder, LzwStatus, decode::Decoder};

use crate::error::{Error, Result};
use crate::import::sample::Sample;
use crate::import::stream::Section;

/// How strips and tiles are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
}

impl Compression {
    /// By the number in the tag.
    pub fn of(code: u64) -> Result<Compression> {
        Ok(match code {
            1 => Compression::None,
            5 => Compression::Lzw,
            8 | 32946 => Compression::Deflate,
            32773 => Compression::PackBits,
            50000 => Compression::Zstd,
            _ => {
                return Err(Error::input(format!(
                    "compression {code} is not supported: none, LZW, deflate, PackBits and zstd are"
                )));
            }
        })
    }

    /// The name used in messages.
    pub fn name(self) -> &'static str {
        match self {
            Compression::None => "uncompressed",
            Compression::Lzw => "LZW",
            Compression::Deflate => "deflate",
            Compression::PackBits => "PackBits",
            Compression::Zstd => "zstd",
        }
    }

    /// The most bytes that one compressed byte can stand for.
    pub fn expansion_max(self) -> u64 {
        match self {
            Compression::None => 1,
            // Codes of at least 9 bits name strings of at most 4096 bytes.
            Compression::Lzw => 4096,
            Compression::Deflate => 1032,
            Compression::PackBits => 64,
            Compression::Zstd => 32 << 10,
        }
    }

    fn decoder(self, piece: Section) -> io::Result<Box<dyn Read + Send>> {
        let feed = |piece| BufReader::with_capacity(16 << 10, piece);
        Ok(match self {
            Compression::None => Box::new(piece),
            Compression::Lzw => Box::new(Lzw::new(feed(piece))),
            Compression::Deflate => Box::new(ZlibDecoder::new(feed(piece))),
            Compression::PackBits => Box::new(PackBits::new(feed(piece))),
            Compression::Zstd => Box::new(zstd::stream::read::Decoder::with_buffer(feed(piece))?),
        })
    }
}

/// What was subtracted from samples before compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Predictor {
    None,
    /// The sample to the left.
    Horizontal,
    /// The byte to the left, after all first bytes, then all second bytes, and so on.
    Float,
}

impl Predictor {
    /// By the number in the tag.
    pub fn of(code: u64, sample: Sample) -> Result<Predictor> {
        let float = matches!(sample, Sample::F16 | Sample::F32 | Sample::F64);
        match code {
            1 => Ok(Predictor::None),
            2 => Ok(Predictor::Horizontal),
            3 if float => Ok(Predictor::Float),
            _ => Err(Error::input(format!(
                "predictor {code} is not supported for samples of {}",
                sample.name()
            ))),
        }
    }
}

/// Strips one after another, each as many bytes as its rows need.
pub struct Pieces {
    file: Section,
    compression: Compression,
    /// Offset and length in the file, and decoded length.
    waiting: VecDeque<(u64, u64, u64)>,
    current: Box<dyn Read + Send>,
    left: u64,
}

impl Pieces {
    /// Of pieces (offset, length, decoded length) of `file`.
    pub fn new(
        file: Section,
        compression: Compression,
        pieces: VecDeque<(u64, u64, u64)>,
    ) -> Pieces {
        Pieces { file, compression, waiting: pieces, current: Box::new(io::empty()), left: 0 }
    }
}

impl Read for Pieces {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.left == 0 {
            let Some((offset, bytes, decoded)) = self.waiting.pop_front() else { return Ok(0) };
            self.current = self.compression.decoder(self.file.part(offset, bytes))?;
            self.left = decoded;
        }
        let want = (buffer.len() as u64).min(self.left) as usize;
        let got = self.current.read(&mut buffer[..want])?;
        if got == 0 && want > 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.left -= got as u64;
        Ok(got)
    }
}

/// Undoes a predictor, row by row.
pub struct Rows<R> {
    inner: R,
    predictor: Predictor,
    /// Bytes of a sample, and samples from a pixel to the next.
    sample_bytes: usize,
    samples: usize,
    big_endian: bool,
    row: Vec<u8>,
    at: usize,
    left: u64,
}

impl<R: Read> Rows<R> {
    /// `rows` rows of `row_bytes` bytes.
    pub fn new(
        inner: R,
        predictor: Predictor,
        sample: [usize; 2],
        big_endian: bool,
        row_bytes: usize,
        rows: u64,
    ) -> Rows<R> {
        let [sample_bytes, samples] = sample;
        let row = vec![0; row_bytes];
        Rows { inner, predictor, sample_bytes, samples, big_endian, row, at: row_bytes, left: rows }
    }

    fn undo(&mut self) {
        let bytes = self.sample_bytes;
        match self.predictor {
            Predictor::None => {}
            Predictor::Horizontal => {
                let big = self.big_endian;
                for first in (self.samples * bytes..self.row.len()).step_by(bytes) {
                    let (before, here) = self.row.split_at_mut(first);
                    let left = &before[first - self.samples * bytes..];
                    let mut carry = 0;
                    for significance in 0..bytes {
                        let byte = if big { bytes - 1 - significance } else { significance };
                        let sum = u16::from(left[byte]) + u16::from(here[byte]) + carry;
                        here[byte] = sum as u8;
                        carry = sum >> 8;
                    }
                }
            }
            Predictor::Float => {
                for index in self.samples..self.row.len() {
                    self.row[index] = self.row[index].wrapping_add(self.row[index - self.samples]);
                }
                let split = self.row.clone();
                let count = split.len() / bytes;
                for (index, sample) in self.row.chunks_exact_mut(bytes).enumerate() {
                    for (byte, to) in sample.iter_mut().enumerate() {
                        // The most significant bytes come first, whatever the file's order.
                        let plane = if self.big_endian { byte } else { bytes - 1 - byte };
                        *to = split[plane * count + index];
                    }
                }
            }
        }
    }
}

impl<R: Read> Read for Rows<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.row.len() {
            if self.left == 0 {
                return Ok(0);
            }
            self.inner.read_exact(&mut self.row)?;
            self.undo();
            self.at = 0;
            self.left -= 1;
        }
        let got = buffer.len().min(self.row.len() - self.at);
        buffer[..got].copy_from_slice(&self.row[self.at..self.at + got]);
        self.at += got;
        Ok(got)
    }
}

/// LZW as TIFF has it: most significant bit first, codes widen one early.
struct Lzw<R> {
    inner: R,
    decoder: Decoder,
}

impl<R> Lzw<R> {
    fn new(inner: R) -> Lzw<R> {
        Lzw { inner, decoder: Decoder::with_tiff_size_switch(BitOrder::Msb, 8) }
    }
}

impl<R: io::BufRead> Read for Lzw<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let input = self.inner.fill_buf()?;
            let at_end = input.is_empty();
            let result = self.decoder.decode_bytes(input, buffer);
            self.inner.consume(result.consumed_in);
            match result.status {
                _ if result.consumed_out > 0 => return Ok(result.consumed_out),
                Ok(LzwStatus::Done) => return Ok(0),
                Ok(_) if at_end => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(_) => {}
                Err(why) => {
                    return Err(io::Error::new(io::ErrorKind::InvalidData, why.to_string()));
                }
            }
        }
    }
}

/// Runs of literal and of repeated bytes.
struct PackBits<R> {
    inner: R,
    literal: usize,
    repeat: usize,
    byte: u8,
}

impl<R> PackBits<R> {
    fn new(inner: R) -> PackBits<R> {
        PackBits { inner, literal: 0, repeat: 0, byte: 0 }
    }
}

impl<R: Read> Read for PackBits<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.literal == 0 && self.repeat == 0 {
            let mut byte = [0];
            if self.inner.read(&mut byte)? == 0 {
                return Ok(0);
            }
            match byte[0] {
                count @ 0..=127 => self.literal = usize::from(count) + 1,
                128 => {}
                count => {
                    self.inner.read_exact(&mut byte)?;
                    (self.repeat, self.byte) = (257 - usize::from(count), byte[0]);
                }
            }
        }
        let got = buffer.len().min(self.literal.max(self.repeat));
        if self.repeat > 0 {
            buffer[..got].fill(self.byte);
            self.repeat -= got;
        } else {
            self.inner.read_exact(&mut buffer[..got])?;
            self.literal -= got;
        }
        Ok(got)
    }
}
