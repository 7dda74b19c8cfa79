//! Grids of every shape in every place: uneven, tiny, huge, far away, mirrored, all but flat.

use crate::study::stability::{Case, Lens, hill, made, spaced};

const SMOOTH: &str = "a smooth field: 7e-4 measured at most, about a quarter with half the step";

/// A seismic survey whose corner is at `origin`, seen from the side; nothing else depends on it.
pub fn survey(name: &'static str, origin: [f64; 3]) -> Case {
    let mut rows = [[12.5, 3.25, 0.0, 0.0], [-3.25, 12.5, 0.0, 0.0], [0.0, 0.0, -4.0, 0.0]];
    (0..3).for_each(|axis| rows[axis][3] = origin[axis]);
    let voxels = made([16, 16, 16], rows, |at| hill(at, 16));
    let at = |offset: [f64; 3]| [0, 1, 2].map(|axis| origin[axis] + offset[axis]);
    Case {
        eye: at([-200.0, -300.0, 150.0]),
        target: at([125.0, 75.0, -32.0]),
        up: [0.0, 0.0, 1.0],
        ..Case::of(name, voxels).within(1e-3, SMOOTH)
    }
}

pub(super) fn cases() -> Vec<Case> {
    let smooth = |at| hill(at, 12);
    let case = |name, rows| Case::of(name, made([12; 3], rows, smooth)).within(1e-3, SMOOTH);
    let mirrored = [[-1.0, 0.0, 0.0, 4.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, -2.0]];
    let turned = [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]];
    let sheared = [[1.0, 0.7, -0.4, 0.0], [0.0, 1.0, 0.6, 0.0], [0.2, 0.0, 1.0, 0.0]];
    // Two axes 1e-11 from parallel: a sliver 1.2e-10 thick. The field changes along z alone, so that
    // the one step that crosses it is right.
    let sliver = [[1.0, 1.0, 0.0, 0.0], [0.0, 1e-11, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let flat = Case {
        transfer: vec![(0.0, [0.1, 0.3, 0.9], 0.0), (1.0, [1.0, 0.8, 0.3], 1e11)],
        eye: [12.0, -1.0, 6.0],
        target: [12.0, 0.0, 6.0],
        up: [0.0, 0.0, 1.0],
        lens: Lens::Height(14.0),
        ..Case::of("condition 1e11", made([12; 3], sliver, |[_, _, z]| z as f32 / 11.0))
            .within(1e-5, "one step crosses it, and is right; 1e11 x 2^-52 of a voxel")
    };
    let one = Case::of("one voxel", made([1; 3], spaced([1.0; 3]), |_| 0.5))
        .within(1e-6, "one sample is exact; f32");
    let rod = made([1, 1, 5000], spaced([1.0; 3]), |[_, _, z]| (f64::from(z) * 0.01).sin() as f32);
    let along_the_rod = Case {
        transfer: vec![(0.0, [0.1, 0.3, 0.9], 2e-4), (1.0, [1.0, 0.8, 0.3], 2e-3)],
        eye: [0.52, 0.47, -300.0],
        target: [0.5, 0.5, 0.0],
        up: [0.0, 1.0, 0.0],
        lens: Lens::Degrees(0.4),
        ..Case::of("1 x 1 x 5000 from its end", rod.clone())
            .within(1e-5, "a step is a thousandth of a wave: 8e-7 measured")
    };
    let beside_the_rod = Case {
        transfer: vec![(0.0, [0.1, 0.3, 0.9], 0.1), (1.0, [1.0, 0.8, 0.3], 2.0)],
        eye: [3000.0, 900.0, 2670.0],
        target: [0.5, 0.5, 2670.0],
        up: [1.0, 0.0, 0.0],
        lens: Lens::Height(3.0),
        ..Case::of("1 x 1 x 5000 from the side", rod).within(1e-3, SMOOTH)
    };
    vec![
        case("spacing 1e-9", spaced([1e-9; 3])),
        case("spacing 1e9", spaced([1e9; 3])),
        case("spacing 1 to 1000", spaced([1.0, 1000.0, 30.0])),
        case("mirrored", mirrored),
        case("axes exchanged", turned),
        // Short enough for spans in bricks: an axis crosses more voxels than edges are long.
        Case { step: 0.35, ..case("sheared", sheared) },
        flat,
        survey("survey at the origin", [0.0; 3]),
        survey("survey at UTM coordinates", [5e5, 6.7e6, -900.0]),
        one,
        along_the_rod,
        beside_the_rod,
    ]
}
