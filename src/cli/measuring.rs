//! What commands that measure on a device share: how the result is shown, on which device, and the end.

use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use crate::cli::output::print_json;
use crate::cli::progress::Progress;
use crate::cli::scene_flags::{DeviceFlags, shader_compiler};
use crate::error::Result;
use crate::gpu::{Gpu, ShaderCompiler};

/// How a measurement is shown, and the device it is taken on.
#[derive(Args)]
pub struct MeasuringFlags {
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceFlags,
}

impl MeasuringFlags {
    /// Opens the device, measures, prints, and heeds what validation said; returns the table.
    pub fn measure<T: Serialize>(
        &self,
        measure: impl FnOnce(&Arc<Gpu>) -> Result<T>,
        describe: impl FnOnce(&T) -> Result<()>,
    ) -> Result<T> {
        let gpu = self.device.open()?;
        let table = measure(&gpu)?;
        if self.json {
            print_json(&table)?;
        } else {
            describe(&table)?;
        }
        DeviceFlags::heed_validation(&gpu)?;
        Ok(table)
    }

    /// As [`MeasuringFlags::measure`], under a bar named `what` that is told the finished part.
    pub fn measure_under_bar<T: Serialize>(
        &self,
        what: &str,
        measure: impl FnOnce(&Arc<Gpu>, &ShaderCompiler, &mut dyn FnMut(f64)) -> Result<T>,
        describe: impl FnOnce(&T) -> Result<()>,
    ) -> Result<T> {
        let measure = |gpu: &Arc<Gpu>| {
            let progress = Progress::start(what);
            measure(gpu, &shader_compiler(), &mut |part| progress.set(part))
        };
        self.measure(measure, describe)
    }
}
