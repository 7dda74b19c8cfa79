//! `--trace FILE`.

use std::path::Path;
use std::sync::Arc;

use crate::cli::whole_file::WholeFile;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::trace::{Trace, TraceOptions};

/// A file that will hold a trace.
pub struct TraceFile(WholeFile);

impl TraceFile {
    /// As [`WholeFile::create`].
    ///
    /// # Errors
    /// The same.
    pub fn create(path: &Path) -> Result<TraceFile> {
        WholeFile::create(path).map(TraceFile)
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
    pub fn write(self, trace: &Trace) -> Result<()> {
        self.0.write(|out| trace.write(out))
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
