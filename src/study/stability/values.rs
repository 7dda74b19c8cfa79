//! Voxels of every kind that files hold: not finite, denormal, greatest, whole integer ranges.

use crate::study::stability::{Case, hill, made, noise, spaced, whole};
use crate::volume::Voxels;

const CUBICS: &str = "cubics between 0 and 1: 1.1e-2 measured, a fifth with half the step";
const SMOOTH: &str = "a smooth field: 7e-4 measured at most, about a quarter with half the step";

pub(super) fn cases() -> Vec<Case> {
    let unit = spaced([1.0; 3]);
    let cube = [16; 3];
    let smooth = |at| hill(at, 16);
    let holed = |hole: f32| move |at: [u32; 3]| if noise(at) < 0.02 { hole } else { hill(at, 16) };
    let case = |name, value: &dyn Fn([u32; 3]) -> f32| Case::of(name, made(cube, unit, value));
    let everything = |at: [u32; 3]| match (noise(at) * 40.0) as u32 {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 => f32::NEG_INFINITY,
        3 => f32::MAX,
        4 => f32::MIN,
        5 => f32::MIN_POSITIVE / 3.0,
        6 => -0.0,
        _ => hill(at, 16),
    };
    let denormal = |at| f32::from_bits((hill(at, 16) * 8_000_000.0) as u32);
    let indices = || (0..4096_u32).map(|i| [i % 16, i / 16 % 16, i / 256]);
    let u16s: Vec<u16> = indices().map(|at| (smooth(at) * 65535.0) as u16).collect();
    let i16s: Vec<i16> = indices().map(|at| (smooth(at) * 65535.0 - 32768.0) as i16).collect();
    let u16_noise: Vec<u16> = indices().map(|at| if noise(at) < 0.5 { 0 } else { 65535 }).collect();
    let huge = f64::from(f32::MAX);
    let scaled = |factor: f32| move |at: [u32; 3]| hill(at, 16) * factor;
    vec![
        Case {
            // As dense at 0 as at 1: a hole taken for 0 must not look like one.
            transfer: vec![(0.0, [0.1, 0.3, 0.9], 0.15), (1.0, [1.0, 0.8, 0.3], 0.15)],
            ..case("NaN", &holed(f32::NAN))
                .within(0.1, "cells of nothing end at jumps: half a step of 0.15 x 0.5 at each")
        },
        case("+infinity", &holed(f32::INFINITY))
            .within(0.08, "cells jump from 0 to 1 at once: 5e-2 measured"),
        Case {
            // A span has twice a step's length.
            spans: Some(0.12),
            ..case("-infinity", &holed(f32::NEG_INFINITY))
                .within(0.06, "cells jump to 0 at once: 3e-2 measured")
        },
        case("everything", &everything).within(0.1, "cells jump at once: 6e-2 measured"),
        case("NaN alone", &|_| f32::NAN).dark(),
        Case {
            window: [0.0, f64::from(f32::from_bits(8_000_000))],
            ..case("denormal", &denormal)
                .within(1e-3, "a smooth field, where the device keeps denormals")
        },
        Case {
            window: [0.0, huge],
            ..case("up to f32's greatest", &scaled(f32::MAX)).within(1e-3, SMOOTH)
        },
        Case {
            window: [-huge, huge],
            ..case("f32's whole range", &|at| (2.0 * hill(at, 16) - 1.0) * f32::MAX)
                .within(1e-3, SMOOTH)
        },
        Case {
            window: [1e6, 1e6 + 1.0],
            ..case("a small range far from 0", &|at| 1e6 + (hill(at, 16) * 16.0).round() / 16.0)
                .within(1e-3, SMOOTH)
        },
        Case {
            window: [0.0, 65535.0],
            ..Case::of("u16's whole range", whole(cube, unit, Voxels::U16(u16s)))
                .within(1e-3, SMOOTH)
        },
        Case {
            window: [0.0, 65535.0],
            ..Case::of("u16's ends", whole(cube, unit, Voxels::U16(u16_noise))).within(2e-2, CUBICS)
        },
        Case {
            window: [-32768.0, 32767.0],
            ..Case::of("i16's whole range", whole(cube, unit, Voxels::I16(i16s)))
                .within(1e-3, SMOOTH)
        },
    ]
}
