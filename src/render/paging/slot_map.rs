//! What each slot of the atlases holds, as the host has published it: for whoever looks at the atlas or traces it.

use crate::volume::BrickId;

/// A slot's brick, and since when it is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotBrick {
    /// Channel as the source counts.
    pub brick: BrickId,
    /// Number of the round before which it was copied, counted since the renderer was made.
    pub since: u32,
    /// A ray went through it, as far as that is told.
    pub sampled: bool,
}

/// By the slots' numbers over all atlases.
#[derive(Default)]
pub struct SlotMap {
    slots: Vec<Option<SlotBrick>>,
    round: u32,
    /// Bricks that went and that nobody was told of yet.
    evicted: Vec<BrickId>,
}

impl SlotMap {
    pub fn next_round(&mut self) {
        self.round = self.round.wrapping_add(1);
    }

    /// A brick was copied into its slot.
    pub fn filled(&mut self, slot: u32, brick: BrickId) {
        let slot = slot as usize;
        if self.slots.len() <= slot {
            self.slots.resize(slot + 1, None);
        }
        self.slots[slot] = Some(SlotBrick { brick, since: self.round, sampled: false });
    }

    /// What a slot holds.
    pub fn brick_in(&self, slot: u32) -> Option<BrickId> {
        Some(self.slots.get(slot as usize)?.as_ref()?.brick)
    }

    /// The device gave it up.
    pub fn freed(&mut self, slot: u32) {
        let held = self.slots.get_mut(slot as usize).and_then(Option::take);
        self.evicted.extend(held.map(|held| held.brick));
    }

    /// The device forgets all bricks of a channel of the source.
    pub fn forget_channel(&mut self, channel: u16) {
        for slot in &mut self.slots {
            let forgotten = slot.take_if(|held| held.brick.channel == channel);
            self.evicted.extend(forgotten.map(|held| held.brick));
        }
    }

    /// The device forgets all.
    pub fn clear(&mut self) {
        self.evicted.extend(self.slots.drain(..).flatten().map(|held| held.brick));
    }

    /// Bricks that went since the last time.
    pub fn take_evicted(&mut self) -> Vec<BrickId> {
        std::mem::take(&mut self.evicted)
    }

    /// Bricks that rays have used in this round of the cache, and not before. `used`: by slot, the round in which
    /// a ray last used it.
    pub fn newly_sampled(&mut self, used: &[u32], round: u32) -> Vec<BrickId> {
        let mut sampled = Vec::new();
        for (held, _) in self.slots.iter_mut().zip(used).filter(|(_, used)| **used == round) {
            if let Some(held) = held.as_mut().filter(|held| !held.sampled) {
                held.sampled = true;
                sampled.push(held.brick);
            }
        }
        sampled
    }

    /// Slots that hold a brick.
    pub fn used(&self) -> usize {
        self.slots.iter().flatten().count()
    }

    /// Slots up to the last that was ever filled, and the number of this round.
    pub fn now(&self) -> (Vec<Option<SlotBrick>>, u32) {
        (self.slots.clone(), self.round)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_come_are_sampled_once_and_go() {
        let id = |x| BrickId { volume: 0, channel: 0, level: 0, x, y: 0, z: 0 };
        let mut map = SlotMap::default();
        map.next_round();
        map.filled(2, id(7));
        map.filled(0, id(8));
        assert_eq!(map.newly_sampled(&[4, 4, 5], 5), [id(7)]);
        assert_eq!(map.newly_sampled(&[6, 6, 6], 6), [id(8)]);
        map.freed(2);
        map.freed(1);
        map.freed(9);
        assert_eq!(map.take_evicted(), [id(7)]);
        assert!(map.take_evicted().is_empty());
        map.filled(2, id(9));
        assert_eq!(map.newly_sampled(&[7, 7, 7], 7), [id(9)], "another brick is sampled anew");
        let other = BrickId { channel: 1, ..id(9) };
        map.filled(4, other);
        map.forget_channel(0);
        assert_eq!((map.used(), map.take_evicted()), (1, vec![id(8), id(9)]));
        map.clear();
        assert_eq!((map.used(), map.take_evicted()), (0, vec![other]));
    }
}
