//! `ashfall compare`: how far one picture is from another.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use crate::cli::error_flags::coverage_text;
use crate::cli::output::{print, print_json};
use crate::cli::picture_file::{check_output, read_exr, read_layer, write_picture};
use crate::error::{Error, Result};
use crate::render::Picture;
use crate::study::error_estimate::{Coverage, coverage};
use crate::study::error_metrics::{PictureError, picture_error};

/// Say how far one EXR picture is from another, on linear values: PSNR over rgb with peak 1, also over
/// the pixels that the second picture covers, RMSE and the greatest difference.
///
/// Ends with 0 when the pictures agree and 6 when they do not: they must be equal, or as near as
/// --psnr and --max-difference ask. Of a picture drawn with --error it is said how much of the difference
/// the estimate covers.
#[derive(Args)]
pub struct Arguments {
    /// Picture to judge (.exr).
    picture: PathBuf,
    /// What it is compared with (.exr).
    reference: PathBuf,
    /// Agree from this many dB on.
    #[arg(long, value_name = "DB", allow_hyphen_values = true)]
    psnr: Option<f64>,
    /// Agree when no component differs by more than this.
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    max_difference: Option<f64>,
    /// Write the absolute difference, scaled to the greatest, as a picture (.png or .exr).
    #[arg(long, value_name = "FILE")]
    difference: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    pixels: usize,
    /// Nothing: the pictures are equal.
    psnr_db: Option<f64>,
    rmse: f64,
    max: f64,
    covered_pixels: usize,
    covered_psnr_db: Option<f64>,
    alpha_max: f64,
    not_comparable: usize,
    /// Where the picture has a layer error.total: how much of the difference it covers.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Coverage>,
    agree: bool,
}

/// Compares and judges.
pub fn run(arguments: &Arguments) -> Result<()> {
    for (flag, value) in
        [("--psnr", arguments.psnr), ("--max-difference", arguments.max_difference)]
    {
        if let Some(value) = value.filter(|value| value.is_nan() || *value < 0.0) {
            return Err(Error::arguments(format!(
                "{flag}: must be a number that is not negative, got {value}"
            )));
        }
    }
    if let Some(difference) = &arguments.difference {
        check_output(difference)?;
    }
    let picture = read_exr(&arguments.picture)?;
    let reference = read_exr(&arguments.reference)?;
    if picture.size != reference.size {
        return Err(Error::difference(format!(
            "{} has {} x {} pixels, {} has {} x {}",
            arguments.picture.display(),
            picture.size[0],
            picture.size[1],
            arguments.reference.display(),
            reference.size[0],
            reference.size[1]
        )));
    }
    let wide: Vec<[f64; 4]> = reference.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    let error = picture_error(&picture.pixels, &wide);
    let estimate = read_layer(&arguments.picture, "error.total")?;
    let covered = estimate.map(|total| coverage(&total, &picture.pixels, &wide));
    let report = judge(arguments, &error, covered);
    if let Some(file) = &arguments.difference {
        write_picture(file, &difference_picture(&picture, &reference))?;
    }
    if arguments.json {
        print_json(&report)?;
    } else {
        print(format_args!(
            "PSNR {:.2} dB over {} pixels, {:.2} dB over the {} covered; RMSE {:.3e}, greatest difference {:.3e} (alpha {:.3e})\n",
            error.whole.psnr_db,
            error.whole.pixels,
            error.covered.psnr_db,
            error.covered.pixels,
            error.whole.rmse,
            error.whole.max,
            error.alpha_max
        ))?;
        if let Some(covered) = &covered {
            print(format_args!("{}\n", coverage_text(covered)))?;
        }
    }
    if report.agree {
        return Ok(());
    }
    Err(Error::difference(format!(
        "{} and {} differ by more than asked",
        arguments.picture.display(),
        arguments.reference.display()
    )))
}

fn judge(arguments: &Arguments, error: &PictureError, covered: Option<Coverage>) -> Report {
    let max = error.whole.max.max(error.alpha_max);
    let agree = match (arguments.psnr, arguments.max_difference) {
        (None, None) => max == 0.0,
        (psnr, difference) => {
            psnr.is_none_or(|least| error.whole.psnr_db >= least)
                && difference.is_none_or(|most| max <= most)
        }
    };
    let finite = |db: f64| db.is_finite().then_some(db);
    Report {
        pixels: error.whole.pixels,
        psnr_db: finite(error.whole.psnr_db),
        rmse: error.whole.rmse,
        max: error.whole.max,
        covered_pixels: error.covered.pixels,
        covered_psnr_db: finite(error.covered.psnr_db),
        alpha_max: error.alpha_max,
        not_comparable: error.whole.not_comparable,
        error: covered,
        agree,
    }
}

fn difference_picture(picture: &Picture, reference: &Picture) -> Picture {
    let differences = picture.pixels.iter().zip(&reference.pixels).map(|(a, b)| {
        let mut difference: [f32; 4] = std::array::from_fn(|part| (a[part] - b[part]).abs());
        difference[3] = 1.0;
        difference
    });
    let differences: Vec<[f32; 4]> = differences.collect();
    let parts = differences.iter().flat_map(|pixel| &pixel[..3]);
    let greatest = parts.copied().filter(|d| d.is_finite()).fold(f32::MIN_POSITIVE, f32::max);
    let scaled =
        |pixel: [f32; 4]| [pixel[0] / greatest, pixel[1] / greatest, pixel[2] / greatest, 1.0];
    Picture { size: picture.size, pixels: differences.into_iter().map(scaled).collect() }
}
