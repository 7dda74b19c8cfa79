//! Index pages in memory: a bounded cache, so that an index of any length opens at once.

use std::sync::{Arc, Mutex};

use crate::error::Result;

/// Pages kept at most: 4 MiB.
const SLOTS: usize = 1024;

type Slot = Mutex<Option<(u64, Arc<[u8]>)>>;

/// A page's number leads to one slot; whoever comes last stays. Neighbours in a row, a column and a
/// plane of bricks are few pages, and a miss costs one read of 4 KiB: finer order is not worth a lock.
pub struct PageCache {
    slots: Box<[Slot]>,
}

impl PageCache {
    /// Empty.
    pub fn new() -> PageCache {
        PageCache { slots: (0..SLOTS).map(|_| Mutex::new(None)).collect() }
    }

    /// The page, from memory or else by `read`.
    ///
    /// # Errors
    /// Those of `read`; nothing is kept then.
    pub fn get(&self, number: u64, read: impl FnOnce() -> Result<Vec<u8>>) -> Result<Arc<[u8]>> {
        // Multiplying spreads the even distances between planes of bricks over all slots.
        let slot = (number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 54) as usize % SLOTS;
        let slot = &self.slots[slot];
        if let Some((_, page)) =
            slot.lock().expect("no panic holds it").as_ref().filter(|(kept, _)| *kept == number)
        {
            return Ok(Arc::clone(page));
        }
        let page: Arc<[u8]> = read()?.into();
        *slot.lock().expect("no panic holds it") = Some((number, Arc::clone(&page)));
        Ok(page)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(number: u64) -> Result<Vec<u8>> {
        Ok(number.to_le_bytes().to_vec())
    }

    #[test]
    fn pages_that_share_a_slot_are_not_taken_for_each_other() {
        let cache = PageCache::new();
        for number in (0..5 * SLOTS as u64).chain(0..5 * SLOTS as u64) {
            assert_eq!(cache.get(number, || page(number)).unwrap()[..], number.to_le_bytes());
        }
    }

    #[test]
    fn a_page_is_read_once_while_it_stays_and_failures_are_not_kept() {
        let cache = PageCache::new();
        let failure = || Err(crate::error::Error::input("a test made it fail"));
        assert!(cache.get(7, failure).is_err());
        cache.get(7, || page(7)).unwrap();
        assert_eq!(cache.get(7, failure).unwrap()[..], 7u64.to_le_bytes());
    }
}
