//! Sends a growing file to the disk while it is written, so that the last sync finds little to do.

use std::fs::File;
use std::io;
use std::thread::JoinHandle;

use crossbeam_channel::{Sender, bounded};

/// Bytes between two requests to sync.
const STEP_BYTES: usize = 16 << 20;

/// A thread that syncs when asked; one that is busy is not asked again.
pub struct Flusher {
    ask: Option<Sender<()>>,
    thread: Option<JoinHandle<io::Result<()>>>,
    /// Written since the last request.
    bytes: usize,
}

impl Flusher {
    /// For `file`. Where no thread can be had, all is left to the last sync.
    pub fn start(file: &File) -> Flusher {
        let (ask, asked) = bounded::<()>(1);
        let thread = file.try_clone().and_then(|file| {
            let sync_when_asked = move || asked.iter().try_for_each(|()| file.sync_data());
            std::thread::Builder::new().name("flusher".to_owned()).spawn(sync_when_asked)
        });
        Flusher { ask: Some(ask), thread: thread.ok(), bytes: 0 }
    }

    /// Counts what was written.
    pub fn written(&mut self, bytes: usize) {
        self.bytes += bytes;
        if self.bytes >= STEP_BYTES
            && let Some(ask) = &self.ask
        {
            self.bytes = 0;
            let _ = ask.try_send(());
        }
    }

    /// Waits for what was asked for.
    ///
    /// # Errors
    /// Of any sync: the system tells of a lost write once, so the last sync need not hear of it.
    pub fn end(&mut self) -> io::Result<()> {
        self.ask = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(io::Error::other("the thread that syncs ended early")),
            None => Ok(()),
        }
    }
}
