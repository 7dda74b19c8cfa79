//! Random choices of whole numbers.

use crate::random::Random;

/// See the module.
pub struct Chance(Random);

impl Chance {
    /// What a seed repeats.
    pub fn new(seed: u64) -> Chance {
        Chance(Random(seed))
    }

    /// From 0 to below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        self.0.index(count)
    }

    /// From one to another, both possible.
    pub fn between(&mut self, least: u32, most: u32) -> u32 {
        least + self.below((most - least + 1) as usize) as u32
    }

    /// One of these.
    pub fn one<T: Copy>(&mut self, of: &[T]) -> T {
        self.0.one(of)
    }

    /// Once in `count` times.
    pub fn once_in(&mut self, count: usize) -> bool {
        self.below(count) == 0
    }
}
