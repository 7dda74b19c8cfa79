//! One ray per pixel of a tile; twin of `shaders/rays.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_setup::{ViewRays, set_up_ray};

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
