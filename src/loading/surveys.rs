//! Which blocks were asked for, are being surveyed, or are known.

use std::collections::{HashMap, VecDeque};

use crate::loading::Block;

/// Where a block stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Waiting,
    /// With a loader; `old` when the source has changed since.
    UnderWay {
        old: bool,
    },
    /// Delivered; `whole` unless some entry could not be had.
    Known {
        whole: bool,
    },
}

/// Blocks by state.
///
/// # Invariants
/// `queue` holds exactly the waiting ones.
#[derive(Default)]
pub struct Surveys {
    states: HashMap<Block, State>,
    queue: VecDeque<Block>,
    under_way: usize,
}

impl Surveys {
    /// Asks for a block, unless that was done in this epoch. False: `max` wait already.
    pub fn ask(&mut self, block: Block, max: usize) -> bool {
        if self.states.contains_key(&block) {
            return true;
        }
        if self.queue.len() >= max {
            return false;
        }
        self.states.insert(block, State::Waiting);
        self.queue.push_back(block);
        true
    }

    /// The block that has waited longest.
    pub fn first(&self) -> Option<Block> {
        self.queue.front().copied()
    }

    /// A loader has the first block.
    pub fn handed(&mut self) {
        if let Some(block) = self.queue.pop_front() {
            self.states.insert(block, State::UnderWay { old: false });
            self.under_way += 1;
        }
    }

    /// A survey came back. Whether it may be delivered; if not, the block waits again.
    pub fn arrived(&mut self, block: Block, whole: bool) -> bool {
        self.under_way -= 1;
        let old = self.states.get(&block) == Some(&State::UnderWay { old: true });
        if old {
            self.queue.push_front(block);
        }
        self.states.insert(block, if old { State::Waiting } else { State::Known { whole } });
        !old
    }

    /// With loaders now.
    pub fn under_way(&self) -> usize {
        self.under_way
    }

    /// Asked for and not delivered.
    pub fn outstanding(&self) -> usize {
        self.queue.len() + self.under_way
    }

    /// Blocks with an entry that could not be had may be asked for again.
    pub fn forget_failures(&mut self) {
        self.states.retain(|_, state| *state != State::Known { whole: false });
    }

    /// A channel's blocks that were delivered may be asked for again.
    pub fn forget_channel(&mut self, volume: u16, channel: u16) {
        self.states.retain(|block, state| {
            let same = block.volume == volume && block.channel == channel;
            !(same && matches!(state, State::Known { .. }))
        });
    }

    /// The volume's blocks may be asked for again; what is under way is old.
    pub fn new_epoch(&mut self, volume: u16) {
        self.states.retain(|block, state| {
            let same = block.volume == volume;
            if let State::UnderWay { old } = state {
                *old |= same;
            }
            !(same && matches!(state, State::Known { .. }))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(x: u32) -> Block {
        Block { volume: (x % 2) as u16, channel: 0, level: 0, x, y: 0, z: 0 }
    }

    #[test]
    fn a_block_is_asked_for_once_an_epoch() {
        let mut surveys = Surveys::default();
        assert!([1, 1, 2].iter().all(|&x| surveys.ask(block(x), 2)) && !surveys.ask(block(3), 2));
        surveys.handed();
        assert!(surveys.ask(block(1), 2) && surveys.first() == Some(block(2)));
        assert!(surveys.arrived(block(1), true) && surveys.ask(block(1), 2));
        assert_eq!((surveys.outstanding(), surveys.under_way()), (1, 0));
        surveys.forget_failures();
        surveys.new_epoch(0);
        assert!(surveys.ask(block(1), 2) && surveys.outstanding() == 1);
        surveys.new_epoch(1);
        assert!(surveys.ask(block(1), 2) && surveys.outstanding() == 2);
    }

    #[test]
    fn a_forgotten_channel_is_asked_for_again_and_others_are_not() {
        let of = |channel: u16| Block { channel, ..block(2) };
        let mut surveys = Surveys::default();
        for channel in 0..3 {
            surveys.ask(of(channel), 9);
        }
        (0..2).for_each(|_| surveys.handed());
        assert!(surveys.arrived(of(0), true) && surveys.arrived(of(1), true));
        surveys.forget_channel(0, 1);
        surveys.forget_channel(0, 2);
        surveys.forget_channel(1, 0);
        (0..3).for_each(|channel| assert!(surveys.ask(of(channel), 9)));
        assert_eq!((surveys.outstanding(), surveys.first()), (2, Some(of(2))), "2 waits, 1 again");
    }

    #[test]
    fn an_old_survey_is_made_again_before_others() {
        let mut surveys = Surveys::default();
        surveys.ask(block(1), 9);
        surveys.handed();
        surveys.ask(block(3), 9);
        surveys.new_epoch(1);
        assert!(!surveys.arrived(block(1), true));
        assert_eq!(surveys.first(), Some(block(1)));
        surveys.handed();
        assert!(surveys.arrived(block(1), false));
        surveys.forget_failures();
        assert!(surveys.ask(block(1), 9) && surveys.outstanding() == 2);
    }
}
