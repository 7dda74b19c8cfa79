//! Writers of small files, one for each format, written from the formats' own words.

use std::io::Write;
use std::path::Path;

use crate::folder::Folder;
use ashfall::error::Error;
use ashfall::import::{Header, Options, open, read_whole};
use ashfall::volume::{Size3, VolumeVoxels, Voxels};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

/// The size of all small volumes: no two axes alike.
pub const SIZE: Size3 = Size3::new(5, 4, 3);

/// Opens a file and collects all its channels.
pub fn whole(path: &Path, options: &Options) -> Result<(Header, VolumeVoxels), Error> {
    let mut input = open(path, options)?;
    let header = input.header().clone();
    let channels: Vec<u32> = (0..header.channels).collect();
    let whole = read_whole(&mut *input, &channels, 64 << 20)?;
    Ok((header, whole))
}

/// As [`whole`], of a file with these bytes.
pub fn read(name: &str, bytes: &[u8], options: &Options) -> Result<(Header, VolumeVoxels), Error> {
    let scratch = Folder::new("formats");
    whole(&scratch.write(name, bytes), options)
}

/// The message of a file that must be refused, without its path.
pub fn refusal(name: &str, bytes: &[u8], options: &Options) -> String {
    let why = read(name, bytes, options).expect_err("must be refused");
    assert_eq!(why.exit as u8, 3, "{why}");
    let (_, message) = why.message.split_once(&format!("{name}: ")).expect("path comes first");
    message.to_owned()
}

/// The value of a voxel of channel `c` at time `t`: different for every voxel, negative for some.
pub fn value(c: usize, t: usize, x: usize, y: usize, z: usize) -> i16 {
    (x + 10 * y + 100 * z + 1000 * c + 5000 * t) as i16 - 150
}

/// All values of a channel at a time, x fastest.
pub fn values(c: usize, t: usize) -> Vec<i16> {
    let [nx, ny, nz] = SIZE.to_array().map(|edge| edge as usize);
    let mut out = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            out.extend((0..nx).map(|x| value(c, t, x, y, z)));
        }
    }
    out
}

/// That a channel holds [`values`], whatever its format.
pub fn assert_values(voxels: &Voxels, c: usize, t: usize) {
    let want: Vec<f32> = values(c, t).into_iter().map(f32::from).collect();
    let got: Vec<f32> = (0..voxels.len()).map(|index| voxels.value(index)).collect();
    assert_eq!(got, want, "channel {c} time {t}");
}

/// i16 values as bytes.
pub fn bytes_of(values: &[i16], big_endian: bool) -> Vec<u8> {
    let bytes = |value: &i16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    values.iter().flat_map(bytes).collect()
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |three: &[u8]| -> String {
        let bits = (0..3).fold(0u32, |bits, index| {
            bits << 8 | u32::from(three.get(index).copied().unwrap_or(0))
        });
        let digit = |index: usize| DIGITS[(bits >> (18 - 6 * index)) as usize & 63] as char;
        (0..4).map(|index| if index > three.len() { '=' } else { digit(index) }).collect()
    };
    bytes.chunks(3).map(group).collect()
}

/// A NIfTI header; fields are set by offset and value, in the byte order asked for.
pub struct Nifti {
    pub bytes: Vec<u8>,
    pub big_endian: bool,
    pub v2: bool,
}

impl Nifti {
    /// Of i16 voxels along `dims`.
    pub fn new(v2: bool, big_endian: bool, dims: &[u16]) -> Nifti {
        let mut header = Nifti { bytes: vec![0; if v2 { 544 } else { 352 }], big_endian, v2 };
        let mut all = vec![dims.len() as u16];
        all.extend(dims);
        if v2 {
            header.put(0, &540u32.to_le_bytes());
            header.bytes[4..8].copy_from_slice(b"n+2\0");
            header.put(12, &4u16.to_le_bytes());
            header.put(168, &544u64.to_le_bytes());
            for (index, dim) in all.iter().enumerate() {
                header.put(16 + 8 * index, &u64::from(*dim).to_le_bytes());
            }
        } else {
            header.put(0, &348u32.to_le_bytes());
            header.bytes[344..348].copy_from_slice(b"n+1\0");
            header.put(70, &4u16.to_le_bytes());
            header.put(108, &352f32.to_le_bytes());
            for (index, dim) in all.iter().enumerate() {
                header.put(40 + 2 * index, &dim.to_le_bytes());
            }
        }
        header
    }

    /// A number given least significant byte first.
    pub fn put(&mut self, offset: usize, little: &[u8]) {
        let mut bytes = little.to_vec();
        if self.big_endian {
            bytes.reverse();
        }
        self.bytes[offset..offset + bytes.len()].copy_from_slice(&bytes);
    }

    /// A real number at its offset in version 1 or 2.
    pub fn real(&mut self, v1: usize, v2: usize, index: usize, value: f64) {
        if self.v2 {
            self.put(v2 + 8 * index, &value.to_le_bytes());
        } else {
            self.put(v1 + 4 * index, &(value as f32).to_le_bytes());
        }
    }

    /// The header and voxels behind it.
    pub fn with(&self, voxels: &[u8]) -> Vec<u8> {
        [&self.bytes, voxels].concat()
    }
}

