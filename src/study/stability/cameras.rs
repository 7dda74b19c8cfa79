//! Cameras where rays degenerate: inside voxels, in faces, along axes, as narrow and as wide as may be.

use crate::study::stability::{Case, Lens, hill, made, spaced};

const SMOOTH: &str = "a smooth field: 7e-4 measured at most, about a quarter with half the step";

pub(super) fn cases() -> Vec<Case> {
    let case = |name, eye: [f64; 3], target: [f64; 3], lens| {
        let voxels = made([12; 3], spaced([1.0; 3]), |at| hill(at, 12));
        let up = [0.0, 0.0, 1.0];
        // An odd number of pixels, so that one ray runs along the line of sight itself.
        let size = [21, 21];
        Case { eye, target, up, lens, size, ..Case::of(name, voxels).within(1e-3, SMOOTH) }
    };
    let wide = Lens::Degrees(60.0);
    vec![
        case("inside a voxel", [5.3, 6.1, 5.8], [9.0, 8.0, 7.0], wide),
        case("at a voxel's centre", [5.5, 6.5, 5.5], [9.5, 6.5, 5.5], wide),
        case("at a corner between voxels", [6.0; 3], [6.0, 9.0, 6.0], wide),
        case("on a face of the box, inwards", [0.0, 6.2, 5.9], [6.0, 6.2, 5.9], wide),
        case("on a face of the box, outwards", [0.0, 6.2, 5.9], [-6.0, 6.3, 5.9], wide).dark(),
        case("on a face of the box, along it", [0.0, -3.0, 5.9], [0.0, 9.0, 5.9], wide),
        case("on a corner of the box", [0.0; 3], [6.0; 3], wide),
        case("along an axis", [-9.0, 6.0, 6.0], [0.0, 6.0, 6.0], Lens::Height(14.0)),
        case("along an axis, backwards", [29.0, 6.5, 6.5], [0.0, 6.5, 6.5], Lens::Height(14.0)),
        case("orthographic", [-9.0, -4.0, 21.0], [6.0; 3], Lens::Height(20.0)),
        case("0.01 degrees", [-9e4, 3e4, 4e4], [6.0; 3], Lens::Degrees(0.01)),
        case("170 degrees", [-1.5, 5.0, 7.0], [6.0; 3], Lens::Degrees(170.0)),
        case("170 degrees from within", [5.3, 6.1, 5.8], [9.0, 8.0, 7.0], Lens::Degrees(170.0)),
        case("looking away", [-3.0, 6.0, 6.0], [-9.0, 6.0, 6.0], wide).dark(),
    ]
}
