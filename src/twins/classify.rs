//! From samples to a block, and from blocks to a ray; twin of `shaders/common/classify.glsl`.

use crate::twins::bits::samples_taken_of;
use crate::twins::exponential::{attenuate, attenuate_bounded};
use crate::twins::limits::OPAQUE_DEPTH;
use crate::twins::ray::RayState;

/// A block of samples, composited front to back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Linear, premultiplied, as if nothing stood before the block.
    pub color: [f32; 3],
    /// Optical.
    pub depth: f32,
    /// Through the block.
    pub transmitted: f32,
}

impl Block {
    /// Of no samples.
    pub const EMPTY: Block = Block { color: [0.0; 3], depth: 0.0, transmitted: 1.0 };

    /// Adds one sample of a medium that goes on for `step_world`.
    pub fn composite(&mut self, (color, extinction): ([f32; 3], f32), step_world: f32) {
        let depth = (extinction * step_world).min(OPAQUE_DEPTH);
        let attenuation = attenuate_bounded(depth);
        let weight = self.transmitted * attenuation.absorbed;
        for (sum, part) in self.color.iter_mut().zip(color) {
            *sum += weight * part;
        }
        self.transmitted -= weight;
        self.depth += depth;
    }
}

/// What channels give at one place: rgb and extinction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Medium {
    emission: [f32; 3],
    extinction: f32,
    mixes: bool,
}

impl Medium {
    /// Nothing yet, of one channel or of `several`.
    pub fn new(several: bool) -> Medium {
        Medium { mixes: several, ..Medium::default() }
    }

    /// Adds what one channel gives.
    pub fn mix_in(&mut self, [r, g, b, extinction]: [f32; 4]) {
        if !self.mixes {
            *self = Medium { emission: [r, g, b], extinction, mixes: false };
            return;
        }
        for (sum, color) in self.emission.iter_mut().zip([r, g, b]) {
            *sum += extinction * color;
        }
        self.extinction += extinction;
    }

    /// Adds what one channel gives that takes one of `every` samples: nothing, or as much as all of them.
    /// `number`: of the sample, in its block of `samples`.
    pub fn mix_in_every(
        &mut self,
        classified: impl FnOnce() -> [f32; 4],
        (number, samples): (u32, u32),
        every: u32,
    ) {
        if samples_taken_of(every, samples) >> number & 1 == 1 {
            let [r, g, b, extinction] = classified();
            let steps = if number < samples & !(every - 1) { every as f32 } else { 1.0 };
            self.mix_in([r, g, b, steps * extinction]);
        }
    }

    /// rgb and extinction of all channels together.
    pub fn mixed(self) -> ([f32; 3], f32) {
        if !self.mixes {
            return (self.emission, self.extinction);
        }
        (self.emission.map(|sum| sum / self.extinction.max(1.0e-37)), self.extinction)
    }
}

/// Puts a block behind all blocks before it. A block of nothing changes no bit.
pub fn join_block(state: &mut RayState, block: &Block) {
    let transmitted = attenuate(state.optical_depth).transmitted;
    for (sum, part) in state.color.iter_mut().zip(block.color) {
        *sum += transmitted * part;
    }
    let sum = state.optical_depth + block.depth;
    state.optical_depth_rest += block.depth - (sum - state.optical_depth);
    let settled = sum + state.optical_depth_rest;
    state.optical_depth_rest -= settled - sum;
    state.optical_depth = settled;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_of_nothing_changes_no_bit() {
        let mut state = RayState::default();
        for turn in 1..2000u32 {
            let mut block = Block::EMPTY;
            block.composite(([0.3, 0.5, 0.7], 1.0 / turn as f32), 0.01);
            join_block(&mut state, &block);
            let before = state;
            let mut nothing = Block::EMPTY;
            nothing.composite(([0.0; 3], 0.0), 0.01);
            join_block(&mut state, &nothing);
            join_block(&mut state, &Block::EMPTY);
            assert_eq!(bytemuck::bytes_of(&state), bytemuck::bytes_of(&before));
        }
    }
}
