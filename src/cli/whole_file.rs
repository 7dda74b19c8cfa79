//! A file that is there whole or not at all, made before the work that fills it, so that a name that cannot be
//! written is met first.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::cli::picture_file::{folder_is_there, partial_name};
use crate::error::{Error, Result};

/// See the module. Dropped before it is written, it leaves nothing behind.
pub struct WholeFile {
    path: PathBuf,
    /// Under this name until it is whole; nothing where the path is a device or a pipe.
    partial: Option<PathBuf>,
    file: File,
}

impl WholeFile {
    /// Makes the file under a temporary name.
    ///
    /// # Errors
    /// Exit code 4 when it cannot be written there.
    pub fn create(path: &Path) -> Result<WholeFile> {
        folder_is_there(path)?;
        let failed = |why: io::Error| cannot(path, &why);
        if path.is_dir() {
            return Err(failed(io::Error::other("it is a folder")));
        }
        if path.exists() && !path.is_file() {
            let file = File::options().write(true).open(path).map_err(failed)?;
            return Ok(WholeFile { path: path.to_owned(), partial: None, file });
        }
        let partial = partial_name(path);
        let file = File::create(&partial).map_err(failed)?;
        Ok(WholeFile { path: path.to_owned(), partial: Some(partial), file })
    }

    /// Writes what `fill` writes, and gives the file its name.
    ///
    /// # Errors
    /// Exit code 4 when it cannot be written.
    pub fn write(mut self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let write = || {
            let mut out = BufWriter::new(&self.file);
            fill(&mut out)?;
            out.into_inner()?;
            if let Some(partial) = &self.partial {
                self.file.sync_all()?;
                std::fs::rename(partial, &self.path)?;
            }
            Ok(())
        };
        write().map_err(|why: io::Error| cannot(&self.path, &why))?;
        self.partial = None;
        Ok(())
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some(partial) = &self.partial {
            let _ = std::fs::remove_file(partial);
        }
    }
}

fn cannot(path: &Path, why: &io::Error) -> Error {
    Error::machine(format!("{}: cannot be written: {why}; check folder and disk", path.display()))
}
