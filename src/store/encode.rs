//! A brick's voxels -> its entry and its bytes in the file.

use crate::source::BrickEntry;
use crate::store::entry::{Entry, Kind};
use crate::store::layout::checksum;
use crate::volume::{BRICK_APRON, Size3, ValueRange, Voxel};

/// What may be done to make bricks smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Nothing.
    None,
    /// LZ4, where it helps.
    Lz4,
}

/// Encoded bricks that follow each other in the index, ready for the writer.
#[derive(Default)]
pub struct Encoded {
    /// In order; places count from the start of `bytes`.
    pub(crate) entries: Vec<Entry>,
    /// The bricks' bytes, back to back.
    pub(crate) bytes: Vec<u8>,
    /// Where bricks are packed before it is known whether that made them smaller.
    packed: Vec<u8>,
}

impl Encoded {
    /// The range of all bricks so far.
    pub fn range(&self) -> ValueRange {
        let known = self.entries.iter().filter(|entry| entry.kind != Kind::Absent);
        known.fold(ValueRange::EMPTY, |range, entry| range.union(entry.range))
    }
}

/// What there is to know of a brick of these stored voxels (apron included).
///
/// `loss` is called for bricks that are neither absent nor constant.
pub fn entry_of<V: Voxel>(voxels: &[V], loss: impl FnOnce() -> f32) -> BrickEntry {
    let range = V::range(voxels);
    if range.is_empty() {
        return BrickEntry::Absent;
    }
    let raw: &[u8] = bytemuck::cast_slice(voxels);
    let first = &raw[..size_of::<V>()];
    // One range is not enough: -0 equals 0, alpha says nothing of colour, NaN has no range.
    if range.least == range.greatest && raw.chunks_exact(size_of::<V>()).all(|voxel| voxel == first)
    {
        let mut voxel = [0; 4];
        voxel[..first.len()].copy_from_slice(first);
        return BrickEntry::Constant(voxel);
    }
    BrickEntry::Stored { range, loss: loss() }
}

/// Adds a brick of `size` stored voxels (apron included) to `encoded`.
///
/// `loss` is called for bricks that are neither absent nor constant.
pub fn encode<V: Voxel>(
    voxels: &[V],
    size: Size3,
    compression: Compression,
    loss: impl FnOnce() -> f32,
    encoded: &mut Encoded,
) {
    debug_assert_eq!(size.voxel_count(), voxels.len() as u128);
    debug_assert!(size.x > 2 * BRICK_APRON);
    let entry = place(voxels, compression, loss, encoded);
    encoded.entries.push(entry);
}

fn place<V: Voxel>(
    voxels: &[V],
    compression: Compression,
    loss: impl FnOnce() -> f32,
    Encoded { bytes: out, packed, .. }: &mut Encoded,
) -> Entry {
    let entry = entry_of(voxels, loss);
    let (range, loss) = match entry {
        BrickEntry::Absent => return Entry::ABSENT,
        BrickEntry::Constant(voxel) => {
            let place = u64::from(u32::from_le_bytes(voxel));
            let range = entry.range(V::FORMAT);
            return Entry { kind: Kind::Constant, place, range, ..Entry::ABSENT };
        }
        BrickEntry::Stored { range, loss } => (range, loss),
    };
    let raw: &[u8] = bytemuck::cast_slice(voxels);
    let start = out.len();
    let mut kind = Kind::Raw;
    if compression == Compression::Lz4 {
        packed.resize(packed.len().max(lz4_flex::block::get_maximum_output_size(raw.len())), 0);
        let len = lz4_flex::block::compress_into(raw, packed)
            .expect("the output has the greatest size that LZ4 can need");
        if len < raw.len() {
            kind = Kind::Lz4;
            out.extend_from_slice(&packed[..len]);
        }
    }
    if kind == Kind::Raw {
        out.extend_from_slice(raw);
    }
    let stored = &out[start..];
    Entry {
        kind,
        place: start as u64,
        stored_bytes: u32::try_from(stored.len()).expect("PAYLOAD_MAX keeps bricks below 4 GiB"),
        loss,
        range,
        checksum: checksum(stored),
    }
}
