//! `--trace FILE`: made before anything is drawn, so that a name that cannot be written is met first.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::cli::picture_file::{folder_is_there, partial_name};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::trace::{Trace, TraceOptions};

/// A file that will hold a trace. Dropped before it is written, it leaves nothing behind.
pub struct TraceFile {
    path: PathBuf,
    /// Under this name until it is whole; nothing where the path is a device or a pipe.
    partial: Option<PathBuf>,
    file: File,
}

impl TraceFile {
    /// Makes the file under a temporary name.
    ///
    /// # Errors
    /// Exit code 4 when it cannot be written there.
    pub fn create(path: &Path) -> Result<TraceFile> {
        folder_is_there(path)?;
        let failed = |why: io::Error| cannot(path, &why);
        if path.is_dir() {
            return Err(failed(io::Error::other("it is a folder")));
        }
        if path.exists() && !path.is_file() {
            let file = File::options().write(true).open(path).map_err(failed)?;
            return Ok(TraceFile { path: path.to_owned(), partial: None, file });
        }
        let partial = partial_name(path);
        let file = File::create(&partial).map_err(failed)?;
        Ok(TraceFile { path: path.to_owned(), partial: Some(partial), file })
    }

    /// A trace for it, of what will be drawn on this device.
    pub fn begin(&self, gpu: &Arc<Gpu>, scene: &Path) -> Arc<Trace> {
        let scene = scene.display().to_string();
        Trace::new(gpu, TraceOptions { scene, ..TraceOptions::default() })
    }

    /// Writes the trace, and gives the file its name.
    ///
    /// # Errors
    /// Exit code 4 when it cannot be written.
    pub fn write(mut self, trace: &Trace) -> Result<()> {
        let write = || {
            let mut out = BufWriter::new(&self.file);
            trace.write(&mut out)?;
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

/// Writes what happened so far.
///
/// # Errors
/// As [`TraceFile::create`] and [`TraceFile::write`].
#[cfg(feature = "viewer")]
pub fn write_trace(path: &Path, trace: &Trace) -> Result<()> {
    TraceFile::create(path)?.write(trace)
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        if let Some(partial) = &self.partial {
            let _ = std::fs::remove_file(partial);
        }
    }
}

fn cannot(path: &Path, why: &io::Error) -> Error {
    Error::machine(format!("{}: cannot be written: {why}; check folder and disk", path.display()))
}
