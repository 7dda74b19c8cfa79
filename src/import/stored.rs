//! A brick store as an input: its finest level, brick by brick. So a store can be drawn whole where it
//! fits memory, or cut into other bricks.

use std::path::Path;

use crate::error::{Error, Result};
use crate::import::{Header, Input, Options, Run};
use crate::source::{BrickSource, ChannelDescription};
use crate::store::Store;
use crate::volume::{BrickBox, BrickId, Size3, Voxels, WorldFromVoxel};

struct Stored {
    store: Store,
    header: Header,
    /// Entry number of the next brick of level 0.
    next: u64,
}

/// Opens the store at `path`. Absent voxels come as NaN (of RGBA: as transparent black) and are told in
/// a note, since a store does not keep which voxels of a brick were absent.
///
/// # Errors
/// As [`Store::open`], and when channels differ in type. Every error names the file.
pub fn open(path: &Path, options: &Options) -> Result<Box<dyn Input>> {
    let store = Store::open(path)?;
    let description = store.description();
    let format = description.channels[0].format;
    if description.channels.iter().any(|row| row.format != format) {
        return Err(Error::input(format!(
            "{}: its channels have several voxel types, which only paging can draw",
            path.display()
        )));
    }
    let world_from_voxel = match options.spacing {
        Some(spacing) => WorldFromVoxel::from_spacing(spacing)?,
        None => description.world_from_voxel,
    };
    let counted = |of: fn(&ChannelDescription) -> u64| description.channels.iter().map(of).sum();
    let counts: [(u64, &str); 2] = [
        (counted(|row| row.absent_voxels), "voxels were absent when the store was made"),
        (counted(|row| row.infinite_voxels), "voxels were infinite when the store was made"),
    ];
    let told = counts.iter().filter(|(count, _)| *count > 0);
    let header = Header {
        path: path.to_owned(),
        size: description.size(),
        channels: description.channels.len() as u32,
        times: 1,
        format,
        world_from_voxel,
        scaling: description.channels.iter().map(|row| (row.slope, row.intercept)).collect(),
        unit: description.unit.clone(),
        format_name: "brick store",
        notes: told.map(|(count, what)| format!("{count} {what}")).collect(),
        absent_voxels: 0,
    };
    Ok(Box::new(Stored { store, header, next: 0 }))
}

impl Input for Stored {
    fn header(&self) -> &Header {
        &self.header
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        if self.next == self.store.numbering().count() {
            return Ok(None);
        }
        let id = self.store.numbering().brick(self.next);
        if id.level > 0 {
            return Ok(None);
        }
        self.next += 1;
        let (payload, _) = self.store.description().brick(id);
        let voxels = self.payload_voxels(id, payload)?;
        let channel = u32::from(id.channel);
        Ok(Some(Run { channel, start: payload.start, size: payload.size(), voxels }))
    }
}

impl Stored {
    /// The brick without its apron.
    fn payload_voxels(&self, id: BrickId, payload: BrickBox) -> Result<Voxels> {
        let (stored, voxels) = self.store.read_voxels(id)?;
        let Size3 { x, y, z } = payload.size();
        let width = voxels.format().bytes();
        let mut bytes = Vec::with_capacity(payload.size().len().unwrap_or(0) * width);
        for k in 1..=z {
            for j in 1..=y {
                let start = stored.index(1, j, k) * width;
                bytes.extend_from_slice(&voxels.bytes()[start..start + x as usize * width]);
            }
        }
        Ok(Voxels::from_bytes(voxels.format(), &bytes))
    }
}
