//! What the index knows of one brick, and its 32 bytes.

use crate::source::BrickEntry;
use crate::store::layout::entry as fields;
use crate::volume::ValueRange;

/// How a brick is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Every voxel is absent.
    Absent = 0,
    /// Every voxel has the same bits.
    Constant = 1,
    /// As it is.
    Raw = 2,
    /// As one LZ4 block.
    Lz4 = 3,
}

/// One entry, decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// How the brick is kept.
    pub kind: Kind,
    /// Place of its bytes in the file; the voxel's bytes when constant. Below 2^48.
    pub place: u64,
    /// Bytes in the file.
    pub stored_bytes: u32,
    /// See docs/FORMAT.md.
    pub loss: f32,
    /// Of the stored voxels; 0 to 0 when absent.
    pub range: ValueRange,
    /// Of the bytes in the file.
    pub checksum: u64,
}

impl Entry {
    /// The entry of a brick of absent voxels: all zeros.
    pub const ABSENT: Entry = Entry {
        kind: Kind::Absent,
        place: 0,
        stored_bytes: 0,
        loss: 0.0,
        range: ValueRange::of(0.0),
        checksum: 0,
    };

    /// Its bytes.
    pub fn to_bytes(self) -> [u8; fields::BYTES] {
        let mut bytes = [0; fields::BYTES];
        fields::PLACE.set(&mut bytes, &self.place.to_le_bytes()[..fields::PLACE.bytes]);
        fields::KIND.set(&mut bytes, &[self.kind as u8]);
        fields::STORED_BYTES.set(&mut bytes, &self.stored_bytes.to_le_bytes());
        fields::LOSS.set(&mut bytes, &self.loss.to_le_bytes());
        fields::LEAST.set(&mut bytes, &self.range.least.to_le_bytes());
        fields::GREATEST.set(&mut bytes, &self.range.greatest.to_le_bytes());
        fields::CHECKSUM.set(&mut bytes, &self.checksum.to_le_bytes());
        bytes
    }

    /// From its bytes; nothing when they mean nothing. Whether the brick's bytes lie in the file is
    /// the reader's to see.
    pub fn from_bytes(bytes: &[u8]) -> Option<Entry> {
        let mut place = [0; 8];
        place[..fields::PLACE.bytes].copy_from_slice(&fields::PLACE.of::<6>(bytes));
        let [kind] = fields::KIND.of(bytes);
        let entry = Entry {
            kind: [Kind::Absent, Kind::Constant, Kind::Raw, Kind::Lz4]
                .into_iter()
                .find(|&known| known as u8 == kind)?,
            place: u64::from_le_bytes(place),
            stored_bytes: fields::STORED_BYTES.u32(bytes),
            loss: fields::LOSS.f32(bytes),
            range: ValueRange {
                least: fields::LEAST.f32(bytes),
                greatest: fields::GREATEST.f32(bytes),
            },
            checksum: fields::CHECKSUM.u64(bytes),
        };
        let in_file = matches!(entry.kind, Kind::Raw | Kind::Lz4);
        let sound = fields::RESERVED.of(bytes) == [0]
            && (in_file == (entry.stored_bytes > 0))
            && (in_file || (entry.checksum == 0 && entry.loss == 0.0))
            && entry.loss.is_finite()
            && entry.loss >= 0.0
            // Every voxel of a constant NaN would have been absent, so there is always a range.
            && entry.range.least <= entry.range.greatest
            && (entry.kind != Kind::Absent || entry == Entry::ABSENT)
            && (entry.kind != Kind::Constant || entry.place <= u64::from(u32::MAX));
        sound.then_some(entry)
    }

    /// As readers of bricks see it.
    pub fn knowledge(self) -> BrickEntry {
        match self.kind {
            Kind::Absent => BrickEntry::Absent,
            Kind::Constant => BrickEntry::Constant((self.place as u32).to_le_bytes()),
            Kind::Raw | Kind::Lz4 => BrickEntry::Stored { range: self.range, loss: self.loss },
        }
    }
}
