//! `--error`: what a picture's own settings may have cost it, in layers, figures and colours.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::cli::picture_file::{check_output, read_exr};
use crate::error::{Error, Result};
use crate::render::Picture;
use crate::study::error_estimate::{Coverage, ErrorEstimate, coverage};

/// Whether errors are estimated, and where they go.
#[derive(Args)]
#[command(next_help_heading = "Error")]
pub struct ErrorFlags {
    /// Estimate each pixel's error: layers error.step, error.early_stop, error.levels, error.total of an .exr,
    /// and figures in the statistics. Draws the scene again with other settings, half the samples or so.
    #[arg(long)]
    pub error: bool,
    /// Write the total as a picture (.png, .exr): black 1e-6, violet 1e-4, orange 1e-2, white 1.
    #[arg(long, value_name = "FILE", requires = "error")]
    pub error_picture: Option<PathBuf>,
    /// The truth (.exr), as `ashfall reference` writes it: says how much of it the estimate covers. Of
    /// several views, one file each, named as pictures are.
    #[arg(long, value_name = "FILE", requires = "error")]
    pub reference: Option<PathBuf>,
}

impl ErrorFlags {
    /// Refuses names of files that could not be written.
    pub fn check(&self) -> Result<()> {
        self.error_picture.as_deref().map_or(Ok(()), check_output)
    }
}

/// How much of the difference to the picture in `file` an estimate covers.
pub fn coverage_by(file: &Path, estimate: &ErrorEstimate, picture: &Picture) -> Result<Coverage> {
    let truth = read_exr(file)?;
    if truth.size != picture.size {
        return Err(Error::input(format!(
            "--reference {}: has {} x {} pixels, the picture {} x {}: make it anew with the same --size",
            file.display(),
            truth.size[0],
            truth.size[1],
            picture.size[0],
            picture.size[1]
        )));
    }
    let wide: Vec<[f64; 4]> = truth.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    Ok(coverage(&estimate.total, &picture.pixels, &wide))
}

/// What an estimate covers, in a line.
pub fn coverage_text(covered: &Coverage) -> String {
    let beyond = match covered.beyond_max > 0.0 {
        true => format!(", the others by at most {:.1e} more", covered.beyond_max),
        false => String::new(),
    };
    format!(
        "the estimate covers {:.3} % of the pixels' true error{beyond}; it is {:.1} times the true RMS {:.1e}",
        100.0 * covered.covered,
        covered.over_truth,
        covered.true_rms
    )
}

/// Errors in colours, by their logarithm.
pub fn error_picture(total: &[f32], size: [u32; 2]) -> Picture {
    // Linear rgb at 1e-6, 1e-4, 1e-2 and 1.
    const STOPS: [[f32; 3]; 4] =
        [[0.0, 0.0, 0.0], [0.12, 0.01, 0.28], [0.90, 0.16, 0.01], [1.0, 1.0, 1.0]];
    let color = |error: &f32| {
        let along = ((error.max(1e-6).log10() + 6.0) / 2.0).clamp(0.0, 3.0);
        let below = (along as usize).min(STOPS.len() - 2);
        let part = along - below as f32;
        let mix = |c: usize| STOPS[below][c] + part * (STOPS[below + 1][c] - STOPS[below][c]);
        [mix(0), mix(1), mix(2), 1.0]
    };
    Picture { size, pixels: total.iter().map(color).collect() }
}
