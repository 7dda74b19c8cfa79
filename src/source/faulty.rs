//! Sources that misbehave on purpose, around one that does not: how loaders meet bad days in tests.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex};
use std::time::Duration;

use crate::error::{Error, Result};
use crate::source::{BrickEntry, BrickSource, Description};
use crate::volume::BrickId;

/// What goes wrong with a read.
pub trait Fault: Send + Sync {
    /// Called before the `read`-th read (from 0); an error is what the read gives.
    ///
    /// # Errors
    /// The fault's own.
    fn before(&self, read: u64, id: BrickId) -> Result<()>;
    /// May spoil what was read.
    fn after(&self, _read: u64, _bytes: &mut Vec<u8>) {}
}

/// A source whose reads pass through a [`Fault`]. Entries are left alone.
pub struct Faulty<S, F> {
    source: S,
    /// Shared with the test, which may change it while loaders read.
    pub fault: F,
    reads: AtomicU64,
}

impl<S: BrickSource, F: Fault> Faulty<S, F> {
    /// Wraps `source`.
    pub fn new(source: S, fault: F) -> Faulty<S, F> {
        Faulty { source, fault, reads: AtomicU64::new(0) }
    }

    /// How many reads were begun.
    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::SeqCst)
    }
}

impl<S: BrickSource, F: Fault> BrickSource for Faulty<S, F> {
    fn description(&self) -> &Description {
        self.source.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.source.entry(id)
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
        let read = self.reads.fetch_add(1, Ordering::SeqCst);
        self.fault.before(read, id)?;
        self.source.read_telling(id, bytes, fetched)?;
        self.fault.after(read, bytes);
        Ok(())
    }
}

/// Every read takes at least this long.
pub struct Slow(pub Duration);

impl Fault for Slow {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        std::thread::sleep(self.0);
        Ok(())
    }
}

/// Every nth read fails, counted from 1: `Failing(1)` fails always, `Failing(0)` never.
pub struct Failing(pub u64);

impl Fault for Failing {
    fn before(&self, read: u64, id: BrickId) -> Result<()> {
        if self.0 != 0 && (read + 1).is_multiple_of(self.0) {
            return Err(Error::input(format!("{id} cannot be read: a test made it fail")));
        }
        Ok(())
    }
}

/// Every read comes back this many bytes short.
pub struct Short(pub usize);

impl Fault for Short {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        Ok(())
    }

    fn after(&self, _: u64, bytes: &mut Vec<u8>) {
        bytes.truncate(bytes.len().saturating_sub(self.0));
    }
}

/// Every read comes back with all bits of one byte turned over, another byte each time.
pub struct Corrupt;

impl Fault for Corrupt {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        Ok(())
    }

    fn after(&self, read: u64, bytes: &mut Vec<u8>) {
        // A prime step visits every byte before it repeats one.
        let place = read.wrapping_mul(7919) % bytes.len().max(1) as u64;
        if let Some(byte) = bytes.get_mut(place as usize) {
            *byte = !*byte;
        }
    }
}

/// Reads wait until [`Stalling::go_on`] is called.
#[derive(Default)]
pub struct Stalling {
    released: Mutex<bool>,
    changed: Condvar,
}

impl Stalling {
    /// Lets all reads, waiting and coming, pass.
    pub fn go_on(&self) {
        *self.released.lock().expect("no test panics with the lock") = true;
        self.changed.notify_all();
    }
}

impl Fault for Stalling {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        let released = self.released.lock().expect("no test panics with the lock");
        drop(self.changed.wait_while(released, |released| !*released));
        Ok(())
    }
}
