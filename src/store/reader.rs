//! A store, opened: header and description are read, index pages and bricks when they are asked for.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::error::{Error, Result};
use crate::source::{BrickEntry, BrickSource, Description};
use crate::store::entry::{Entry, Kind};
use crate::store::layout::{
    DESCRIPTION_BYTES_MAX, END_MAGIC, MAGIC, PAGE_BYTES, PAGE_ENTRIES, VERSION, checksum,
    entry as entry_fields, header, index_bytes, page, trailer,
};
use crate::store::pages::PageCache;
use crate::store::{Numbering, describe};
use crate::volume::{BrickId, Voxels};

/// A brick file. Reads are positioned, so any number of threads may read at once.
pub struct Store {
    file: File,
    path: PathBuf,
    description: Description,
    numbering: Numbering,
    index_place: u64,
    description_place: u64,
    pages: PageCache,
    /// Packed bricks of reads that have ended, one per reader at most: their memory is used again.
    scratch: Mutex<Vec<Vec<u8>>>,
}

impl Store {
    /// Whether the file at `path` begins like a store.
    pub fn is_store(path: &Path) -> bool {
        let mut magic = [0; MAGIC.len()];
        File::open(path).and_then(|file| file.read_exact_at(&mut magic, 0)).is_ok()
            && magic == MAGIC
    }

    /// Opens a store. Costs one read of the header, the trailer and the description, whatever the
    /// number of bricks.
    ///
    /// # Errors
    /// When the file cannot be read, is no store, was cut, or its header or description is damaged.
    pub fn open(path: &Path) -> Result<Store> {
        let place = path.display();
        let unreadable = |why: io::Error| Error::input(format!("{place}: cannot be read ({why})"));
        let bad = |what: &str| {
            Error::input(format!("{place}: {what}; import the volume again or fetch a whole copy"))
        };
        let file = File::open(path).map_err(unreadable)?;
        let metadata = file.metadata().map_err(unreadable)?;
        if metadata.is_dir() {
            return Err(Error::input(format!("{place}: is a folder where a store is wanted")));
        }
        let len = metadata.len();
        let mut head = [0; header::BYTES];
        let read = file.read_at(&mut head, 0).map_err(unreadable)?;
        if read < MAGIC.len() || header::MAGIC.of(&head) != MAGIC {
            return Err(Error::input(format!(
                "{place}: is no brick store; make one with `ashfall import`"
            )));
        }
        let version = header::VERSION.u32(&head);
        if read == head.len() && version != VERSION {
            return Err(Error::input(format!(
                "{place}: is a store of version {version} where this program reads {VERSION}; \
                 use the program that wrote it or import the volume again"
            )));
        }
        let head_checksum = checksum(&head[..header::HEADER_CHECKSUM.offset]);
        if read < head.len()
            || header::HEADER_CHECKSUM.u64(&head) != head_checksum
            || header::HEADER_BYTES.u32(&head) as usize != header::BYTES
        {
            return Err(bad("its header is damaged"));
        }
        let file_bytes = header::FILE_BYTES.u64(&head);
        if file_bytes != len {
            return Err(bad(&format!("it has {len} bytes where {file_bytes} belong")));
        }
        let mut tail = [0; trailer::BYTES];
        file.read_exact_at(&mut tail, len - trailer::BYTES as u64).map_err(unreadable)?;
        if trailer::HEADER_CHECKSUM.u64(&tail) != head_checksum
            || trailer::END_MAGIC.of(&tail) != END_MAGIC
        {
            return Err(bad("its end is damaged"));
        }

        let entry_count = header::ENTRY_COUNT.u64(&head);
        let index_place = header::INDEX_PLACE.u64(&head);
        let description_place = header::DESCRIPTION_PLACE.u64(&head);
        let description_bytes = header::DESCRIPTION_BYTES.u64(&head);
        let tiled = index_bytes(entry_count)
            .and_then(|bytes| index_place.checked_add(bytes))
            .filter(|&end| index_place >= header::BYTES as u64 && end == description_place)
            .and_then(|end| end.checked_add(description_bytes))
            .and_then(|end| end.checked_add(trailer::BYTES as u64))
            == Some(len);
        if !tiled || description_bytes > DESCRIPTION_BYTES_MAX {
            return Err(bad("its header contradicts itself"));
        }
        let mut bytes = vec![0; description_bytes as usize];
        file.read_exact_at(&mut bytes, description_place).map_err(unreadable)?;
        if checksum(&bytes) != header::DESCRIPTION_CHECKSUM.u64(&head) {
            return Err(bad("its description is damaged"));
        }
        let description = describe::from_bytes(&bytes).map_err(|why| bad(&why.message))?;
        let numbering = Numbering::of_description(&description)
            .filter(|numbering| numbering.count() == entry_count)
            .ok_or_else(|| bad("its description and its index have not the same bricks"))?;
        Ok(Store {
            file,
            path: path.to_owned(),
            description,
            numbering,
            index_place,
            description_place,
            pages: PageCache::new(),
            scratch: Mutex::new(Vec::new()),
        })
    }

    /// Entry numbers of its bricks.
    pub fn numbering(&self) -> &Numbering {
        &self.numbering
    }

    /// Where the bricks' bytes lie: the first place and one past the last.
    pub(crate) fn brick_places(&self) -> (u64, u64) {
        (header::BYTES as u64, self.index_place)
    }

