//! Grids of every shape in every place.

use ashfall::render::Settings;
use ashfall::scene::Overrides;
use ashfall::study::stability::survey;

use crate::common::drawing::Device;

#[test]
fn places_hold() {
    crate::hold("places");
}

/// At UTM coordinates f64 has 2^-30 of a metre left; the shader works in voxels from the corner.
#[test]
fn a_survey_looks_the_same_wherever_it_is() {
    let Some(device) = Device::open() else { return };
    let picture = |origin| {
        let case = survey("survey", origin);
        let overrides = Overrides { size: Some([48, 48]), ..Overrides::default() };
        let data = case.data(16, 1.0, &overrides).unwrap_or_else(|why| panic!("{why}"));
        device.draw_with(&data, 0, &Settings::default()).picture
    };
    let (here, there) = (picture([0.0; 3]), picture([5e5, 6.7e6, -900.0]));
    assert!(here.pixels.iter().filter(|pixel| pixel[3] > 0.1).count() > 200, "it is seen");
    let parts = here.pixels.iter().flatten().zip(there.pixels.iter().flatten());
    let worst = parts.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("survey at UTM coordinates: {worst:.1e} from the one at the origin");
    assert!(worst <= 1e-4, "{worst:e}");
    device.finish();
}
