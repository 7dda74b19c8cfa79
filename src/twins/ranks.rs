//! The order in which bricks of a view are needed; twin of `shaders/common/ranks.glsl`.
//!
//! Along any ray brick coordinates move away from the eye's, axis by axis, and levels only get coarser.
//! So the number of bricks between a brick and the one nearest to the eye, summed over the axes, grows
//! by at least one with every border that a ray crosses: no ray needs a brick whose rank it has passed,
//! and no ray needs two bricks of one rank.

use bytemuck::{Pod, Zeroable};

use crate::twins::limits::RANK_NONE;

/// A level of the volume as one view uses it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LevelView {
    /// x, y, z: 1 / level-0 voxels that a voxel spans; w: greatest distance of two samples, world.
    pub per_scale_step: [f64; 4],
    /// Ray parameters between which the level is in use.
    pub depth: [f64; 2],
    /// Halvings of level 0 that lead to the level, along each axis.
    pub halvings: [u32; 3],
    /// 1: bricks of the level are never given up; substitute refinement alone.
    pub held: u32,
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Places of all finer levels come before.
    pub first_place: u32,
    /// The brick nearest to the eye.
    pub eye_brick: [i32; 3],
    /// Of that brick; [`RANK_NONE`] where the level is not in use.
    pub rank_first: u32,
}

/// The level that a place lies in.
pub fn level_of_place(levels: &[LevelView], place: u32) -> usize {
    levels.iter().rposition(|level| place >= level.first_place).unwrap_or(0)
}

/// Rank of a brick of a level.
pub fn rank_of_brick(level: &LevelView, brick: [i32; 3]) -> u32 {
    if level.rank_first == RANK_NONE {
        return RANK_NONE;
    }
    let away = (0..3).map(|axis| brick[axis].abs_diff(level.eye_brick[axis]));
    level.rank_first + away.sum::<u32>()
}

/// The place of a brick.
pub fn place_of_brick(level: &LevelView, brick: [i32; 3]) -> u32 {
    let [x, y, z] = brick.map(|at| at as u32);
    level.first_place + (z * level.bricks[1] + y) * level.bricks[0] + x
}

/// The brick at a place of a level.
pub fn brick_of_place(level: &LevelView, place: u32) -> [i32; 3] {
    let [across, down, _] = level.bricks;
    let within = place - level.first_place;
    let row = within / across;
    [within % across, row % down, row / down].map(|at| at as i32)
}

/// Rank of a place.
pub fn rank_of_place(levels: &[LevelView], place: u32) -> u32 {
    let level = &levels[level_of_place(levels, place)];
    rank_of_brick(level, brick_of_place(level, place))
}
