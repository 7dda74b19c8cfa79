//! Fields with closed forms, and fields as rough as voxels allow.

use crate::study::stability::{Case, Lens, made, noise, spaced};

const WHITE: [f64; 3] = [1.0; 3];

/// Parallel rays along x through the middle of a volume whose other edges are `edge` units.
fn along_x(case: Case, edge: f64) -> Case {
    let middle = 0.5 * edge;
    Case {
        eye: [-5.0, middle, middle],
        target: [0.0, middle, middle],
        up: [0.0, 0.0, 1.0],
        lens: Lens::Height(0.9 * edge),
        // Pixels of more than two voxels, so that a coarser level is in use where it may be. Nothing
        // changes from pixel to pixel.
        size: [3, 3],
        // Coarser voxels are means of finer ones, and depth is a sum of voxels.
        any_level: true,
        ..case
    }
}

fn opacity(depth: f64) -> f64 {
    -(-depth).exp_m1()
}

pub(super) fn cases() -> Vec<Case> {
    let unit = spaced([1.0; 3]);
    let constant = |name, extinction: f64| {
        let case = Case::of(name, made([12, 8, 8], unit, |_| 0.25));
        Case {
            transfer: vec![(0.0, WHITE, extinction)],
            alpha: Some(opacity(12.0 * extinction)),
            dark: extinction == 0.0,
            ..along_x(case, 8.0).within(1e-6, "one sample is exact; f32")
        }
    };
    let ramp = |[x, _, _]: [u32; 3]| x as f32 / 31.0;
    let straight = vec![(0.0, WHITE, 0.0), (1.0, WHITE, 0.1)];
    let linear = Case {
        transfer: straight.clone(),
        alpha: Some(opacity(1.6)),
        ..along_x(Case::of("linear", made([32, 8, 8], unit, ramp)), 8.0).within(
            1e-6,
            "steps end at voxel centres, where the kinks are: midpoints are exact; f32",
        )
    };
    let falling = |[x, _, _]: [u32; 3]| (-0.2 * (x as f32)).exp();
    // The sum over voxel centres and the linear parts between them is the sum of the voxels.
    let voxels: f64 = (0..32).map(|x| f64::from(falling([x, 0, 0]))).sum();
    let exponential = Case {
        // Spans end between the voxel centres: a kink within one costs an eighth of its rise.
        spans: Some(3e-4),
        transfer: straight.clone(),
        alpha: Some(opacity(0.1 * voxels)),
        ..along_x(Case::of("exponential", made([32, 8, 8], unit, falling)), 8.0).within(
            1e-6,
            "steps end at voxel centres, where the kinks are: midpoints are exact; f32",
        )
    };
    let shell = |[x, y, z]: [u32; 3]| {
        let from_middle = |at: u32| (f64::from(at) + 0.5 - 16.0) / 16.0;
        let radius = [x, y, z].into_iter().map(|at| from_middle(at).powi(2)).sum::<f64>().sqrt();
        (1.0 - (radius - 0.7).abs() * 16.0).max(0.0) as f32
    };
    let thin = Case {
        transfer: vec![(0.0, WHITE, 0.0), (1.0, WHITE, 1.0)],
        ..Case::of("thin shell", made([32; 3], unit, shell))
            .within(1e-2, "a shell two voxels thick: 5e-3 measured, a fifth with half the step")
    };
    let checkerboard =
        Case::of("checkerboard", made([24; 3], unit, |[x, y, z]| ((x ^ y ^ z) & 1) as f32))
            .within(1.5e-2, "cubics between 0 and 1: 9e-3 measured, a fifth with half the step");
    let white_noise = Case::of("white noise", made([24; 3], unit, noise))
        .within(1e-2, "cubics between 0 and 1: 4e-3 measured, a quarter with half the step");
    // A million units: 100 voxels of ten thousand, of rising density.
    let fog = made([100, 4, 4], spaced([1e4; 3]), |[x, _, _]| x as f32 / 99.0);
    let million = Case {
        transfer: vec![(0.0, WHITE, 0.0), (1.0, WHITE, 4e-6)],
        alpha: Some(opacity(2.0)),
        eye: [-5e6, 2e4, 2e4],
        ..along_x(Case::of("a million units of fog", fog), 4e4).within(
            1e-6,
            "steps end at voxel centres, where the kinks are: midpoints are exact; f32",
        )
    };
    let many_steps = Case {
        transfer: vec![(0.0, [0.2, 0.4, 0.6], 0.01), (1.0, [0.9, 0.7, 0.5], 0.05)],
        step: 0.00064,
        alpha: Some(opacity(0.03 * 64.0)),
        ..along_x(
            Case::of("100,000 steps", made([64, 2, 2], unit, |[x, _, _]| x as f32 / 63.0)),
            2.0,
        )
        .within(2e-6, "the rule's own error is 1e-9; f32")
    };
    vec![
        constant("constant", 0.07),
        constant("constant, extinction 0", 0.0),
        constant("constant, opaque", 1e23),
        constant("constant, 1e-12", 1e-12),
        linear,
        exponential,
        thin,
        checkerboard,
        white_noise,
        million,
        many_steps,
    ]
}
