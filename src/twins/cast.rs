//! The whole way of every ray of a tile; twin of `shaders/cast.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::march::march;
use crate::twins::ray_march::{Channel, Settings};
use crate::twins::ray_setup::ViewRays;
use crate::twins::rays::{self, rays};
use crate::twins::resolve::resolve;

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// Tile, volume, view and step.
    pub rays: rays::Push,
    /// Blocks of samples of the longest ray.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted.
    pub early_stop: f32,
    /// Linear colour behind everything.
    pub background: [f32; 3],
    /// Nothing.
    pub unused_0: u32,
}

/// Pixels of the tile and how many samples were taken.
pub fn cast(
    views: &[ViewRays],
    channels: &[Channel],
    settings: &Settings,
    push: &Push,
) -> (Vec<[f32; 4]>, u64) {
    let (geometry, mut states) = rays(views, &push.rays);
    march(&geometry, &mut states, channels, settings);
    resolve(&states, push.background)
}
