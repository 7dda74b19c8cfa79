//! Faults planted in cases: the suite has to complain of each.

use ashfall::study::stability::{Case, measure, themes};

use crate::common::drawing::Device;

fn case(name: &str) -> Case {
    let all = themes().into_iter().flat_map(|theme| theme.cases);
    all.into_iter().find(|case| case.name == name).expect("a case")
}

#[test]
fn faults_are_noticed() {
    let Some(device) = Device::open() else { return };
    let complaints = |case: &Case| {
        let outcome = measure(&device.gpu, &device.compiler, case, "riemann");
        outcome.unwrap_or_else(|why| panic!("{why}")).complaints.join("\n")
    };
    // A bound that f32 cannot keep, a closed form of something else, levels that do differ.
    let tight = Case { bound: 1e-9, ..case("sheared") };
    assert!(complaints(&tight).contains("error against the reference"), "{}", complaints(&tight));
    let other = Case { alpha: Some(0.79), ..case("linear") };
    assert!(complaints(&other).contains("closed form"), "{}", complaints(&other));
    let uneven = Case { voxels: case("white noise").voxels, alpha: None, ..case("linear") };
    assert!(complaints(&uneven).contains("change with the level"), "{}", complaints(&uneven));
    let dark = Case { dark: true, ..case("sheared") };
    assert!(complaints(&dark).contains("brightest"), "{}", complaints(&dark));
    assert_eq!(complaints(&case("sheared")), "");
    device.finish();
}
