//! Where every byte of a brick store lies: docs/FORMAT.md as constants, each built from the one before.

/// One field of a fixed structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// As in docs/FORMAT.md.
    pub name: &'static str,
    /// Bytes from the start of the structure.
    pub offset: usize,
    /// Length.
    pub bytes: usize,
}

impl Field {
    const fn first(name: &'static str, bytes: usize) -> Field {
        Field { name, offset: 0, bytes }
    }

    const fn then(&self, name: &'static str, bytes: usize) -> Field {
        Field { name, offset: self.end(), bytes }
    }

    /// One past the field's last byte.
    pub const fn end(&self) -> usize {
        self.offset + self.bytes
    }

    /// The field's bytes of `structure`.
    ///
    /// # Panics
    /// When `structure` is shorter than the field's end, or N is not its length.
    pub fn of<const N: usize>(&self, structure: &[u8]) -> [u8; N] {
        structure[self.offset..self.end()].try_into().expect("a field is read at its own length")
    }

    /// As a number.
    pub fn u32(&self, structure: &[u8]) -> u32 {
        u32::from_le_bytes(self.of(structure))
    }

    /// As a number.
    pub fn u64(&self, structure: &[u8]) -> u64 {
        u64::from_le_bytes(self.of(structure))
    }

    /// As a number.
    pub fn f32(&self, structure: &[u8]) -> f32 {
        f32::from_le_bytes(self.of(structure))
    }

    /// As a number.
    pub fn f64(&self, structure: &[u8]) -> f64 {
        f64::from_le_bytes(self.of(structure))
    }

    /// Writes the field's bytes.
    ///
    /// # Panics
    /// As [`Field::of`].
    pub fn set(&self, structure: &mut [u8], bytes: &[u8]) {
        structure[self.offset..self.end()].copy_from_slice(bytes);
    }
}

