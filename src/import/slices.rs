//! The last few slices of a growing stack, in memory or in a nameless file; or all of a finished one
//! that others hold too.

use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use crate::store::nameless_file;

/// Memory that may still be taken.
pub struct Budget {
    left_bytes: u64,
}

impl Budget {
    /// So many bytes.
    pub fn new(bytes: u64) -> Budget {
        Budget { left_bytes: bytes }
    }

    fn take(&mut self, bytes: u64) -> bool {
        let fits = bytes <= self.left_bytes;
        if fits {
            self.left_bytes -= bytes;
        }
        fits
    }
}

/// `kept` slices of `rows` rows of `width` items. Slice z lies where slice z - kept lay.
pub struct Slices<T> {
    width: usize,
    rows: usize,
    kept: u32,
    place: Place<T>,
}

enum Place<T> {
    Memory(Vec<Vec<T>>),
    Disk(File),
    /// Every slice, never written.
    Shared(Arc<dyn AsRef<[T]> + Send + Sync>),
}

impl<T: bytemuck::Pod> Slices<T> {
    /// In memory where `budget` has it, else in a file in the folder of `beside`.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn new(
        [width, rows]: [usize; 2],
        kept: u32,
        budget: &mut Budget,
        beside: &Path,
    ) -> io::Result<Slices<T>> {
        let bytes = (width as u64)
            .checked_mul(rows as u64)
            .and_then(|items| items.checked_mul(u64::from(kept)))
            .and_then(|items| items.checked_mul(size_of::<T>() as u64));
        let place = if bytes.is_some_and(|bytes| budget.take(bytes)) {
            Place::Memory(vec![Vec::new(); kept as usize])
        } else {
            Place::Disk(nameless_file(beside)?)
        };
        Ok(Slices { width, rows, kept, place })
    }

    /// A finished stack of `kept` slices that is not copied.
    pub fn shared(
        [width, rows]: [usize; 2],
        kept: u32,
        items: Arc<dyn AsRef<[T]> + Send + Sync>,
    ) -> Slices<T> {
        Slices { width, rows, kept, place: Place::Shared(items) }
    }

    /// Gives the memory back to `budget`.
    pub fn release(self, budget: &mut Budget) {
        if matches!(self.place, Place::Memory(_)) {
            let items = self.width as u64 * self.rows as u64 * u64::from(self.kept);
            budget.left_bytes += items * size_of::<T>() as u64;
        }
    }

    /// How many slices are kept.
    pub fn kept(&self) -> u32 {
        self.kept
    }

    /// Slice z whole, if it is in memory.
    pub fn slice(&self, z: u32) -> Option<&[T]> {
        match &self.place {
            Place::Memory(slices) => Some(&slices[(z % self.kept) as usize]),
            Place::Disk(_) => None,
            Place::Shared(items) => {
                let len = self.width * self.rows;
                let start = (z % self.kept) as usize * len;
                Some(&(**items).as_ref()[start..start + len])
            }
        }
    }

    fn disk_place(&self, z: u32, y: usize, x: usize) -> u64 {
        let row = u64::from(z % self.kept) * self.rows as u64 + y as u64;
        (row * self.width as u64 + x as u64) * size_of::<T>() as u64
    }

    /// Rows `y` of slice z.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn rows(&self, z: u32, y: Range<usize>) -> io::Result<Cow<'_, [T]>> {
        if let Some(slice) = self.slice(z) {
            return Ok(Cow::Borrowed(&slice[y.start * self.width..y.end * self.width]));
        }
        self.copy_box(z, y, 0..self.width).map(Cow::Owned)
    }

    /// Items `x` of rows `y` of slice z.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn copy_box(&self, z: u32, y: Range<usize>, x: Range<usize>) -> io::Result<Vec<T>> {
        let mut items = vec![T::zeroed(); y.len() * x.len()];
        // Whole rows lie together and are read as one.
        let (runs, len) = if x.len() == self.width { (1, items.len()) } else { (y.len(), x.len()) };
        for (run, out) in (0..runs).zip(items.chunks_exact_mut(len.max(1))) {
            if let Place::Disk(file) = &self.place {
                let place = self.disk_place(z, y.start + run, x.start);
                file.read_exact_at(bytemuck::cast_slice_mut(out), place)?;
            } else if let Some(slice) = self.slice(z) {
                let start = (y.start + run) * self.width + x.start;
                out.copy_from_slice(&slice[start..start + len]);
            }
        }
        Ok(items)
    }

    /// Writes rows of `width` items to slice z, from row `y` and item `x` on.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(
        &mut self,
        z: u32,
        y: usize,
        x: usize,
        width: usize,
        items: &[T],
    ) -> io::Result<()> {
        let (full, slice_len) = (width == self.width, self.width * self.rows);
        let step = if full { items.len() } else { width };
        for (run, row) in items.chunks_exact(step.max(1)).enumerate() {
            let place = self.disk_place(z, y + run, x);
            match &mut self.place {
                Place::Memory(slices) => {
                    let slice = &mut slices[(z % self.kept) as usize];
                    if slice.is_empty() {
                        *slice = vec![T::zeroed(); slice_len];
                    }
                    let start = (y + run) * self.width + x;
                    slice[start..start + row.len()].copy_from_slice(row);
                }
                Place::Disk(file) => file.write_all_at(bytemuck::cast_slice(row), place)?,
                Place::Shared(_) => unreachable!("a shared stack is finished"),
            }
        }
        Ok(())
    }

    /// Sets all of slice z to one item.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn fill(&mut self, z: u32, item: T) -> io::Result<()> {
        let rows = ((1 << 20) / (self.width * size_of::<T>())).clamp(1, self.rows);
        let block = vec![item; rows * self.width];
        for y in (0..self.rows).step_by(rows) {
            let rows = rows.min(self.rows - y);
            self.write(z, y, 0, self.width, &block[..rows * self.width])?;
        }
        Ok(())
    }
}
