//! Scenes at the edges of what numbers allow: what must hold of each, with every integrator, drawn
//! directly and through bricks. The cases are `study::stability`'s.

mod common;

#[path = "stability/cameras.rs"]
mod cameras;
#[path = "stability/fields.rs"]
mod fields;
#[path = "stability/places.rs"]
mod places;
#[path = "stability/planted.rs"]
mod planted;
#[path = "stability/transfers.rs"]
mod transfers;
#[path = "stability/values.rs"]
mod values;

use ashfall::study::stability::{integrators, measure, themes};
use common::drawing::Device;

/// Draws all cases of a theme and fails with all that does not hold.
fn hold(theme: &str) {
    let Some(device) = Device::open() else { return };
    let theme = themes().into_iter().find(|one| one.name == theme).expect("a theme");
    let mut failures = Vec::new();
    for integrator in integrators() {
        for case in theme.cases.iter().filter(|case| case.is_drawn_by(integrator)) {
            let outcome = measure(&device.gpu, &device.compiler, case, integrator);
            let outcome = outcome.unwrap_or_else(|why| panic!("{}: {why}", case.name));
            println!(
                "{}, {}, {integrator}: error {:.1e}, with half the step {:.1e}, bound {:.1e}; bricks {:.1e}",
                theme.name,
                case.name,
                outcome.error,
                outcome.error_halved,
                outcome.bound,
                outcome.paged
            );
            let sentences = outcome.complaints.into_iter();
            failures.extend(sentences.map(|why| format!("{}, {integrator}: {why}", case.name)));
        }
    }
    device.finish();
    assert!(failures.is_empty(), "{} do not hold:\n{}", failures.len(), failures.join("\n"));
}
