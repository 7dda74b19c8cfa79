//! The ray of a pixel; twin of `shaders/common/ray_setup.glsl`.

use bytemuck::{Pod, Zeroable};

use crate::twins::ray::RayGeometry;

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

const TWO_POW_32: f64 = 4_294_967_296.0;
/// Adding it leaves the nearest integer in the low bits of an f64.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

fn to_fixed(value: f64) -> (i32, u32) {
    let rounded = value + ROUNDER;
    let rest = (value - (rounded - ROUNDER)) * TWO_POW_32 + ROUNDER;
    let cell = rounded.to_bits() as u32 as i32;
    (cell - i32::from(rest < ROUNDER), rest.to_bits() as u32)
}

/// The ray through the centre of pixel (column, row) of the view.
pub fn set_up_ray(
    view: &ViewRays,
    pixel: [u32; 2],
    volume_size: [u32; 3],
    step_world: f64,
) -> RayGeometry {
    set_up_ray_within(view, pixel, volume_size, step_world, [0.0, 1e300], [1.0; 3])
}

/// The part of it between two of its parameters (multiples of its direction), in voxels each of which
/// spans 1 / `per_scale` level-0 voxels along each axis.
pub fn set_up_ray_within(
    view: &ViewRays,
    [column, row]: [u32; 2],
    volume_size: [u32; 3],
    step_world: f64,
    depth: [f64; 2],
    per_scale: [f64; 3],
) -> RayGeometry {
    let at_x = f64::from(column) + 0.5;
    let at_y = f64::from(row) + 0.5;
    let linear = |base: &[f64; 4], per_column: &[f64; 4], per_row: &[f64; 4]| -> [f64; 3] {
        std::array::from_fn(|axis| base[axis] + per_column[axis] * at_x + per_row[axis] * at_y)
    };
    let origin = linear(&view.origin_voxel, &view.origin_column_voxel, &view.origin_row_voxel);
    let direction =
        linear(&view.direction_voxel, &view.direction_column_voxel, &view.direction_row_voxel);
    let direction_world =
        linear(&view.direction_world, &view.direction_column_world, &view.direction_row_world);
    let [mut enter, mut leave] = depth;
    let mut never = false;
    for axis in 0..3 {
        let extent = f64::from(volume_size[axis]);
        if direction[axis] == 0.0 {
            never |= origin[axis] < 0.0 || origin[axis] >= extent;
        } else {
            let per_direction = 1.0 / direction[axis];
            let to_near = -origin[axis] * per_direction;
            let to_far = (extent - origin[axis]) * per_direction;
            enter = enter.max(to_near.min(to_far));
            leave = leave.min(to_near.max(to_far));
        }
    }
    if never {
        leave = -1.0;
    }
    let mut geometry = RayGeometry::default();
    if leave > enter {
        let squared: f64 = direction_world[0] * direction_world[0]
            + direction_world[1] * direction_world[1]
            + direction_world[2] * direction_world[2];
        let length_world = (leave - enter) * squared.sqrt();
        let steps = length_world / step_world;
        let whole = (steps + ROUNDER) - ROUNDER;
        let count = (if whole < steps { whole + 1.0 } else { whole }).max(1.0);
        let step_ray = (leave - enter) / count;
        for axis in 0..3 {
            let middle = origin[axis] + (enter + 0.5 * step_ray) * direction[axis];
            let start = middle * per_scale[axis] - 0.5;
            let delta = step_ray * direction[axis] * per_scale[axis];
            (geometry.start_cell[axis], geometry.start_fraction[axis]) = to_fixed(start);
            (geometry.delta_cell[axis], geometry.delta_fraction[axis]) = to_fixed(delta);
        }
        geometry.sample_count = count as u32;
        geometry.step_world = (length_world / count) as f32;
    }
    geometry
}
