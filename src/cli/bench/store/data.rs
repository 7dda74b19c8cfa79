//! The bench's volume: something like a scan, neither all noise nor all smooth.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use rayon::prelude::*;

use crate::cli::bench::store::{Folder, disk};
use crate::error::Result;

/// Nothing outside a ball; inside, smooth shells, with two bits of noise in the inner part and a
/// little in the outer: about a quarter of it compresses badly.
pub fn slice(edge: u32, z: u32) -> Vec<u8> {
    let unit = |i: u32| f64::from(i) / f64::from(edge) - 0.5;
    let w = unit(z);
    let mut noise = (u64::from(z) + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut voxels = Vec::with_capacity(edge as usize * edge as usize);
    for y in 0..edge {
        let v = unit(y);
        for x in 0..edge {
            let u = unit(x);
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            let r = (u * u + v * v + w * w).sqrt();
            voxels.push(if r > 0.48 {
                0
            } else {
                let base = 90.0 + 60.0 * (20.0 * r).sin() + 30.0 * (9.0 * u + 7.0 * v).sin();
                let noise = if r < 0.3 { noise % 4 } else { u64::from(noise.is_multiple_of(16)) };
                base as u8 + noise as u8
            });
        }
    }
    voxels
}

/// Writes the volume of `edge` voxels along x and y and `slices` along z as a raw u8 file.
pub fn raw_file(folder: &Folder, edge: u32, slices: u32) -> Result<PathBuf> {
    let path = folder.0.join(format!("{edge}x{edge}x{slices}.raw"));
    (|| {
        let mut out = BufWriter::with_capacity(1 << 20, File::create(&path)?);
        for start in (0..slices).step_by(16) {
            let group = start..(start + 16).min(slices);
            let group: Vec<Vec<u8>> = group.into_par_iter().map(|z| slice(edge, z)).collect();
            group.iter().try_for_each(|slice| out.write_all(slice))?;
        }
        out.flush()
    })()
    .map_err(|why| disk(folder, &why))?;
    Ok(path)
}
