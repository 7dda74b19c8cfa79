//! From a brick's voxels to the texels of its slot.

use crate::render::image_layout::{Layout, TexelLayout};
use crate::volume::{Size3, VoxelFormat, sanitized};

/// Writes the texels of a brick of `size` voxels (apron included), x fastest, into `texels`, all of it.
pub fn write_texels(
    voxels: &[u8],
    format: VoxelFormat,
    size: Size3,
    layout: &TexelLayout,
    texels: &mut [u8],
) {
    match (format, layout.layout) {
        (VoxelFormat::U8 | VoxelFormat::U16 | VoxelFormat::Rgba8, Layout::Plain) => {
            texels.copy_from_slice(voxels);
        }
        (VoxelFormat::U8, _) => convert::<1>(voxels, size, layout.layout, texels, |v| v),
        (VoxelFormat::Rgba8, _) => convert::<4>(voxels, size, layout.layout, texels, |v| v),
        (VoxelFormat::U16, _) => convert::<2>(voxels, size, layout.layout, texels, |v| v),
        (VoxelFormat::I16, _) => {
            convert::<2>(voxels, size, layout.layout, texels, |[low, high]| [low, high ^ 0x80]);
        }
        (VoxelFormat::F32, _) => convert::<4>(voxels, size, layout.layout, texels, |bytes| {
            let value = f64::from(sanitized(f32::from_le_bytes(bytes)));
            (((value - layout.offset) / layout.scale) as f32).to_ne_bytes()
        }),
    }
}

fn convert<const N: usize>(
    voxels: &[u8],
    size: Size3,
    layout: Layout,
    texels: &mut [u8],
    bytes: impl Fn([u8; N]) -> [u8; N],
) {
    let voxels = voxels.as_chunks::<N>().0;
    let (width, height) = (size.x as usize, size.y as usize);
    match layout {
        Layout::Plain => {
            for (texel, voxel) in texels.as_chunks_mut::<N>().0.iter_mut().zip(voxels) {
                *texel = bytes(*voxel);
            }
        }
        Layout::Quads => {
            let rows = texels.chunks_exact_mut(width * 4 * N);
            for (index, row) in rows.enumerate() {
                // The last row and column have no neighbour inside the slot: nothing reads it.
                let next = if (index + 1) % height == 0 { index } else { index + 1 };
                let (here, next) =
                    (&voxels[index * width..][..width], &voxels[next * width..][..width]);
                for (x, texel) in row.chunks_exact_mut(4 * N).enumerate() {
                    let right = (x + 1).min(width - 1);
                    let quad =
                        [bytes(here[x]), bytes(here[right]), bytes(next[x]), bytes(next[right])];
                    texel.copy_from_slice(quad.as_flattened());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::ValueRange;

    #[test]
    fn quads_hold_their_neighbours_and_i16_is_moved_up() {
        let layout = |format, kind| TexelLayout::of(format, ValueRange::of(0.0), kind);
        let mut texels = [0; 16];
        let size = Size3::new(2, 2, 1);
        let quads = layout(VoxelFormat::U8, Layout::Quads);
        write_texels(&[1, 2, 3, 4], VoxelFormat::U8, size, &quads, &mut texels);
        assert_eq!(texels, [1, 2, 3, 4, 2, 2, 4, 4, 3, 4, 3, 4, 4, 4, 4, 4]);
        let mut texels = [0; 4];
        let voxels: Vec<u8> = [-32768i16, 5].iter().flat_map(|v| v.to_le_bytes()).collect();
        let plain = layout(VoxelFormat::I16, Layout::Plain);
        write_texels(&voxels, VoxelFormat::I16, Size3::new(2, 1, 1), &plain, &mut texels);
        assert_eq!(texels, [0, 0, 5, 0x80]);
    }
}
