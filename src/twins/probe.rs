//! Samples along straight lines and their sums; twin of `shaders/probe.comp`.

use bytemuck::{Pod, Zeroable};

use crate::twins::filter::{Texels, filtered};

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// First sample of the first line.
    pub origin_voxel: [f32; 3],
    /// Lines across.
    pub lines_across: u32,
    /// From one line to the next, across.
    pub column_voxel: [f32; 3],
    /// Lines down.
    pub lines_down: u32,
    /// From one line to the next, down.
    pub row_voxel: [f32; 3],
    /// Samples of each line.
    pub samples: u32,
    /// From one sample to the next.
    pub step_voxel: [f32; 3],
}

/// The sum of each line, filtered in f32 as the shader's FILTER_FETCH and FILTER_QUADS do.
pub fn probe(image: &Texels<f32>, push: &Push) -> Vec<f32> {
    let lines = (0..push.lines_down).flat_map(|y| (0..push.lines_across).map(move |x| [x, y]));
    lines.map(|line| sum_of_line(image, push, line)).collect()
}

fn sum_of_line(image: &Texels<f32>, push: &Push, [x, y]: [u32; 2]) -> f32 {
    let start: [f32; 3] = std::array::from_fn(|axis| {
        push.origin_voxel[axis]
            + x as f32 * push.column_voxel[axis]
            + y as f32 * push.row_voxel[axis]
    });
    let mut sum = 0.0f32;
    for index in 0..push.samples {
        let position: [f32; 3] =
            std::array::from_fn(|axis| start[axis] + index as f32 * push.step_voxel[axis]);
        let cell = position.map(f32::floor);
        let within = std::array::from_fn(|axis| position[axis] - cell[axis]);
        let corner = cell.map(|c| c as i32 + 1);
        let [value] = filtered(image, corner, within, |texel| [texel]);
        sum += value;
    }
    sum
}
