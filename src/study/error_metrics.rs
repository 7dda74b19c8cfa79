//! How far a picture is from the reference, on linear values.
//!
//! Rgb alone counts, with peak 1. A component that is NaN in either picture, or infinite in one
//! and not equal in the other, is *not comparable*: it is counted, and makes every figure that it
//! belongs to as bad as it can be (PSNR minus infinity, errors infinite).

/// Alpha of the reference above which a pixel counts as covered.
pub const COVERED_ALPHA: f64 = 1.0 / 255.0;

/// Figures of one picture against its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// Over all pixels.
    pub whole: RgbError,
    /// Over pixels whose reference alpha is above [`COVERED_ALPHA`].
    pub covered: RgbError,
    /// Greatest absolute error of alpha.
    pub alpha_max: f64,
}

/// Figures over the rgb components of some pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RgbError {
    /// Pixels that were compared.
    pub pixels: usize,
    /// In dB; infinite for equal pictures and for no pixels.
    pub psnr_db: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Greatest absolute error.
    pub max: f64,
    /// Components without a comparable value.
    pub not_comparable: usize,
}

/// Compares a picture in f32 with a reference in f64, pixel by pixel.
///
/// # Panics
/// When the pictures have different numbers of pixels: our own bug.
pub fn picture_error(picture: &[[f32; 4]], reference: &[[f64; 4]]) -> PictureError {
    let picture: Vec<[f64; 4]> = picture.iter().map(|pixel| pixel.map(f64::from)).collect();
    picture_error_f64(&picture, reference)
}

/// Compares two pictures in f64, pixel by pixel.
///
/// # Panics
/// When the pictures have different numbers of pixels: our own bug.
pub fn picture_error_f64(picture: &[[f64; 4]], reference: &[[f64; 4]]) -> PictureError {
    assert_eq!(picture.len(), reference.len(), "pictures of one size");
    let pairs = || picture.iter().zip(reference);
    PictureError {
        whole: rgb_error(pairs()),
        covered: rgb_error(pairs().filter(|(_, truth)| truth[3] > COVERED_ALPHA)),
        alpha_max: pairs()
            .map(|(got, truth)| difference(got[3], truth[3]).unwrap_or(f64::INFINITY))
            .fold(0.0, f64::max),
    }
}

/// The absolute difference, unless there is no comparable value.
fn difference(got: f64, truth: f64) -> Option<f64> {
    // Equal infinities have no difference that arithmetic could find.
    let difference = if got == truth { 0.0 } else { (got - truth).abs() };
    difference.is_finite().then_some(difference)
}

fn rgb_error<'a>(pairs: impl Iterator<Item = (&'a [f64; 4], &'a [f64; 4])>) -> RgbError {
    let (mut pixels, mut not_comparable) = (0, 0);
    let (mut squares, mut max) = (0.0, 0.0_f64);
    for (got, truth) in pairs {
        pixels += 1;
        for c in 0..3 {
            match difference(got[c], truth[c]) {
                Some(difference) => {
                    squares += difference * difference;
                    max = max.max(difference);
                }
                None => not_comparable += 1,
            }
        }
    }
    if not_comparable > 0 {
        let (rmse, max) = (f64::INFINITY, f64::INFINITY);
        return RgbError { pixels, psnr_db: f64::NEG_INFINITY, rmse, max, not_comparable };
    }
    let rmse = if pixels == 0 { 0.0 } else { (squares / (3 * pixels) as f64).sqrt() };
    RgbError { pixels, psnr_db: -20.0 * rmse.log10(), rmse, max, not_comparable }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: [f64; 4] = [0.5, 0.5, 0.5, 1.0];

    #[test]
    fn equal_pictures_are_infinitely_close() {
        let error = picture_error(&[[0.5, 0.5, 0.5, 1.0]; 4], &[GREY; 4]);
        assert_eq!(error.whole.psnr_db, f64::INFINITY);
        assert_eq!((error.whole.max, error.whole.rmse, error.alpha_max), (0.0, 0.0, 0.0));
        let infinite = [[f64::INFINITY, 0.0, 0.0, 1.0]];
        assert_eq!(picture_error_f64(&infinite, &infinite).whole.psnr_db, f64::INFINITY);
        assert_eq!(picture_error_f64(&[], &[]).whole.psnr_db, f64::INFINITY);
    }

    #[test]
    fn a_tenth_off_everywhere_is_20_db() {
        let error = picture_error_f64(&[[0.6, 0.4, 0.6, 0.75]; 2], &[GREY; 2]);
        assert!((error.whole.psnr_db - 20.0).abs() < 1e-12);
        assert!((error.whole.rmse - 0.1).abs() < 1e-15 && (error.whole.max - 0.1).abs() < 1e-15);
        assert_eq!(error.alpha_max, 0.25);
    }

    #[test]
    fn covered_pixels_are_those_of_the_reference() {
        let clear = [0.0, 0.0, 0.0, 1.0 / 255.0];
        let error = picture_error_f64(&[[0.6, 0.6, 0.6, 0.0], GREY], &[GREY, clear]);
        assert_eq!((error.whole.pixels, error.covered.pixels), (2, 1));
        assert!((error.covered.psnr_db - 20.0).abs() < 1e-12);
        assert_eq!(error.whole.max, 0.5);
    }

    #[test]
    fn nan_and_one_sided_infinity_are_as_bad_as_can_be() {
        for bad in [f64::NAN, f64::INFINITY] {
            for (got, truth) in [([bad, 0.5, 0.5, 1.0], GREY), (GREY, [bad, 0.5, 0.5, 1.0])] {
                let whole = picture_error_f64(&[GREY, got], &[GREY, truth]).whole;
                assert_eq!((whole.not_comparable, whole.psnr_db), (1, f64::NEG_INFINITY));
                assert_eq!((whole.max, whole.rmse), (f64::INFINITY, f64::INFINITY));
            }
        }
        let alpha = picture_error_f64(&[[0.5, 0.5, 0.5, f64::NAN]], &[GREY]);
        assert_eq!((alpha.alpha_max, alpha.whole.psnr_db), (f64::INFINITY, f64::INFINITY));
    }
}
