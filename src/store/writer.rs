//! Writes a store under a temporary name and gives it its own when it is whole.
//!
//! Invariant: whatever ends the process, the final name holds a whole store or what it held before.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, Result};
use crate::source::Description;
use crate::store::encode::Encoded;
use crate::store::entry::Kind;
use crate::store::flusher::Flusher;
use crate::store::index::Index;
use crate::store::layout::{
    DESCRIPTION_BYTES_MAX, END_MAGIC, MAGIC, VERSION, checksum, entry, header, trailer,
};
use crate::store::{Numbering, describe};
use crate::volume::BrickId;

/// Temporary names in use, for whoever must remove them before the process ends.
static PARTIAL_FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A store being written. Dropped before [`Writer::finish`], it leaves nothing behind.
pub struct Writer {
    file: File,
    partial: PathBuf,
    target: PathBuf,
    numbering: Numbering,
    index: Index,
    /// Where the next brick goes.
    place: u64,
    flusher: Flusher,
}

impl Writer {
    /// Begins a store that will appear at `target` with bricks numbered by `numbering`.
    ///
    /// # Errors
    /// When the folder cannot be written (exit code 4).
    pub fn create(target: &Path, numbering: Numbering) -> Result<Writer> {
        let partial = beside(target, "partial", None);
        let file = (|| {
            if target.is_dir() {
                return Err(io::Error::other("there is a folder of that name"));
            }
            OpenOptions::new().write(true).create(true).truncate(true).open(&partial)
        })()
        .map_err(|why| disk_error(target, &why))?;
        PARTIAL_FILES.lock().expect("no panic holds it").push(partial.clone());
        let flusher = Flusher::start(&file);
        // From here on drop removes the temporary file.
        let mut writer = Writer {
            file,
            partial,
            target: target.to_owned(),
            numbering: numbering.clone(),
            index: Index::Memory(Vec::new()),
            place: header::BYTES as u64,
            flusher,
        };
        writer.index = Index::new(numbering.count(), target).map_err(|why| writer.failed(&why))?;
        Ok(writer)
    }

    fn failed(&self, why: &io::Error) -> Error {
        disk_error(&self.target, why)
    }

    /// Writes bricks that follow each other in the index from `first` on.
    ///
    /// # Errors
    /// When the disk does not take them (exit code 4).
    pub fn append(&mut self, first: BrickId, encoded: &Encoded) -> Result<()> {
        let mut entries = Vec::with_capacity(encoded.entries.len() * entry::BYTES);
        for brick in &encoded.entries {
            let mut brick = *brick;
            if matches!(brick.kind, Kind::Raw | Kind::Lz4) {
                brick.place += self.place;
            }
            entries.extend_from_slice(&brick.to_bytes());
        }
        let number = self.numbering.entry_number(first);
        self.file
            .write_all_at(&encoded.bytes, self.place)
            .and_then(|()| self.index.set(number, &entries))
            .map_err(|why| self.failed(&why))?;
        self.place += encoded.bytes.len() as u64;
        self.flusher.written(encoded.bytes.len());
        if self.place >= 1 << (8 * entry::PLACE.bytes) {
            return Err(Error::machine(format!(
                "{}: a store holds at most 256 TiB of bricks; import a part",
                self.target.display()
            )));
        }
        Ok(())
    }

    /// Writes index, description, trailer and header, syncs, and renames. Bricks never appended are
    /// absent. Returns the length of the file in bytes.
    ///
    /// # Errors
    /// When the disk does not take them (exit code 4), or the texts are too long.
    pub fn finish(mut self, description: &Description) -> Result<u64> {
        let description = describe::to_bytes(description);
        if description.len() as u64 > DESCRIPTION_BYTES_MAX {
            return Err(Error::input("name and provenance are longer than 16 MiB; shorten them"));
        }
        self.flusher
            .end()
            .and_then(|()| self.finish_with(&description))
            .map_err(|why| self.failed(&why))
    }

    fn finish_with(&self, description: &[u8]) -> io::Result<u64> {
        let index_place = self.place;
        let mut out = BufWriter::with_capacity(1 << 20, &self.file);
        out.seek(SeekFrom::Start(index_place))?;
        let mut description_place = index_place;
        self.index.pages(|page| {
            description_place += page.len() as u64;
            out.write_all(page)
        })?;
        out.write_all(description)?;
        let file_bytes = description_place + (description.len() + trailer::BYTES) as u64;

        let mut head = [0; header::BYTES];
        header::MAGIC.set(&mut head, &MAGIC);
        header::VERSION.set(&mut head, &VERSION.to_le_bytes());
        header::HEADER_BYTES.set(&mut head, &(header::BYTES as u32).to_le_bytes());
        let numbers = [
            (header::FILE_BYTES, file_bytes),
            (header::INDEX_PLACE, index_place),
            (header::ENTRY_COUNT, self.index.count()),
            (header::DESCRIPTION_PLACE, description_place),
            (header::DESCRIPTION_BYTES, description.len() as u64),
            (header::DESCRIPTION_CHECKSUM, checksum(description)),
        ];
        for (field, number) in numbers {
            field.set(&mut head, &number.to_le_bytes());
        }
        let head_checksum = checksum(&head[..header::HEADER_CHECKSUM.offset]).to_le_bytes();
        header::HEADER_CHECKSUM.set(&mut head, &head_checksum);
        out.write_all(&head_checksum)?;
        out.write_all(&END_MAGIC)?;
        out.flush()?;
        drop(out);
        self.file.write_all_at(&head, 0)?;
        self.file.sync_all()?;
        std::fs::rename(&self.partial, &self.target)?;
        // The new name itself has to reach the disk; some file systems cannot sync a folder.
        if let Ok(folder) = File::open(folder_of(&self.target)) {
            let _ = folder.sync_all();
        }
        Ok(file_bytes)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // After a rename there is nothing of that name.
        let _ = std::fs::remove_file(&self.partial);
        PARTIAL_FILES.lock().expect("no panic holds it").retain(|path| *path != self.partial);
    }
}

/// Removes the temporary files of all writers: for a process that is told to end now.
pub fn remove_partial_files() {
    if let Ok(mut paths) = PARTIAL_FILES.lock() {
        for path in paths.drain(..) {
            let _ = std::fs::remove_file(path);
        }
    }
}

fn folder_of(target: &Path) -> &Path {
    target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// `TARGET.WORD-PID[-COUNT]`
fn beside(target: &Path, word: &str, count: Option<u64>) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(format!(".{word}-{}", std::process::id()));
    if let Some(count) = count {
        name.push(format!("-{count}"));
    }
    PathBuf::from(name)
}

/// A file without a name in the folder of `target`: gone when it is closed, however that happens.
pub(crate) fn nameless_file(target: &Path) -> io::Result<File> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let path = beside(target, "spool", Some(COUNT.fetch_add(1, Ordering::Relaxed)));
    let file = OpenOptions::new().read(true).write(true).create_new(true).open(&path)?;
    std::fs::remove_file(&path)?;
    Ok(file)
}

/// What to tell when `target` cannot be written.
pub(crate) fn disk_error(target: &Path, why: &io::Error) -> Error {
    let remedy = match why.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "free some space or choose another folder"
        }
        io::ErrorKind::NotFound => "make its folder first",
        _ => "choose a place that can be written",
    };
    Error::machine(format!("{}: cannot write the store ({why}); {remedy}", target.display()))
}
