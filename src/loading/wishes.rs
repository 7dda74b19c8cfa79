//! The wish list: what is wished, in which order, and what each wish waits for.

use std::collections::{BTreeSet, HashMap};
use std::time::Instant;

use crate::loading::Wish;
use crate::volume::BrickId;

/// What a wish waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// To be taken: the brick was in the cache when it was wished.
    Cached,
    /// A loader.
    Unread,
    /// The end of a pause.
    Pausing(Instant),
    /// A read under way.
    Reading,
}

#[derive(Clone, Copy)]
struct Listed {
    rank: u64,
    /// Reads that failed so far.
    failures: u32,
    place: Place,
}

/// Wishes left out when a list was replaced.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Of the old list: waiting, and not in the new one.
    pub stale: u64,
    /// Of the new list: beyond the bound.
    pub overflow: u64,
    /// Of the new list: refused by the caller.
    pub refused: u64,
}

/// Wishes by brick, and by what they wait for.
///
/// # Invariants
/// Each of the sets holds exactly those listed whose place says so.
#[derive(Default)]
pub struct WishList {
    listed: HashMap<BrickId, Listed>,
    cached: BTreeSet<(u64, BrickId)>,
    unread: BTreeSet<(u64, BrickId)>,
    pausing: BTreeSet<(Instant, BrickId)>,
}

impl WishList {
    /// Takes a new list of at most `max` bricks, best ranks first. Those listed before keep their
    /// place; `place` says where the others stand, and refuses a brick by nothing.
    pub fn replace(
        &mut self,
        wishes: &[Wish],
        max: usize,
        place: impl Fn(BrickId) -> Option<Place>,
    ) -> LeftOut {
        let mut left_out = LeftOut::default();
        let mut ranks: HashMap<BrickId, u64> = HashMap::with_capacity(wishes.len());
        for wish in wishes {
            let rank = ranks.entry(wish.id).or_insert(wish.rank);
            *rank = wish.rank.min(*rank);
        }
        let mut old = std::mem::take(self);
        let mut wanted: Vec<(u64, BrickId, Listed)> = Vec::with_capacity(ranks.len());
        for (id, rank) in ranks {
            let before = old.listed.get(&id).copied();
            let new = || Some(Listed { rank, failures: 0, place: place(id)? });
            match before.or_else(new) {
                Some(listed) => wanted.push((rank, id, Listed { rank, ..listed })),
                None => left_out.refused += 1,
            }
        }
        wanted.sort_unstable_by_key(|&(rank, id, _)| (rank, id));
        left_out.overflow = wanted.len().saturating_sub(max) as u64;
        wanted.truncate(max);
        for (_, id, listed) in wanted {
            old.listed.remove(&id);
            self.put(id, listed);
        }
        let waits = |listed: &&Listed| listed.place != Place::Reading;
        left_out.stale = old.listed.values().filter(waits).count() as u64;
        left_out
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.listed.len()
    }

    /// Whether a brick is listed.
    pub fn has(&self, id: BrickId) -> bool {
        self.listed.contains_key(&id)
    }

    /// The best of those in the cache.
    pub fn first_cached(&self) -> Option<BrickId> {
        self.cached.first().map(|&(_, id)| id)
    }

    /// The best of those that want a loader, and its failures so far.
    pub fn first_unread(&self) -> Option<(BrickId, u32)> {
        let &(_, id) = self.unread.first()?;
        Some((id, self.listed.get(&id)?.failures))
    }

    /// When the first pause ends.
    pub fn first_due(&self) -> Option<Instant> {
        self.pausing.first().map(|&(until, _)| until)
    }

    /// Ends the pauses that are over.
    pub fn wake(&mut self, now: Instant) {
        while let Some(&(until, id)) = self.pausing.first()
            && until <= now
        {
            self.set(id, Place::Unread);
        }
    }

    /// Moves a listed brick to another place; of one not listed, nothing is known.
    pub fn set(&mut self, id: BrickId, place: Place) {
        if let Some(listed) = self.take(id) {
            self.put(id, Listed { place, ..listed });
        }
    }

    /// A read failed: the brick waits until then. Whether it is listed at all.
    pub fn pause(&mut self, id: BrickId, failures: u32, until: Instant) -> bool {
        let listed = self.take(id);
        if let Some(listed) = listed {
            self.put(id, Listed { failures, place: Place::Pausing(until), ..listed });
        }
        listed.is_some()
    }

