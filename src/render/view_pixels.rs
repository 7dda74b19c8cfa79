//! Which pixels each view of a scene draws, and in which tiles.

use crate::render::settings::Settings;
use crate::scene::{Part, Scene};

/// `[view]`
pub fn pixels_of_views(scene: &Scene) -> Vec<Part> {
    scene.views.iter().map(|view| view.pixels(scene.picture.size)).collect()
}

/// Largest picture, largest tile, and tiles of a view at most.
pub fn tiles_of(scene: &Scene, settings: &Settings) -> ([u32; 2], [u32; 2], u32) {
    let sizes = pixels_of_views(scene).into_iter().map(|part| part.size);
    let picture =
        sizes.fold([1; 2], |most, size| [0, 1].map(|axis: usize| size[axis].max(most[axis])));
    let tile: [u32; 2] = std::array::from_fn(|axis| picture[axis].min(settings.tile[axis]));
    (picture, tile, picture[0].div_ceil(tile[0]) * picture[1].div_ceil(tile[1]))
}

/// Of a rectangle.
pub fn pixels_of([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}
