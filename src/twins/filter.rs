//! The value between voxels; twin of `shaders/common/filter.glsl` but for its sampler variant.

/// A 3D image in memory, x fastest.
#[derive(Clone, Copy)]
pub struct Texels<'a, T> {
    /// Texels along each axis, apron included.
    pub size: [u32; 3],
    /// As the device returns them.
    pub texels: &'a [T],
}

/// Trilinear value in the cell whose lower corner is `corner`, apron included.
pub fn filtered<T: Copy, const N: usize>(
    image: &Texels<T>,
    corner: [i32; 3],
    within: [f32; 3],
    parts: impl Fn(T) -> [f32; N],
) -> [f32; N] {
    let [width, height, _] = image.size;
    let at = |x: i32, y: i32, z: i32| {
        let [x, y, z] = [corner[0] + x, corner[1] + y, corner[2] + z].map(|c| c as usize);
        parts(image.texels[(z * height as usize + y) * width as usize + x])
    };
    let without = within.map(|w| 1.0 - w);
    let along = |a: [f32; N], b: [f32; N], axis: usize| -> [f32; N] {
        std::array::from_fn(|part| a[part] * without[axis] + b[part] * within[axis])
    };
    let row = |y, z| along(at(0, y, z), at(1, y, z), 0);
    let face = |z| along(row(0, z), row(1, z), 1);
    along(face(0), face(1), 2)
}
