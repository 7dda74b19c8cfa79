//! Reads every byte of a store and names what is damaged.

use std::path::Path;
use std::sync::Mutex;

use rayon::prelude::*;

use crate::error::Result;
use crate::source::BrickSource;
use crate::store::Store;
use crate::store::layout::PAGE_ENTRIES;
use crate::volume::{BrickId, Voxels};

/// Damages that a report lists; the rest is only counted.
const LISTED_MAX: usize = 1000;

/// One thing that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The brick, or the first of several.
    pub brick: BrickId,
    /// How many bricks are lost with it, from `brick` on in the order of the index.
    pub bricks: u64,
    /// A sentence.
    pub message: String,
}

/// What verifying found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Bricks looked at.
    pub bricks: u64,
    /// Bytes of bricks read.
    pub stored_bytes: u64,
    /// Bricks that cannot be had.
    pub damaged_bricks: u64,
    /// In the order of the index; the first thousand.
    pub damages: Vec<Damage>,
}

/// Opens and reads the store at `path` on all threads of the current rayon pool. `progress` gets the
/// bricks done and the bricks in all.
///
/// # Errors
/// When the store cannot be opened: then it is damaged as a whole.
pub fn verify(path: &Path, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<Report> {
    let store = Store::open(path)?;
    let count = store.numbering().count();
    let pages = count.div_ceil(PAGE_ENTRIES as u64);
    let report = Mutex::new(Report::default());
    (0..pages).into_par_iter().for_each(|page| {
        let here = verify_page(&store, page);
        let mut report = report.lock().expect("no panic holds it");
        report.bricks += here.bricks;
        report.stored_bytes += here.stored_bytes;
        report.damaged_bricks += here.damaged_bricks;
        report.damages.extend(here.damages);
        // Many damages are kept short now, so that memory stays bounded.
        if report.damages.len() > 2 * LISTED_MAX {
            in_order(&store, &mut report);
        }
        progress(report.bricks, count);
    });
    let mut report = report.into_inner().expect("no panic held it");
    let (first, end) = store.brick_places();
    if report.damaged_bricks == 0 && report.stored_bytes != end - first {
        report.damaged_bricks = 1;
        report.damages.push(Damage {
            brick: store.numbering().brick(0),
            bricks: 1,
            message: format!(
                "{}: its bricks have {} bytes where the file has {}; it was written wrongly",
                path.display(),
                report.stored_bytes,
                end - first
            ),
        });
    }
    in_order(&store, &mut report);
    Ok(report)
}

fn in_order(store: &Store, report: &mut Report) {
    report.damages.sort_by_key(|damage| store.numbering().entry_number(damage.brick));
    report.damages.truncate(LISTED_MAX);
}

fn verify_page(store: &Store, page_number: u64) -> Report {
    let first = page_number * PAGE_ENTRIES as u64;
    let bricks = (store.numbering().count() - first).min(PAGE_ENTRIES as u64);
    let mut report = Report { bricks, ..Report::default() };
    let mut lost = |number: u64, bricks: u64, message: String| {
        report.damaged_bricks += bricks;
        report.damages.push(Damage { brick: store.numbering().brick(number), bricks, message });
    };
    let page = match store.read_page(page_number) {
        Ok(page) => page,
        Err(why) => {
            lost(first, bricks, why.message);
            return report;
        }
    };
    let mut bytes = Vec::new();
    for number in first..first + bricks {
        let id = store.numbering().brick(number);
        let result = store.entry_of_page(&page, number).and_then(|entry| {
            store.read_entry(id, entry, &mut bytes, &mut || {})?;
            Ok(entry)
        });
        match result {
            Ok(entry) => {
                report.stored_bytes += u64::from(entry.stored_bytes);
                let format = store.description().channels[usize::from(id.channel)].format;
                if entry.stored_bytes > 0
                    && Voxels::from_bytes(format, &bytes).range() != entry.range
                {
                    report.damaged_bricks += 1;
                    let message = format!("{id} has not the range that its entry says");
                    report.damages.push(Damage { brick: id, bricks: 1, message });
                }
            }
            Err(why) => {
                report.damaged_bricks += 1;
                report.damages.push(Damage { brick: id, bricks: 1, message: why.message });
            }
        }
    }
    report
}
