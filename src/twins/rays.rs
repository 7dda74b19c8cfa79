//! One ray per pixel of a tile; twin of `shaders/rays.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::ray::{RayGeometry, RayState};

/// A view's rays, linear in the pixel; w is unused in each. Mirrors `ViewRays` in the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[allow(missing_docs, reason = "as scene::RayFrame, in voxels (corner origin) and in the world")]
pub struct ViewRays {
    pub origin_voxel: [f64; 4],
    pub origin_column_voxel: [f64; 4],
    pub origin_row_voxel: [f64; 4],
    pub direction_voxel: [f64; 4],
    pub direction_column_voxel: [f64; 4],
    pub direction_row_voxel: [f64; 4],
    pub direction_world: [f64; 4],
    pub direction_column_world: [f64; 4],
    pub direction_row_world: [f64; 4],
}

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

const TWO_POW_32: f64 = 4_294_967_296.0;

fn to_fixed(value: f64) -> (i32, u32) {
    let scaled = (value * TWO_POW_32 + 0.5).floor();
    let whole = (scaled * (1.0 / TWO_POW_32)).floor();
    (whole as i32, (scaled - whole * TWO_POW_32) as u32)
}

/// Geometry and fresh state of every ray of the tile, row by row.
pub fn rays(views: &[ViewRays], push: &Push) -> (Vec<RayGeometry>, Vec<RayState>) {
    let [width, height] = push.tile_size_pixel;
    let view = &views[push.view as usize];
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let geometry: Vec<_> = pixels.map(|pixel| ray(view, push, pixel)).collect();
    let states = vec![RayState::default(); geometry.len()];
    (geometry, states)
}

fn ray(view: &ViewRays, push: &Push, (column, row): (u32, u32)) -> RayGeometry {
    let at_x = f64::from(push.tile_origin_pixel[0] + column) + 0.5;
    let at_y = f64::from(push.tile_origin_pixel[1] + row) + 0.5;
    let linear = |base: &[f64; 4], per_column: &[f64; 4], per_row: &[f64; 4]| -> [f64; 3] {
        std::array::from_fn(|axis| base[axis] + per_column[axis] * at_x + per_row[axis] * at_y)
    };
    let origin = linear(&view.origin_voxel, &view.origin_column_voxel, &view.origin_row_voxel);
    let direction =
        linear(&view.direction_voxel, &view.direction_column_voxel, &view.direction_row_voxel);
    let direction_world =
        linear(&view.direction_world, &view.direction_column_world, &view.direction_row_world);
    let mut enter = 0.0f64;
    let mut leave = 1e300f64;
    for axis in 0..3 {
        let extent = f64::from(push.volume_size[axis]);
        if direction[axis] == 0.0 {
            if origin[axis] < 0.0 || origin[axis] > extent {
                leave = -1.0;
            }
        } else {
            let to_near = -origin[axis] / direction[axis];
            let to_far = (extent - origin[axis]) / direction[axis];
            enter = enter.max(to_near.min(to_far));
            leave = leave.min(to_near.max(to_far));
        }
    }
    let mut geometry = RayGeometry::default();
    if leave > enter {
        let squared: f64 = direction_world[0] * direction_world[0]
            + direction_world[1] * direction_world[1]
            + direction_world[2] * direction_world[2];
        let length_world = (leave - enter) * squared.sqrt();
        let count = (length_world / push.step_world).ceil().max(1.0);
        let step_ray = (leave - enter) / count;
        for axis in 0..3 {
            let start = origin[axis] + (enter + 0.5 * step_ray) * direction[axis] - 0.5;
            let delta = step_ray * direction[axis];
            (geometry.start_cell[axis], geometry.start_fraction[axis]) = to_fixed(start);
            (geometry.delta_cell[axis], geometry.delta_fraction[axis]) = to_fixed(delta);
        }
        geometry.sample_count = count as u32;
        geometry.step_world = (length_world / count) as f32;
    }
    geometry
}
