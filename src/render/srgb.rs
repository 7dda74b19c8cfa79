//! Linear light as the 8 bit codes that a PNG or a window holds.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::render::renderer::Picture;

/// The nearest sRGB code of a linear component, 0 to 1; what is beyond is clamped, NaN is 0.
///
/// # Source
/// IEC 61966-2-1.
pub fn srgb_byte(linear: f32) -> u8 {
    let linear = f64::from(linear).clamp(0.0, 1.0);
    let encoded =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// A picture over its background as sRGB codes, red, green, blue and 255, row by row.
pub fn srgb_bytes(picture: &Picture) -> Vec<u8> {
    let begins = code_begins();
    let code = |linear: f32| begins.partition_point(|begin| *begin <= linear) as u8;
    let mut bytes = vec![u8::MAX; picture.pixels.len() * 4];
    let rows = bytes.par_chunks_mut(4 * 1024).zip(picture.pixels.par_chunks(1024));
    rows.for_each(|(bytes, pixels)| {
        for (bytes, [r, g, b, _]) in bytes.chunks_exact_mut(4).zip(pixels) {
            bytes[..3].copy_from_slice(&[code(*r), code(*g), code(*b)]);
        }
    });
    bytes
}

/// The least linear component of every code but 0.
fn code_begins() -> &'static [f32; 255] {
    static BEGINS: OnceLock<[f32; 255]> = OnceLock::new();
    BEGINS.get_or_init(|| {
        std::array::from_fn(|at| {
            // Bits of numbers that are not negative rise with the numbers.
            let (mut below, mut begins) = (0.0f32.to_bits(), 1.0f32.to_bits());
            while below + 1 < begins {
                let middle = below.midpoint(begins);
                match usize::from(srgb_byte(f32::from_bits(middle))) > at {
                    true => begins = middle,
                    false => below = middle,
                }
            }
            f32::from_bits(begins)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_the_codes_of_its_components() {
        let mut values = vec![f32::NAN, -1.0, -0.0, 0.0, 1.0, 1.1, f32::INFINITY];
        values.extend(
            code_begins().iter().flat_map(|begin| [begin.next_down(), *begin, begin.next_up()]),
        );
        values.extend((0..50_000).map(|at| at as f32 / 49_999.0));
        let pixels: Vec<[f32; 4]> = values.iter().map(|value| [*value, 0.5, 1.0, 0.3]).collect();
        let picture = Picture { size: [pixels.len() as u32, 1], pixels };
        for (bytes, value) in srgb_bytes(&picture).chunks_exact(4).zip(&values) {
            assert_eq!(bytes, [srgb_byte(*value), srgb_byte(0.5), 255, 255], "{value}");
        }
    }
}
