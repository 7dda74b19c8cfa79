//! From voxels to texels, and through the staging halves into an image.

use rayon::prelude::*;

use crate::error::Result;
use crate::gpu::{Image, Staging, TimePoint};
use crate::render::image_layout::{Layout, TexelLayout};
use crate::volume::{Macrocells, Size3, Voxels, sanitized};

/// Fills an image with a channel and its apron; returns when the last copy is done on the device.
pub fn upload(
    staging: &mut Staging,
    image: &Image,
    voxels: &Voxels,
    size: Size3,
    layout: &TexelLayout,
) -> Result<Option<TimePoint>> {
    upload_boxes(staging, image, |start, box_size| texels(voxels, size, layout, start, box_size))
}

/// Fills an image with the codes of macrocells.
pub fn upload_codes(
    staging: &mut Staging,
    image: &Image,
    codes: &Macrocells<u8>,
) -> Result<Option<TimePoint>> {
    upload_boxes(staging, image, |[x, y, z], [width, height, depth]| {
        let rows = (z..z + depth).flat_map(|z| (y..y + height).map(move |y| (y, z)));
        let row = |(y, z)| {
            let start = codes.size.index(x, y, z);
            &codes.of[start..start + width as usize]
        };
        rows.flat_map(row).copied().collect()
    })
}

/// Box by box; `texels` gives those of a box by its first texel and size.
fn upload_boxes(
    staging: &mut Staging,
    image: &Image,
    texels: impl Fn([u32; 3], [u32; 3]) -> Vec<u8>,
) -> Result<Option<TimePoint>> {
    let [width, height, depth] = image.spec().size;
    let row_bytes = u64::from(width) * image.spec().format.bytes();
    let rows_per_copy = (staging.half_bytes() / row_bytes).max(1);
    // Whole slices where they fit, else parts of one slice: a copy is a box.
    let slices = u32::try_from(rows_per_copy / u64::from(height)).unwrap_or(depth).min(depth);
    let rows = if slices > 0 { height } else { rows_per_copy as u32 };
    let slices = slices.max(1);
    let mut last = None;
    for z in (0..depth).step_by(slices as usize) {
        for y in (0..height).step_by(rows as usize) {
            let box_size = [width, rows.min(height - y), slices.min(depth - z)];
            let texels = texels([0, y, z], box_size);
            last = Some(staging.copy_to_image("upload", &texels, image, [0, y, z], box_size)?);
        }
    }
    Ok(last)
}

/// Texels of a box of the image (apron included in its coordinates), tightly packed.
pub fn texels(
    voxels: &Voxels,
    size: Size3,
    layout: &TexelLayout,
    start: [u32; 3],
    box_size: [u32; 3],
) -> Vec<u8> {
    let source = Source { size, start, box_size, layout: layout.layout };
    match voxels {
        Voxels::U8(v) => source.gather(v, |value| [value]),
        Voxels::U16(v) => source.gather(v, u16::to_ne_bytes),
        Voxels::I16(v) => source.gather(v, |value| (value as u16 ^ 0x8000).to_ne_bytes()),
        Voxels::Rgba8(v) => source.gather(v, |value| value),
        Voxels::F32(v) => source.gather(v, |value| {
            let relative = (f64::from(sanitized(value)) - layout.offset) / layout.scale;
            (relative as f32).to_ne_bytes()
        }),
    }
}

struct Source {
    size: Size3,
    start: [u32; 3],
    box_size: [u32; 3],
    layout: Layout,
}

impl Source {
    fn gather<T: Copy + Sync, const N: usize>(
        &self,
        voxels: &[T],
        bytes: impl Fn(T) -> [u8; N] + Sync,
    ) -> Vec<u8> {
        let [width, height, depth] = self.box_size.map(|edge| edge as usize);
        let voxels_per_texel = match self.layout {
            Layout::Plain => 1,
            Layout::Quads => 4,
        };
        let row_bytes = width * voxels_per_texel * N;
        let mut out = vec![0u8; row_bytes * height * depth];
        out.par_chunks_mut(row_bytes).enumerate().for_each(|(index, row)| {
            let y = self.start[1] + (index % height) as u32;
            let z = self.start[2] + (index / height) as u32;
            // Apron coordinates are one more than voxel coordinates; the edge voxel is repeated.
            let line = |y: u32| {
                let y = y.saturating_sub(1).min(self.size.y - 1);
                let z = z.saturating_sub(1).min(self.size.z - 1);
                let start = self.size.index(0, y, z);
                &voxels[start..start + self.size.x as usize]
            };
            let at =
                |line: &[T], x: u32| bytes(line[x.saturating_sub(1).min(self.size.x - 1) as usize]);
            let (here, next) = (line(y), line(y + 1));
            for (x, texel) in row.chunks_exact_mut(voxels_per_texel * N).enumerate() {
                let x = self.start[0] + x as u32;
                match self.layout {
                    Layout::Plain => texel.copy_from_slice(&at(here, x)),
                    Layout::Quads => {
                        let quad = [at(here, x), at(here, x + 1), at(next, x), at(next, x + 1)];
                        texel.copy_from_slice(quad.as_flattened());
                    }
                }
            }
        });
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{ValueRange, VoxelFormat};

    #[test]
    fn the_apron_repeats_the_edge_and_quads_hold_their_neighbours() {
        let size = Size3::new(2, 2, 1);
        let voxels = Voxels::U8(vec![1, 2, 3, 4]);
        let layout = |kind| TexelLayout::of(VoxelFormat::U8, ValueRange::of(0.0), kind);
        let plain = texels(&voxels, size, &layout(Layout::Plain), [0, 0, 1], [4, 4, 1]);
        assert_eq!(plain, [1, 1, 2, 2, 1, 1, 2, 2, 3, 3, 4, 4, 3, 3, 4, 4]);
        let quads = texels(&voxels, size, &layout(Layout::Quads), [1, 1, 0], [1, 1, 1]);
        assert_eq!(quads, [1, 2, 3, 4]);
    }
}
