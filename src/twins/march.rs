//! Moves every ray on by a bounded number of samples; twin of `shaders/march.comp`.

use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_march::{Channel, Settings, march_ray};

/// Marches every ray.
pub fn march(
    geometry: &[RayGeometry],
    states: &mut [RayState],
    channels: &[Channel],
    settings: &Settings,
) {
    for (geometry, state) in geometry.iter().zip(states) {
        march_ray(geometry, state, channels, settings);
    }
}
