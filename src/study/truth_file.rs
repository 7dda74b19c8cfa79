//! The reference picture on disk, so that a study that goes on need not integrate it again.
//!
//! A NumPy file (format 1.0) of f64, little endian, rows x columns x rgba, row 0 on top.

use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use crate::error::{Error, Result};
use crate::reference::Picture;

/// Writes it under a temporary name and renames it when whole; returns the hash of all its bytes.
///
/// # Errors
/// Exit code 4 when it cannot be written.
pub fn write(path: &Path, picture: &Picture) -> Result<u64> {
    let mut bytes = header(picture.size);
    bytes.extend(picture.rgba.iter().flatten().flat_map(|part| part.to_le_bytes()));
    let partial = path.with_extension("partial");
    let written = std::fs::write(&partial, &bytes).and_then(|()| std::fs::rename(&partial, path));
    written.map_err(|why| {
        let _ = std::fs::remove_file(&partial);
        Error::machine(format!("{}: cannot be written: {why}; see to the disk", path.display()))
    })?;
    Ok(xxh3_64(&bytes))
}

/// Reads one of `size` pixels whose bytes have this hash; nothing when there is no file.
///
/// # Errors
/// Exit code 3 when it cannot be read or holds anything else.
pub fn read(path: &Path, size: [u32; 2], hash: u64) -> Result<Option<Picture>> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(why) => {
            return Err(Error::input(format!("{}: cannot be read: {why}", path.display())));
        }
    };
    let header = header(size);
    let whole = bytes.starts_with(&header) && xxh3_64(&bytes) == hash;
    if !whole {
        return Err(Error::input(format!(
            "{}: is not the reference that this study wrote: remove it, and it is integrated anew",
            path.display()
        )));
    }
    let (values, _) = bytes[header.len()..].as_chunks::<8>();
    let values: Vec<f64> = values.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let (pixels, _) = values.as_chunks::<4>();
    Ok(Some(Picture { size, rgba: pixels.to_vec() }))
}

fn header([width, height]: [u32; 2]) -> Vec<u8> {
    let words =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({height}, {width}, 4), }}");
    // Magic, version, length, words, spaces and a line's end: a multiple of 64 bytes.
    let padded = (10 + words.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((padded as u16).to_le_bytes());
    bytes.extend(format!("{words:<width$}\n", width = padded - 1).bytes());
    bytes
}
