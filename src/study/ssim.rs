//! Structural similarity of two pictures, on linear luminance.
//!
//! 1 for equal pictures; less where local means, contrasts or patterns differ. Symmetric.
//!
//! # Source
//! Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to Structural
//! Similarity, 2004: Gaussian window of 11 x 11 pixels with a deviation of 1.5, K1 = 0.01, K2 = 0.03,
//! peak 1. At the border the window is cut and its weights made to sum to 1 again, so that every pixel
//! counts and pictures of any size have a figure. Luminance has the weights of ITU-R BT.709.

use rayon::prelude::*;

const RADIUS: usize = 5;
const DEVIATION_PIXELS: f64 = 1.5;
/// (K1 * peak)^2 and (K2 * peak)^2.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The mean over all pixels, of pictures of `size` (across, down); NaN where a component is not finite.
///
/// # Panics
/// When a picture has not as many pixels: our own bug.
pub fn ssim(size: [u32; 2], a: &[[f64; 4]], b: &[[f64; 4]]) -> f64 {
    let [width, height] = size.map(|edge| edge as usize);
    assert_eq!((a.len(), b.len()), (width * height, width * height), "pictures of that size");
    let luminance = |pixel: &[f64; 4]| (0..3).map(|c| LUMINANCE[c] * pixel[c]).sum::<f64>();
    let a: Vec<f64> = a.iter().map(luminance).collect();
    let b: Vec<f64> = b.iter().map(luminance).collect();
    let blurred = |product: fn(f64, f64) -> f64| {
        let of_pixels: Vec<f64> = a.iter().zip(&b).map(|(a, b)| product(*a, *b)).collect();
        blur(&of_pixels, width, height)
    };
    let [mean_a, mean_b] = [blurred(|a, _| a), blurred(|_, b| b)];
    let [square_a, square_b] = [blurred(|a, _| a * a), blurred(|_, b| b * b)];
    let mixed = blurred(|a, b| a * b);
    let of_pixel = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb) = (square_a[i] - ma * ma, square_b[i] - mb * mb);
        let covariance = mixed[i] - ma * mb;
        (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    // Equal pictures are exactly 1: numerator and denominator are then the same sums.
    (0..a.len()).map(of_pixel).sum::<f64>() / a.len() as f64
}

/// Gaussian, one axis after the other.
fn blur(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight = |distance: usize| (-0.5 * (distance as f64 / DEVIATION_PIXELS).powi(2)).exp();
    let weights: [f64; RADIUS + 1] = std::array::from_fn(weight);
    let along = |at: usize, count: usize, value: &dyn Fn(usize) -> f64| {
        let (mut sum, mut total) = (0.0, 0.0);
        for near in at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(count) {
            let weight = weights[near.abs_diff(at)];
            sum += weight * value(near);
            total += weight;
        }
        sum / total
    };
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = along(x, width, &|x| row[x]);
        }
    });
    let mut both = vec![0.0; values.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = along(y, height, &|y| rows[y * width + x]);
        }
    });
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: impl Iterator<Item = f64>) -> Vec<[f64; 4]> {
        values.map(|v| [v, v, v, 1.0]).collect()
    }

    /// Pictures of one value have no contrast: (2 a b + C1) / (a^2 + b^2 + C1) is left.
    #[test]
    fn even_pictures_have_a_closed_form() {
        let (a, b) = (grey((0..20).map(|_| 0.8)), grey((0..20).map(|_| 0.2)));
        let expected = (2.0 * 0.8 * 0.2 + C1) / (0.8 * 0.8 + 0.2 * 0.2 + C1);
        assert!((ssim([5, 4], &a, &b) - expected).abs() < 1e-12);
    }

    /// A pattern and its opposite: covariance is minus the variance.
    #[test]
    fn equal_is_one_and_opposite_is_negative() {
        let board = |flip: bool| {
            grey(
                (0..32 * 32)
                    .map(move |i| f64::from(u8::from((i % 32 + i / 32) % 2 == usize::from(flip)))),
            )
        };
        let (a, b) = (board(false), board(true));
        assert!((ssim([32, 32], &a, &a) - 1.0).abs() < 1e-12);
        let opposite = ssim([32, 32], &a, &b);
        assert!((-1.0..-0.9).contains(&opposite), "{opposite}");
        assert_eq!(opposite, ssim([32, 32], &b, &a));
        let mut bad = a.clone();
        bad[7][1] = f64::NAN;
        assert!(ssim([32, 32], &bad, &b).is_nan());
        assert_eq!(ssim([1, 1], &a[..1], &a[..1]), 1.0);
    }
}
