//! All that a study says of one picture against one reference.

use serde::{Deserialize, Serialize};

use crate::study::error_metrics::{RgbError, picture_error_f64};
use crate::study::perceptual::flip;
use crate::study::ssim::ssim;

/// On linear values but for `flip`. Nothing where a figure has no finite value: a PSNR of equal
/// pictures, and everything where components are not comparable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Over all pixels.
    pub whole: RgbFigures,
    /// Over pixels whose reference alpha is above 1/255.
    pub covered: RgbFigures,
    /// Greatest absolute error of alpha.
    pub alpha_max: Option<f64>,
    /// Structural similarity of linear luminance; 1: equal.
    pub ssim: Option<f64>,
    /// Mean FLIP of the pictures as a PNG holds them; 0: no difference is seen, 1: the greatest.
    pub flip: Option<f64>,
}

/// Over the rgb components of some pixels, peak 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RgbFigures {
    /// Pixels that count.
    pub pixels: usize,
    /// Root of the mean squared error.
    pub rmse: Option<f64>,
    /// Greatest absolute error.
    pub max: Option<f64>,
    /// -20 log10 of the RMSE, in dB.
    pub psnr_db: Option<f64>,
    /// Components without a comparable value.
    pub not_comparable: usize,
}

impl Figures {
    /// Of a picture of `size` pixels (across, down).
    ///
    /// # Panics
    /// When a picture has not as many pixels: our own bug.
    pub fn of(size: [u32; 2], picture: &[[f64; 4]], reference: &[[f64; 4]]) -> Figures {
        let error = picture_error_f64(picture, reference);
        Figures {
            whole: RgbFigures::of(&error.whole),
            covered: RgbFigures::of(&error.covered),
            alpha_max: finite(error.alpha_max),
            ssim: finite(ssim(size, picture, reference)),
            flip: finite(flip(size, picture, reference)),
        }
    }

    /// As [`Figures::of`], of a picture as the device gives it.
    ///
    /// # Panics
    /// As [`Figures::of`].
    pub fn of_drawn(size: [u32; 2], picture: &[[f32; 4]], reference: &[[f64; 4]]) -> Figures {
        let wide: Vec<[f64; 4]> = picture.iter().map(|pixel| pixel.map(f64::from)).collect();
        Figures::of(size, &wide, reference)
    }

    /// Whether the PSNR over all pixels is at least so many dB.
    pub fn reaches(&self, psnr_db: f64) -> bool {
        self.whole.rmse.is_some_and(|rmse| rmse <= 10f64.powf(-psnr_db / 20.0))
    }
}

impl RgbFigures {
    fn of(error: &RgbError) -> RgbFigures {
        RgbFigures {
            pixels: error.pixels,
            rmse: finite(error.rmse),
            max: finite(error.max),
            psnr_db: finite(error.psnr_db),
            not_comparable: error.not_comparable,
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
