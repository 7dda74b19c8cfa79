//! Of how many samples of a ray each channel takes one.
//!
//! # Source
//! residency-octree-2023 section 6.1: "another channel may only need to be sampled at every second step".

use crate::error::Result;
use crate::scene::{Integrator, SAMPLE_EVERY_MAX, Scene};
use crate::twins::limits::BLOCK_SAMPLES;

// In turn two of them make a pair, which has to lie in one block.
const _: () = assert!(2 * SAMPLE_EVERY_MAX <= BLOCK_SAMPLES);

/// For each channel of the scene's volume of how many samples it takes one; of none where each takes all.
///
/// # Errors
/// Exit code 3 where the integrator has no samples that one could stand for.
pub fn sample_rates(scene: &Scene) -> Result<Vec<u32>> {
    let volume = &scene.volumes[0];
    if volume.channels.iter().all(|channel| channel.sample_every == 1) {
        return Ok(Vec::new());
    }
    if scene.quality.integrator != Integrator::Riemann {
        return Err(volume.place.error(format!(
            "sample_every of a channel needs integrator \"riemann\", got \"{}\": set it, or leave sample_every out",
            scene.quality.integrator.name()
        )));
    }
    Ok(volume.channels.iter().map(|channel| channel.sample_every).collect())
}
