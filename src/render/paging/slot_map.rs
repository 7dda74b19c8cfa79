//! What each slot of the atlases holds, as the host has published it: for whoever looks at the atlas.

use crate::volume::BrickId;

/// Where a slot's brick comes from, and since when it is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotBrick {
    /// Channel of the source.
    pub channel: u16,
    /// Level, 0 finest.
    pub level: u8,
    /// Number of the round before which it was copied, counted since the renderer was made.
    pub since: u32,
}

/// By the slots' numbers over all atlases.
#[derive(Default)]
pub struct SlotMap {
    slots: Vec<Option<SlotBrick>>,
    round: u32,
}

impl SlotMap {
    pub fn next_round(&mut self) {
        self.round = self.round.wrapping_add(1);
    }

    /// A brick was copied into its slot.
    pub fn filled(&mut self, slot: u32, id: BrickId) {
        let slot = slot as usize;
        if self.slots.len() <= slot {
            self.slots.resize(slot + 1, None);
        }
        let BrickId { channel, level, .. } = id;
        self.slots[slot] = Some(SlotBrick { channel, level, since: self.round });
    }

    /// The device gave it up.
    pub fn freed(&mut self, slot: u32) {
        if let Some(brick) = self.slots.get_mut(slot as usize) {
            *brick = None;
        }
    }

    pub fn clear(&mut self) {
        self.slots.clear();
    }

    /// Slots up to the last that was ever filled, and the number of this round.
    pub fn now(&self) -> (Vec<Option<SlotBrick>>, u32) {
        (self.slots.clone(), self.round)
    }
}
