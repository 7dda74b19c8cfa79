//! Puts bricks from the upload buffer into their slots; twin of `shaders/place.comp`.

use bytemuck::{Pod, Zeroable};

/// Where a brick lies and where it goes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Placement {
    /// First texel in the atlas.
    pub start: [u32; 3],
    /// In the upload buffer.
    pub first_word: u32,
    /// Texels along each axis.
    pub size: [u32; 3],
    /// Nothing.
    pub unused_0: u32,
}

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Push {
    /// Texels of the largest brick.
    pub texels_max: u32,
    /// Of the atlas, among the placements.
    pub first_placement: u32,
}

/// Copies every brick's texels, `texel_bytes` each, into an atlas of `atlas_size` texels.
pub fn place(
    upload: &[u8],
    placements: &[Placement],
    texel_bytes: usize,
    atlas: &mut [u8],
    atlas_size: [u32; 3],
) {
    for placement in placements {
        let [width, height, depth] = placement.size.map(|edge| edge as usize);
        let [x, y, z] = placement.start.map(|at| at as usize);
        let [across, down, _] = atlas_size.map(|edge| edge as usize);
        let first = placement.first_word as usize * 4;
        let rows = (0..depth).flat_map(|k| (0..height).map(move |j| (j, k)));
        for (number, (j, k)) in rows.enumerate() {
            let source = first + number * width * texel_bytes;
            let target = (((z + k) * down + y + j) * across + x) * texel_bytes;
            let bytes = width * texel_bytes;
            atlas[target..target + bytes].copy_from_slice(&upload[source..source + bytes]);
        }
    }
}
