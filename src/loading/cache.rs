//! The RAM cache: bricks of all volumes, least recently used out first, bounded in bytes.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::volume::BrickId;

/// Voxels by brick.
///
/// # Invariants
/// `bytes` is the sum over `bricks` and never above `bytes_max`; each brick stands in `order` once.
pub struct Cache {
    bricks: HashMap<BrickId, Cached>,
    /// By last use, oldest first.
    order: BTreeMap<u64, BrickId>,
    /// Number of the last use.
    uses: u64,
    bytes: u64,
    bytes_max: u64,
    /// The most that `bytes` was.
    peak_bytes: u64,
}

struct Cached {
    bytes: Arc<[u8]>,
    last_use: u64,
}

impl Cache {
    /// An empty one.
    pub fn new(bytes_max: u64) -> Cache {
        Cache {
            bricks: HashMap::new(),
            order: BTreeMap::new(),
            uses: 0,
            bytes: 0,
            bytes_max,
            peak_bytes: 0,
        }
    }

    /// Whether the brick is here; not a use.
    pub fn has(&self, id: BrickId) -> bool {
        self.bricks.contains_key(&id)
    }

    /// The brick's voxels, now the most recently used.
    pub fn get(&mut self, id: BrickId) -> Option<Arc<[u8]>> {
        let cached = self.bricks.get_mut(&id)?;
        self.order.remove(&cached.last_use);
        self.uses += 1;
        cached.last_use = self.uses;
        self.order.insert(self.uses, id);
        Some(Arc::clone(&cached.bytes))
    }

    /// Keeps a brick, in place of the least recently used ones; one too large for the cache is not
    /// kept and drives nothing out.
    pub fn insert(&mut self, id: BrickId, bytes: Arc<[u8]>) {
        self.remove(id);
        let len = bytes.len() as u64;
        if len > self.bytes_max {
            return;
        }
        while self.bytes > self.bytes_max - len
            && let Some((_, oldest)) = self.order.first_key_value()
        {
            self.remove(*oldest);
        }
        self.uses += 1;
        self.order.insert(self.uses, id);
        self.bricks.insert(id, Cached { bytes, last_use: self.uses });
        self.bytes += len;
        self.peak_bytes = self.peak_bytes.max(self.bytes);
    }

    /// Drops all bricks of a volume.
    pub fn forget(&mut self, volume: u16) {
        let of_volume = |id: &&BrickId| id.volume == volume;
        let ids: Vec<BrickId> = self.bricks.keys().filter(of_volume).copied().collect();
        for id in ids {
            self.remove(id);
        }
    }

    /// Voxel bytes held now.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The most voxel bytes ever held.
    pub fn peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    fn remove(&mut self, id: BrickId) {
        if let Some(cached) = self.bricks.remove(&id) {
            self.order.remove(&cached.last_use);
            self.bytes -= cached.bytes.len() as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(x: u32) -> BrickId {
        BrickId { volume: (x % 2) as u16, channel: 0, level: 0, x, y: 0, z: 0 }
    }

    fn brick(len: usize) -> Arc<[u8]> {
        vec![len as u8; len].into()
    }

    fn held(cache: &Cache) -> Vec<u32> {
        (0..10).filter(|&x| cache.has(id(x))).collect()
    }

    #[test]
    fn the_least_recently_used_goes_first_whatever_its_volume() {
        let mut cache = Cache::new(30);
        for x in 0..3 {
            cache.insert(id(x), brick(10));
        }
        assert!(cache.get(id(0)).is_some() && cache.get(id(7)).is_none());
        cache.insert(id(3), brick(10));
        assert_eq!(held(&cache), [0, 2, 3]);
        // Half as many bytes of free room drive out as many bricks as it takes.
        cache.insert(id(4), brick(15));
        assert_eq!(held(&cache), [3, 4]);
        assert_eq!((cache.bytes(), cache.peak_bytes()), (25, 30));
    }

    #[test]
    fn a_brick_too_large_is_not_kept_and_drives_nothing_out() {
        let mut cache = Cache::new(30);
        cache.insert(id(0), brick(30));
        cache.insert(id(1), brick(31));
        assert_eq!(held(&cache), [0]);
        // A larger one of the same name takes the older one's place away.
        cache.insert(id(0), brick(31));
        assert_eq!((held(&cache).len(), cache.bytes()), (0, 0));
        let mut none = Cache::new(0);
        none.insert(id(0), brick(1));
        assert_eq!((held(&none).len(), none.peak_bytes()), (0, 0));
    }

    #[test]
    fn evicted_bricks_are_freed() {
        let mut cache = Cache::new(10);
        let first = brick(10);
        let weak = Arc::downgrade(&first);
        cache.insert(id(0), first);
        assert!(weak.upgrade().is_some());
        cache.insert(id(1), brick(10));
        assert!(weak.upgrade().is_none());
    }

    #[test]
    fn a_volume_is_forgotten_alone() {
        let mut cache = Cache::new(100);
        for x in 0..6 {
            cache.insert(id(x), brick(10));
        }
        cache.forget(1);
        assert_eq!((held(&cache), cache.bytes()), (vec![0, 2, 4], 30));
        assert_eq!(cache.order.len(), cache.bricks.len());
    }
}
