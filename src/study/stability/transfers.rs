//! Transfer functions that no step resolves: spikes, jumps, extinctions over 24 orders of magnitude.

use crate::study::stability::{Case, Lens, hill, made, spaced};

const BLUE: [f64; 3] = [0.1, 0.3, 0.9];
const GOLD: [f64; 3] = [1.0, 0.8, 0.3];

pub(super) fn cases() -> Vec<Case> {
    let unit = spaced([1.0; 3]);
    let smooth = |name| Case::of(name, made([16; 3], unit, |at| hill(at, 16)));
    let with = |name, transfer: &[(f64, [f64; 3], f64)], bound, reason| Case {
        transfer: transfer.to_vec(),
        ..smooth(name).within(bound, reason)
    };
    let graded = |name, most: f64| {
        let points = [(0.0, GOLD, 0.5 * most), (1.0, GOLD, most)];
        with(
            name,
            &points,
            1e-3,
            "a smooth field of one colour: 3e-4 measured, a quarter with half the step",
        )
    };
    let spike = [
        (0.0, BLUE, 0.0),
        (0.6999, BLUE, 0.0),
        (0.7, GOLD, 0.5),
        (0.7001, BLUE, 0.0),
        (1.0, BLUE, 0.0),
    ];
    let jumps = [
        (0.0, BLUE, 0.0),
        (0.4, BLUE, 0.0),
        (0.4, GOLD, 0.3),
        (0.7, GOLD, 0.3),
        (0.7, BLUE, 0.05),
        (1.0, BLUE, 0.05),
    ];
    let wall = [(0.0, BLUE, 0.0), (0.6, BLUE, 0.0), (0.6, GOLD, 1e12), (1.0, GOLD, 1e12)];
    vec![
        with(
            "a spike narrower than any step",
            &spike,
            1.0 - (-0.5_f64).exp(),
            "a sample that falls on the spike counts it for a whole step: 0.5 x 0.5, twice a ray",
        ),
        with(
            "jumps",
            &jumps,
            0.15,
            "each jump may fall half a step early or late: opacity of 0.3 x 0.25, twice",
        ),
        Case {
            // Head on: a grazing ray may have the wall between two samples, and no bound at all.
            lens: Lens::Degrees(6.0),
            ..with("a wall", &wall, 2e-7, "one colour, and nothing before it")
        },
        graded("extinction 1e-12", 1e-12),
        graded("extinction 1e-6", 1e-6),
        graded("extinction 1", 1.0),
        graded("extinction 1e6", 1e6),
        graded("extinction 1e12", 1e12),
        with("opacity exactly 0", &[(0.0, GOLD, 0.0), (1.0, BLUE, 0.0)], 0.0, "").dark(),
        Case {
            // Every ray of the picture meets it.
            lens: Lens::Degrees(10.0),
            alpha: Some(1.0),
            ..with(
                "opacity exactly 1",
                &[(0.0, GOLD, 1e12), (1.0, GOLD, 1e12)],
                2e-7,
                "one colour; f32",
            )
        },
    ]
}
