//! The one door through which bricks come: cheap knowledge first, voxels when they are wanted.

use crate::error::{Error, Result};
use crate::source::Description;
use crate::volume::{BrickId, Size3, ValueRange, VoxelFormat, Voxels};

/// What is known of a brick without reading it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BrickEntry {
    /// Nothing is there: every voxel reads as NaN (of RGBA: transparent black). Drawn as nothing.
    Absent,
    /// Every voxel, apron included, has these bytes: the voxel's own first, then zeros.
    Constant([u8; 4]),
    /// It has to be read.
    Stored {
        /// Of its voxels, apron included: exact in a store, bounds in a computed source.
        range: ValueRange,
        /// What the next coarser level cannot show of it: root mean square, in stored values.
        /// 0 in the last level; NaN where the source does not know.
        loss: f32,
    },
}

impl BrickEntry {
    /// Range of the brick's voxels (of RGBA: of their alpha); empty when absent.
    pub fn range(&self, format: VoxelFormat) -> ValueRange {
        match *self {
            BrickEntry::Absent => ValueRange::EMPTY,
            BrickEntry::Constant(voxel) => {
                Voxels::from_bytes(format, &voxel[..format.bytes()]).range()
            }
            BrickEntry::Stored { range, .. } => range,
        }
    }
}

/// A volume in bricks. Every method may be called from any thread.
///
/// What every source keeps, and `tests/brick_source.rs` holds all of them to:
/// - a brick's voxels lie within its entry's range;
/// - its apron equals the neighbours' voxels, and repeats the edge voxel at the volume's faces;
/// - reading twice gives the same bytes.
pub trait BrickSource: Send + Sync {
    /// What it holds.
    fn description(&self) -> &Description;

    /// What is known of brick `id` without reading its voxels.
    ///
    /// # Errors
    /// When there is no such brick, or the index cannot be read.
    fn entry(&self, id: BrickId) -> Result<BrickEntry>;

    /// Replaces `bytes` by the brick's voxels, apron included: x fastest, then y, then z, each little
    /// endian; [`Description::brick_bytes`] says how many. Absent and constant bricks can be read too.
    ///
    /// # Errors
    /// When there is no such brick, or it cannot be read whole and undamaged.
    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()>;

    /// The same, and `fetched` is called once when what is stored of the brick is in memory and only decoding is
    /// left. A source without such a moment never calls it.
    ///
    /// # Errors
    /// As [`BrickSource::read`].
    fn read_telling(
        &self,
        id: BrickId,
        bytes: &mut Vec<u8>,
        _fetched: &mut dyn FnMut(),
    ) -> Result<()> {
        self.read(id, bytes)
    }

    /// The same as typed voxels, with their number along each axis.
    ///
    /// # Errors
    /// As [`BrickSource::read`].
    fn read_voxels(&self, id: BrickId) -> Result<(Size3, Voxels)> {
        let mut bytes = Vec::new();
        self.read(id, &mut bytes)?;
        let description = self.description();
        let format = description.channels[usize::from(id.channel)].format;
        Ok((description.brick(id).1, Voxels::from_bytes(format, &bytes)))
    }
}

/// The error for a brick that the volume does not have.
pub(crate) fn no_such_brick(description: &Description, id: BrickId) -> Error {
    Error::input(format!("volume \"{}\" has no {id}", description.name))
}

/// Reads a brick from a source that is not trusted: one that comes back short, long or with values
/// outside its entry's range is an error. (A wrong value within the range cannot be told.)
///
/// # Errors
/// As [`BrickSource::read`], and those.
pub fn read_checked(source: &dyn BrickSource, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
    read_checked_telling(source, id, bytes, &mut || {})
}

/// As [`read_checked`]; `fetched` is called as [`BrickSource::read_telling`] calls it.
///
/// # Errors
/// As [`read_checked`].
pub fn read_checked_telling(
    source: &dyn BrickSource,
    id: BrickId,
    bytes: &mut Vec<u8>,
    fetched: &mut dyn FnMut(),
) -> Result<()> {
    let description = source.description();
    let entry = source.entry(id)?;
    source.read_telling(id, bytes, fetched)?;
    let name = &description.name;
    let wanted = description.brick_bytes(id);
    if bytes.len() != wanted {
        return Err(Error::input(format!(
            "volume \"{name}\": {id} came with {} bytes where {wanted} belong; read it again",
            bytes.len()
        )));
    }
    let format = description.channels[usize::from(id.channel)].format;
    let known = entry.range(format);
    let got = Voxels::from_bytes(format, bytes).range();
    if !got.is_empty() && (got.least < known.least || got.greatest > known.greatest) {
        return Err(Error::input(format!(
            "volume \"{name}\": {id} holds values from {} to {} where its entry says {} to {}; \
             it is damaged",
            got.least, got.greatest, known.least, known.greatest
        )));
    }
    Ok(())
}
