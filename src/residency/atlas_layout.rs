//! How slots lie in an atlas.

use crate::gpu::{Gpu, Image, ImageFormat, ImageSpec};

/// One atlas: an image of slots, x fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasLayout {
    /// The image.
    pub spec: ImageSpec,
    /// Texels of a slot along each axis, apron included.
    pub slot: [u32; 3],
    /// Slots along each axis.
    pub slots: [u32; 3],
}

impl AtlasLayout {
    /// The atlas with the most slots, `slots_max` at most, whose image takes `bytes_max` at most; nothing
    /// where not one fits.
    pub fn fit(
        gpu: &Gpu,
        name: &'static str,
        format: ImageFormat,
        stored: bool,
        slot: [u32; 3],
        slots_max: u32,
        bytes_max: u64,
    ) -> Option<AtlasLayout> {
        let edge_max = gpu.facts().image_3d_edge_max;
        let most = slot.map(|edge| edge_max / edge);
        let slot_bytes = slot.iter().map(|edge| u64::from(*edge)).product::<u64>() * format.bytes();
        let mut wanted = u64::from(slots_max).min(bytes_max / slot_bytes) as u32;
        while wanted > 0 {
            let slots = near_cube(wanted, most)?;
            let size = std::array::from_fn(|axis| slots[axis] * slot[axis]);
            let spec = ImageSpec { name, size, format, stored };
            if Image::memory_bytes(gpu, &spec) <= bytes_max {
                return Some(AtlasLayout { spec, slot, slots });
            }
            // Alignment took more than the texels: a hundredth less, at least one.
            wanted = slots.iter().product::<u32>().min(wanted - wanted.div_ceil(100));
        }
        None
    }

    /// How many slots there are.
    pub fn slot_count(&self) -> u32 {
        self.slots.iter().product()
    }

    /// First texel of a slot.
    pub fn slot_origin(&self, slot: u32) -> [u32; 3] {
        let [across, down, _] = self.slots;
        let row = slot / across;
        let at = [slot % across, row % down, row / down];
        std::array::from_fn(|axis| at[axis] * self.slot[axis])
    }
}

/// The box of at most `count` items, each edge at most `most`, that holds the most; of those the one
/// nearest to a cube.
fn near_cube(count: u32, most: [u32; 3]) -> Option<[u32; 3]> {
    let mut best: Option<(u32, u32, [u32; 3])> = None;
    for x in 1..=most[0].min(count) {
        for y in 1..=most[1].min(count / x) {
            let z = (count / (x * y)).min(most[2]);
            if z == 0 {
                continue;
            }
            let surface = x * y + y * z + z * x;
            let better = best.is_none_or(|(items, least, _)| {
                (x * y * z, u32::MAX - surface) > (items, u32::MAX - least)
            });
            if better {
                best = Some((x * y * z, surface, [x, y, z]));
            }
        }
    }
    best.map(|(_, _, slots)| slots)
}

#[cfg(test)]
mod tests {
    use super::near_cube;

    #[test]
    fn slots_fill_a_box_near_a_cube() {
        assert_eq!(near_cube(8, [120; 3]), Some([2, 2, 2]));
        assert_eq!(near_cube(1000, [120; 3]), Some([10, 10, 10]));
        assert_eq!(near_cube(7, [120; 3]).map(|slots| slots.iter().product()), Some(7));
        assert_eq!(near_cube(100, [3, 3, 3]), Some([3, 3, 3]));
        assert_eq!(near_cube(5, [0, 3, 3]), None);
    }
}