    /// An error that names the file and the brick, or the page of bricks.
    fn damaged(&self, what: impl std::fmt::Display, how: &str) -> Error {
        Error::input(format!(
            "{}: {what} {how}; import the volume again or fetch a whole copy",
            self.path.display()
        ))
    }

    /// One index page, checked.
    pub(crate) fn read_page(&self, number: u64) -> Result<Vec<u8>> {
        let place = self.index_place + number * PAGE_BYTES as u64;
        let len = (self.description_place - place).min(PAGE_BYTES as u64);
        let mut bytes = vec![0; len as usize];
        let what = format_args!("index page {number}").to_string();
        self.file
            .read_exact_at(&mut bytes, place)
            .map_err(|why| self.damaged(&what, &format!("cannot be read ({why})")))?;
        if page::CHECKSUM.u64(&bytes) != checksum(&bytes[page::CHECKSUM.end()..])
            || page::NUMBER.u64(&bytes) != number
        {
            return Err(self.damaged(what, "is damaged"));
        }
        Ok(bytes)
    }

    /// The entry of that number out of its page.
    pub(crate) fn entry_of_page(&self, page: &[u8], number: u64) -> Result<Entry> {
        let start = page::BYTES + (number % PAGE_ENTRIES as u64) as usize * entry_fields::BYTES;
        let (first, end) = self.brick_places();
        let id = self.numbering.brick(number);
        let format = self.description.channels[usize::from(id.channel)].format;
        let raw_bytes = self.description.brick_bytes(id) as u64;
        Entry::from_bytes(&page[start..start + entry_fields::BYTES])
            .filter(|entry| match entry.kind {
                // Only f32 has a value that means "nothing here".
                Kind::Absent => format == crate::volume::VoxelFormat::F32,
                Kind::Constant => {
                    let used = 8 * format.bytes() as u32;
                    entry.place.checked_shr(used).unwrap_or(0) == 0
                        && entry.knowledge().range(format) == entry.range
                }
                Kind::Raw => u64::from(entry.stored_bytes) == raw_bytes,
                Kind::Lz4 => u64::from(entry.stored_bytes) < raw_bytes,
            })
            .filter(|entry| {
                let stored = u64::from(entry.stored_bytes);
                stored == 0 || (entry.place >= first && entry.place + stored <= end)
            })
            .ok_or_else(|| self.damaged(id, "has an entry that means nothing"))
    }

    pub(crate) fn index_entry(&self, id: BrickId) -> Result<Entry> {
        if !self.description.has(id) {
            let path = self.path.display();
            return Err(Error::input(format!("{path}: has no {id}")));
        }
        let number = self.numbering.entry_number(id);
        let page_number = number / PAGE_ENTRIES as u64;
        let page = self.pages.get(page_number, || self.read_page(page_number))?;
        self.entry_of_page(&page, number)
    }

    /// Reads and decodes a brick whose entry is known; `fetched` is called in between. Bricks that are not in the
    /// file have no such moment.
    pub(crate) fn read_entry(
        &self,
        id: BrickId,
        entry: Entry,
        out: &mut Vec<u8>,
        fetched: &mut dyn FnMut(),
    ) -> Result<()> {
        let wanted = self.description.brick_bytes(id);
        let format = self.description.channels[usize::from(id.channel)].format;
        let mut read = |len: usize, out: &mut Vec<u8>| {
            out.resize(len, 0);
            self.file
                .read_exact_at(out, entry.place)
                .map_err(|why| self.damaged(id, &format!("cannot be read ({why})")))?;
            fetched();
            if checksum(out) == entry.checksum {
                Ok(())
            } else {
                Err(self.damaged(id, "is damaged"))
            }
        };
        match entry.kind {
            Kind::Absent => {
                out.clear();
                let absent = Voxels::F32(vec![f32::NAN]);
                out.extend(absent.bytes().iter().cycle().take(wanted));
            }
            Kind::Constant => {
                let voxel = (entry.place as u32).to_le_bytes();
                out.clear();
                out.resize(wanted, voxel[0]);
                if format.bytes() > 1 {
                    out.chunks_exact_mut(format.bytes())
                        .for_each(|bytes| bytes.copy_from_slice(&voxel[..format.bytes()]));
                }
            }
            Kind::Raw => read(wanted, out)?,
            Kind::Lz4 => {
                let scratch = || self.scratch.lock().expect("no panic holds it");
                let mut packed = scratch().pop().unwrap_or_default();
                let result = read(entry.stored_bytes as usize, &mut packed).and_then(|()| {
                    // Every byte is written or the brick refused, so what stood here does not matter.
                    out.resize(wanted, 0);
                    match lz4_flex::block::decompress_into(&packed, out) {
                        Ok(len) if len == wanted => Ok(()),
                        _ => Err(self.damaged(id, "is damaged: its LZ4 block does not fit")),
                    }
                });
                scratch().push(packed);
                result?;
            }
        }
        Ok(())
    }
}

impl BrickSource for Store {
    fn description(&self) -> &Description {
        &self.description
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        Ok(self.index_entry(id)?.knowledge())
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.read_telling(id, bytes, &mut || {})
    }

    fn read_telling(
        &self,
        id: BrickId,
        bytes: &mut Vec<u8>,
        fetched: &mut dyn FnMut(),
    ) -> Result<()> {
        let entry = self.index_entry(id)?;
        self.read_entry(id, entry, bytes, fetched)
    }
}
