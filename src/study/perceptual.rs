//! The difference that somebody sees who flips between two pictures.
//!
//! # Source
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: FLIP: A Difference Evaluator for
//! Alternating Images, 2020; the authors' own code by way of the crate `nv-flip`.
//!
//! # Units
//! 0: no difference is seen, 1: the greatest. Pictures are taken as a PNG holds them (8 bit sRGB), seen
//! from where one degree covers [`PIXELS_PER_DEGREE`] pixels. Below half a code of 8 bits all is 0.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8};

use crate::render::srgb_byte;

/// A screen 0.7 m wide with 3840 pixels, seen from 0.7 m: the authors' choice.
pub const PIXELS_PER_DEGREE: f32 = DEFAULT_PIXELS_PER_DEGREE;

/// The mean over all pixels, of pictures of `size` (across, down); NaN where a component is not finite.
///
/// # Panics
/// When a picture has not as many pixels: our own bug.
pub fn flip(size: [u32; 2], picture: &[[f64; 4]], reference: &[[f64; 4]]) -> f64 {
    let count = size[0] as usize * size[1] as usize;
    assert_eq!((picture.len(), reference.len()), (count, count), "pictures of that size");
    let finite = |pixels: &[[f64; 4]]| pixels.iter().flat_map(|p| &p[..3]).all(|c| c.is_finite());
    if !finite(picture) || !finite(reference) {
        return f64::NAN;
    }
    let image = |pixels: &[[f64; 4]]| {
        let codes: Vec<u8> = pixels
            .iter()
            .flat_map(|[r, g, b, _]| [*r, *g, *b].map(|c| srgb_byte(c as f32)))
            .collect();
        FlipImageRgb8::with_data(size[0], size[1], &codes)
    };
    let map = nv_flip::flip(image(reference), image(picture), PIXELS_PER_DEGREE).to_vec();
    map.iter().copied().map(f64::from).sum::<f64>() / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_is_zero_and_black_on_white_is_the_greatest() {
        let even = |v: f64| vec![[v, v, v, 1.0]; 40 * 30];
        assert_eq!(flip([40, 30], &even(0.3), &even(0.3)), 0.0);
        assert_eq!(flip([40, 30], &even(0.3), &even(0.300_001)), 0.0);
        let most = flip([40, 30], &even(0.0), &even(1.0));
        let near = flip([40, 30], &even(0.5), &even(0.55));
        assert!(most > 0.9 && most <= 1.0, "{most}");
        assert!(near > 0.0 && near < 0.2 * most, "{near}");
        assert!(flip([1, 1], &[[f64::NAN; 4]], &[[0.0; 4]]).is_nan());
        assert!(flip([1, 1], &[[0.0; 4]], &[[1.0; 4]]) > 0.5);
    }
}