    /// The wish has come to its end.
    pub fn remove(&mut self, id: BrickId) {
        self.take(id);
    }

    /// Forgets all failures of a volume's bricks, and their pauses.
    pub fn start_over(&mut self, volume: u16) {
        let of_volume = |id: &&BrickId| id.volume == volume;
        let ids: Vec<BrickId> = self.listed.keys().filter(of_volume).copied().collect();
        for id in ids {
            let Some(listed) = self.take(id) else { continue };
            let place = match listed.place {
                Place::Reading => Place::Reading,
                // What the cache had of it is gone as well.
                Place::Cached | Place::Unread | Place::Pausing(_) => Place::Unread,
            };
            self.put(id, Listed { failures: 0, place, ..listed });
        }
    }

    fn put(&mut self, id: BrickId, listed: Listed) {
        match listed.place {
            Place::Cached => _ = self.cached.insert((listed.rank, id)),
            Place::Unread => _ = self.unread.insert((listed.rank, id)),
            Place::Pausing(until) => _ = self.pausing.insert((until, id)),
            Place::Reading => {}
        }
        self.listed.insert(id, listed);
    }

    fn take(&mut self, id: BrickId) -> Option<Listed> {
        let listed = self.listed.remove(&id)?;
        match listed.place {
            Place::Cached => _ = self.cached.remove(&(listed.rank, id)),
            Place::Unread => _ = self.unread.remove(&(listed.rank, id)),
            Place::Pausing(until) => _ = self.pausing.remove(&(until, id)),
            Place::Reading => {}
        }
        Some(listed)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn id(x: u32) -> BrickId {
        BrickId { volume: (x % 2) as u16, channel: 0, level: 0, x, y: 0, z: 0 }
    }

    fn wishes(of: &[(u32, u64)]) -> Vec<Wish> {
        of.iter().map(|&(x, rank)| Wish { id: id(x), rank }).collect()
    }

    fn unread(list: &WishList) -> Vec<u32> {
        list.unread.iter().map(|&(_, id)| id.x).collect()
    }

    fn all_unread(_: BrickId) -> Option<Place> {
        Some(Place::Unread)
    }

    #[test]
    fn duplicates_are_joined_and_the_best_rank_wins() {
        let mut list = WishList::default();
        let left_out = list.replace(&wishes(&[(1, 9), (2, 5), (1, 3), (1, 7)]), 10, all_unread);
        assert_eq!((unread(&list), list.len(), left_out), (vec![1, 2], 2, LeftOut::default()));
    }

    #[test]
    fn what_is_left_out_is_counted() {
        let mut list = WishList::default();
        let place = |id: BrickId| (id.x != 4).then_some(Place::Unread);
        let of = wishes(&[(1, 1), (2, 2), (3, 3), (4, 0), (5, 5)]);
        let left_out = list.replace(&of, 3, place);
        assert_eq!(left_out, LeftOut { stale: 0, overflow: 1, refused: 1 });
        assert_eq!(unread(&list), [1, 2, 3]);
        // One that a loader reads is not stale.
        list.set(id(1), Place::Reading);
        let left_out = list.replace(&wishes(&[(3, 9), (6, 8)]), 3, place);
        assert_eq!(left_out, LeftOut { stale: 1, overflow: 0, refused: 0 });
        assert_eq!(unread(&list), [6, 3]);
    }

    #[test]
    fn a_pause_survives_a_new_list_and_ends_in_rank_order() {
        let mut list = WishList::default();
        list.replace(&wishes(&[(1, 1), (2, 2)]), 3, all_unread);
        let start = Instant::now();
        let until = start + Duration::from_secs(5);
        assert!(list.pause(id(1), 2, until) && !list.pause(id(7), 1, until));
        list.replace(&wishes(&[(1, 4), (3, 3), (5, 5)]), 3, all_unread);
        assert_eq!((unread(&list), list.first_due()), (vec![3, 5], Some(until)));
        list.wake(start);
        assert_eq!(unread(&list), [3, 5]);
        list.wake(until);
        assert_eq!((unread(&list), list.first_due()), (vec![3, 1, 5], None));
        list.remove(id(3));
        assert_eq!(list.first_unread(), Some((id(1), 2)));
        list.start_over(1);
        assert_eq!(list.first_unread(), Some((id(1), 0)));
    }
}