/// A .npy file.
pub fn npy(descr: &str, fortran: bool, shape: &[usize], voxels: &[u8]) -> Vec<u8> {
    let shape: String = shape.iter().map(|len| format!("{len}, ")).collect();
    let fortran = if fortran { "True" } else { "False" };
    let mut header =
        format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': ({shape}), }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(voxels);
    bytes
}

/// A ZIP archive of members, deflated or stored.
pub fn zip(members: &[(&str, Vec<u8>)], deflated: bool) -> Vec<u8> {
    let (mut archive, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in members {
        let mut crc = flate2::Crc::new();
        crc.update(bytes);
        let packed = if deflated {
            let mut encoder =
                flate2::write::DeflateEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        } else {
            bytes.clone()
        };
        let mut common = vec![20, 0, 0, 0, if deflated { 8 } else { 0 }, 0, 0, 0, 0, 0];
        common.extend(crc.sum().to_le_bytes());
        common.extend((packed.len() as u32).to_le_bytes());
        common.extend((bytes.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend((archive.len() as u32).to_le_bytes());
        directory.extend(name.bytes());
        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(name.bytes());
        archive.extend(packed);
    }
    let (count, offset) = (members.len() as u16, archive.len() as u32);
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
    archive.extend((directory.len() as u32).to_le_bytes());
    archive.extend(offset.to_le_bytes());
    archive.extend([0, 0]);
    archive
}

/// A SEG-Y file: traces of (inline, crossline, trace kind, samples as bytes).
pub fn segy(
    big_endian: bool,
    format: u16,
    samples: u16,
    traces: &[(i32, i32, u16, Vec<u8>)],
) -> Vec<u8> {
    let short = |value: u16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let long = |value: i32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut bytes = vec![b' '; 3200];
    bytes.extend([0; 400]);
    bytes[3216..3218].copy_from_slice(&short(4000));
    bytes[3220..3222].copy_from_slice(&short(samples));
    bytes[3224..3226].copy_from_slice(&short(format));
    for (inline, crossline, kind, data) in traces {
        let mut header = vec![0; 240];
        header[28..30].copy_from_slice(&short(*kind));
        header[188..192].copy_from_slice(&long(*inline));
        header[192..196].copy_from_slice(&long(*crossline));
        bytes.extend(header);
        bytes.extend(data);
    }
    bytes
}

/// One tag of a TIFF page: whole numbers, or text.
pub enum Tag {
    Numbers(u16, Vec<u64>),
    Text(u16, String),
    Fraction(u16, u32, u32),
}

/// A TIFF file of pages, each of tags and pieces (strips or tiles).
pub struct Tiff {
    pub big_endian: bool,
    pub big: bool,
    pub tiled: bool,
}

impl Tiff {
    fn number(&self, value: u64, bytes: usize) -> Vec<u8> {
        let mut out = value.to_le_bytes()[..bytes].to_vec();
        if self.big_endian {
            out.reverse();
        }
        out
    }

    pub fn write(&self, pages: &[(Vec<Tag>, Vec<Vec<u8>>)]) -> Vec<u8> {
        let word = if self.big { 8 } else { 4 };
        let mut out = if self.big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        out.extend(self.number(if self.big { 43 } else { 42 }, 2));
        if self.big {
            out.extend([self.number(8, 2), self.number(0, 2)].concat());
        }
        let mut link = out.len();
        out.extend(vec![0; word]);
        for (tags, pieces) in pages {
            let mut entries: Vec<(u16, u16, u64, Vec<u8>)> = Vec::new();
            let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
            for piece in pieces {
                offsets.extend(self.number(out.len() as u64, word));
                lengths.extend(self.number(piece.len() as u64, word));
                out.extend(piece);
            }
            let (kind, count) = (if self.big { 16 } else { 4 }, pieces.len() as u64);
            let places = if self.tiled { [324, 325] } else { [273, 279] };
            entries.push((places[0], kind, count, offsets));
            entries.push((places[1], kind, count, lengths));
            for tag in tags {
                entries.push(match tag {
                    Tag::Numbers(tag, values) => {
                        let bytes = values.iter().flat_map(|value| self.number(*value, 4));
                        (*tag, 4, values.len() as u64, bytes.collect())
                    }
                    Tag::Text(tag, text) => {
                        (*tag, 2, text.len() as u64 + 1, [text.as_bytes(), &[0]].concat())
                    }
                    Tag::Fraction(tag, above, below) => {
                        let parts = [*above, *below].map(|part| self.number(u64::from(part), 4));
                        (*tag, 5, 1, parts.concat())
                    }
                });
            }
            entries.sort_by_key(|entry| entry.0);
            let mut table = self.number(entries.len() as u64, if self.big { 8 } else { 2 });
            for (tag, kind, count, mut value) in entries {
                table.extend([self.number(tag.into(), 2), self.number(kind.into(), 2)].concat());
                table.extend(self.number(count, word));
                if value.len() > word {
                    let at = self.number(out.len() as u64, word);
                    out.extend(std::mem::replace(&mut value, at));
                }
                value.resize(word, 0);
                table.extend(value);
            }
            let here = self.number(out.len() as u64, word);
            out[link..link + word].copy_from_slice(&here);
            out.extend(table);
            link = out.len();
            out.extend(vec![0; word]);
        }
        out
    }
}