/// Declares a structure: a constant per field, all of them in order, and its length.
macro_rules! structure {
    ($(#[$doc:meta])* $module:ident, $first:ident $first_name:literal $first_bytes:literal
     $(, $field:ident $name:literal $bytes:literal after $before:ident)*) => {
        $(#[$doc])*
        #[allow(missing_docs)]
        pub mod $module {
            use super::Field;
            pub const $first: Field = Field::first($first_name, $first_bytes);
            $(pub const $field: Field = $before.then($name, $bytes);)*
            /// In the order of the file.
            pub const FIELDS: &[Field] = &[$first $(, $field)*];
            /// Length of the structure.
            pub const BYTES: usize = FIELDS[FIELDS.len() - 1].end();
        }
    };
}

structure!(
    /// The start of the file.
    header, MAGIC "magic" 8,
    VERSION "version" 4 after MAGIC,
    HEADER_BYTES "header_bytes" 4 after VERSION,
    FILE_BYTES "file_bytes" 8 after HEADER_BYTES,
    INDEX_PLACE "index_place" 8 after FILE_BYTES,
    ENTRY_COUNT "entry_count" 8 after INDEX_PLACE,
    DESCRIPTION_PLACE "description_place" 8 after ENTRY_COUNT,
    DESCRIPTION_BYTES "description_bytes" 8 after DESCRIPTION_PLACE,
    DESCRIPTION_CHECKSUM "description_checksum" 8 after DESCRIPTION_BYTES,
    HEADER_CHECKSUM "header_checksum" 8 after DESCRIPTION_CHECKSUM
);

structure!(
    /// The fixed start of the description.
    description, SIZE_X "size_x" 4,
    SIZE_Y "size_y" 4 after SIZE_X,
    SIZE_Z "size_z" 4 after SIZE_Y,
    PAYLOAD_X "payload_x" 4 after SIZE_Z,
    PAYLOAD_Y "payload_y" 4 after PAYLOAD_X,
    PAYLOAD_Z "payload_z" 4 after PAYLOAD_Y,
    CHANNEL_COUNT "channel_count" 4 after PAYLOAD_Z,
    LEVEL_COUNT "level_count" 4 after CHANNEL_COUNT,
    TRANSFORM "transform" 96 after LEVEL_COUNT,
    NAME_BYTES "name_bytes" 4 after TRANSFORM,
    UNIT_BYTES "unit_bytes" 4 after NAME_BYTES,
    PROVENANCE_BYTES "provenance_bytes" 4 after UNIT_BYTES,
    APRON "apron" 4 after PROVENANCE_BYTES
);

structure!(
    /// One channel of the description.
    channel, FORMAT "format" 4,
    RESERVED "reserved" 4 after FORMAT,
    SLOPE "slope" 8 after RESERVED,
    INTERCEPT "intercept" 8 after SLOPE,
    NAN_VOXELS "nan_voxels" 8 after INTERCEPT,
    INFINITE_VOXELS "infinite_voxels" 8 after NAN_VOXELS,
    ABSENT_VOXELS "absent_voxels" 8 after INFINITE_VOXELS,
    LEAST "least" 4 after ABSENT_VOXELS,
    GREATEST "greatest" 4 after LEAST
);

structure!(
    /// One level of the description.
    level, SIZE_X "level_size_x" 4,
    SIZE_Y "level_size_y" 4 after SIZE_X,
    SIZE_Z "level_size_z" 4 after SIZE_Y,
    SCALE_X "scale_x" 4 after SIZE_Z,
    SCALE_Y "scale_y" 4 after SCALE_X,
    SCALE_Z "scale_z" 4 after SCALE_Y
);

structure!(
    /// The head of an index page.
    page, CHECKSUM "page_checksum" 8,
    NUMBER "page_number" 8 after CHECKSUM
);

structure!(
    /// What the index knows of one brick.
    entry, PLACE "place" 6,
    KIND "kind" 1 after PLACE,
    RESERVED "entry_reserved" 1 after KIND,
    STORED_BYTES "stored_bytes" 4 after RESERVED,
    LOSS "loss" 4 after STORED_BYTES,
    LEAST "entry_least" 4 after LOSS,
    GREATEST "entry_greatest" 4 after LEAST,
    CHECKSUM "checksum" 8 after GREATEST
);

structure!(
    /// The end of the file.
    trailer, HEADER_CHECKSUM "header_checksum_again" 8,
    END_MAGIC "end_magic" 8 after HEADER_CHECKSUM
);

/// The file's first bytes.
pub const MAGIC: [u8; 8] = *b"\x89BRICKS\n";
/// The file's last bytes.
pub const END_MAGIC: [u8; 8] = *b"BRICKEND";
/// Of the format.
pub const VERSION: u32 = 1;
/// Entries of a full index page.
pub const PAGE_ENTRIES: usize = 128;
/// Length of a full index page; the last one may be shorter.
pub const PAGE_BYTES: usize = page::BYTES + PAGE_ENTRIES * entry::BYTES;
/// Longest description that is read.
pub const DESCRIPTION_BYTES_MAX: u64 = 16 << 20;
/// Greatest payload per axis, so that a brick of four-byte voxels stays below 70 MB.
pub const PAYLOAD_MAX: u32 = 256;
/// Greatest number of levels.
pub const LEVEL_COUNT_MAX: u32 = 64;
/// Greatest number of channels.
pub const CHANNEL_COUNT_MAX: u32 = u16::MAX as u32;

const _: () =
    assert!(cfg!(target_endian = "little"), "voxels are stored as this machine holds them");

/// What covers bytes of the file.
pub fn checksum(bytes: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(bytes)
}

/// Bytes of an index of that many entries, or nothing where no file is that long.
pub fn index_bytes(entry_count: u64) -> Option<u64> {
    let page_heads = entry_count.div_ceil(PAGE_ENTRIES as u64).checked_mul(page::BYTES as u64)?;
    entry_count.checked_mul(entry::BYTES as u64)?.checked_add(page_heads)
}
