//! One ray per pixel of a tile; twin of `shaders/rays.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::limits::PLACE_RUNNING;
use crate::twins::march_bricks::Rays;
use crate::twins::ranks::LevelView;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_block::RayBlock;
use crate::twins::ray_setup::{ViewRays, set_up_ray, set_up_ray_within};

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// First pixel of the tile: column, row.
    pub tile_origin_pixel: [u32; 2],
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
    /// Voxels along each axis.
    pub volume_size: [u32; 3],
    /// Index of the view.
    pub view: u32,
    /// Greatest distance of two samples, world units.
    pub step_world: f64,
}

/// The shader's push constants where rays march through bricks: those of [`Push`], and the level.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct BrickPush {
    /// First pixel of the tile: column, row.
    pub tile_origin_pixel: [u32; 2],
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
    /// Voxels of level 0 along each axis.
    pub volume_size: [u32; 3],
    /// Index of the view.
    pub view: u32,
    /// Not used: each level has its own.
    pub step_world: f64,
    /// Finest in use.
    pub level: u32,
    /// Nothing.
    pub unused_0: u32,
}

/// Everything that is kept of the rays of a tile, in `push.level`.
pub fn rays_for_bricks(views: &[ViewRays], levels: &[LevelView], push: &BrickPush) -> Rays {
    let [width, height] = push.tile_size_pixel;
    let view = &views[push.view as usize];
    let level = &levels[push.level as usize];
    let [x, y, z, step_world] = level.per_scale_step;
    let [left, top] = push.tile_origin_pixel;
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let geometry: Vec<_> = pixels
        .map(|(column, row)| {
            let pixel = [left + column, top + row];
            set_up_ray_within(view, pixel, push.volume_size, step_world, level.depth, [x, y, z])
        })
        .collect();
    let count = geometry.len();
    Rays {
        geometry,
        states: vec![RayState::default(); count],
        blocks: vec![RayBlock::fresh(push.level); count],
        places: vec![PLACE_RUNNING; count],
    }
}

/// Geometry and fresh state of every ray of the tile, row by row.
pub fn rays(views: &[ViewRays], push: &Push) -> (Vec<RayGeometry>, Vec<RayState>) {
    let [width, height] = push.tile_size_pixel;
    let view = &views[push.view as usize];
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let [left, top] = push.tile_origin_pixel;
    let geometry: Vec<_> = pixels
        .map(|(column, row)| {
            set_up_ray(view, [left + column, top + row], push.volume_size, push.step_world)
        })
        .collect();
    let states = vec![RayState::default(); geometry.len()];
    (geometry, states)
}
