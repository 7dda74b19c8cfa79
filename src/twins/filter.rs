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

/// What the trilinear value is like at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Along {
    /// As [`filtered`] has it.
    pub value: f32,
    /// Change of the value per way.
    pub slope: f32,
    /// Least voxel of the cell.
    pub low: f32,
    /// Greatest voxel of the cell.
    pub high: f32,
}

impl Along {
    /// One value everywhere.
    pub const fn still(value: f32) -> Along {
        Along { value, slope: 0.0, low: value, high: value }
    }
}

/// Value, and its slope along `way`, in the cell whose lower corner is `corner`, apron included.
pub fn filtered_along<T: Copy>(
    image: &Texels<T>,
    corner: [i32; 3],
    within: [f32; 3],
    way: [f32; 3],
    part: impl Fn(T) -> f32,
) -> Along {
    let [width, height, _] = image.size;
    let at = |[x, y, z]: [i32; 3]| {
        let [x, y, z] = [corner[0] + x, corner[1] + y, corner[2] + z].map(|c| c as usize);
        part(image.texels[(z * height as usize + y) * width as usize + x])
    };
    let without = within.map(|w| 1.0 - w);
    let mixed = |a: f32, b: f32, axis: usize| a * without[axis] + b * within[axis];
    let cell = [0, 1].map(|z| [0, 1].map(|y| [0, 1].map(|x| at([x, y, z]))));
    let rows = cell.map(|face| face.map(|[a, b]| mixed(a, b, 0)));
    let faces = rows.map(|[a, b]| mixed(a, b, 1));
    let x = cell.map(|face| face.map(|[a, b]| b - a)).map(|[a, b]| mixed(a, b, 1));
    let y = rows.map(|[a, b]| b - a);
    let slopes = [mixed(x[0], x[1], 2), mixed(y[0], y[1], 2), faces[1] - faces[0]];
    let voxels = || cell.as_flattened().as_flattened().iter().copied();
    Along {
        value: mixed(faces[0], faces[1], 2),
        slope: slopes[0] * way[0] + slopes[1] * way[1] + slopes[2] * way[2],
        low: voxels().fold(f32::INFINITY, f32::min),
        high: voxels().fold(f32::NEG_INFINITY, f32::max),
    }
}
