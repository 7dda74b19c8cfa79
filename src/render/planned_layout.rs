//! Which layout voxels take, what each would cost, and why this one.
//!
//! What a sample costs on a device is measured by whoever plans (`study/layout_price.rs`) and comes here as
//! plain data, asked for only where it decides something.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::render::image_layout::{Layout, LayoutChoice};
use crate::scene::Filter;
use crate::volume::VoxelFormat;

/// What part of a sample's price in the plain layout quads may cost and be chosen: they take four times the
/// memory, so no saving that another measurement might not find is worth it.
pub const QUADS_PRICE_MAX: f64 = 0.9;

/// Measured on a device: nanoseconds of one sample that is filtered exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutPrices {
    /// Eight texels.
    pub plain_ns: f64,
    /// Two quads.
    pub quads_ns: f64,
}

/// Gives the prices for voxels of a format; nothing where a device has no clock for it.
pub type LayoutMeter<'m> = &'m dyn Fn(VoxelFormat) -> Result<Option<LayoutPrices>>;

/// See the module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedLayout {
    /// "plain" or "quads".
    pub chosen: &'static str,
    /// In a sentence.
    pub why: String,
    /// Those that the scene could take.
    pub costs: Vec<LayoutCost>,
}

/// What voxels in a layout cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayoutCost {
    /// "plain" or "quads".
    pub layout: &'static str,
    /// Device memory of voxels, bytes.
    pub voxel_bytes: u64,
    /// Slots of all atlases, where bricks are paged.
    pub slots: Option<u64>,
    /// Nanoseconds of one sample, where that was measured.
    pub sample_ns: Option<f64>,
}

/// A layout and what it was chosen by.
pub(super) struct Chosen {
    pub layout: Layout,
    pub why: String,
    pub prices: Option<LayoutPrices>,
}

impl Chosen {
    /// For the plan; bytes and slots of each layout that is possible.
    pub fn planned(self, costs: [Option<(u64, Option<u64>)>; 2]) -> PlannedLayout {
        let sample_ns = |layout: Layout| {
            self.prices.map(|prices| match layout {
                Layout::Plain => prices.plain_ns,
                Layout::Quads => prices.quads_ns,
            })
        };
        let costs =
            [Layout::Plain, Layout::Quads].into_iter().zip(costs).filter_map(|(layout, costs)| {
                costs.map(|(voxel_bytes, slots)| LayoutCost {
                    layout: layout.name(),
                    voxel_bytes,
                    slots,
                    sample_ns: sample_ns(layout),
                })
            });
        PlannedLayout { chosen: self.layout.name(), costs: costs.collect(), why: self.why }
    }
}

/// Whether voxels of these formats, filtered so, can lie in quads.
///
/// # Errors
/// Exit code 2 where they cannot and quads are wanted alone.
pub(super) fn quads_possible(
    choice: LayoutChoice,
    filter: Filter,
    mut formats: impl Iterator<Item = VoxelFormat>,
) -> Result<bool> {
    let possible = filter == Filter::Exact && formats.all(|format| format != VoxelFormat::Rgba8);
    if choice == LayoutChoice::Only(Layout::Quads) && !possible {
        return Err(Error::arguments(
            "--layout quads: needs filter \"exact\" and no RGBA channel: use --layout plain",
        ));
    }
    Ok(possible)
}

/// Chooses; `unfit` says why quads cannot be taken, and `prices` is asked only where nothing else decides.
pub(super) fn choose(
    choice: LayoutChoice,
    unfit: Option<String>,
    device_kind: &str,
    prices: impl FnOnce() -> Result<Option<LayoutPrices>>,
) -> Result<Chosen> {
    let unmeasured = |layout, why: String| Ok(Chosen { layout, why, prices: None });
    if let LayoutChoice::Only(layout) = choice {
        return unmeasured(layout, format!("--layout {}", layout.name()));
    }
    if let Some(why) = unfit {
        return unmeasured(Layout::Plain, why);
    }
    let Some(prices) = prices()? else {
        // As measured on devices of either kind that we had: docs/MEASUREMENTS.md.
        return match device_kind {
            "cpu" => unmeasured(Layout::Quads, "not measured, and the device is a CPU".to_owned()),
            _ => unmeasured(Layout::Plain, "not measured, and the device is no CPU".to_owned()),
        };
    };
    let ratio = prices.quads_ns / prices.plain_ns;
    let (layout, than) = match ratio <= QUADS_PRICE_MAX {
        true => (Layout::Quads, "no more than"),
        false => (Layout::Plain, "above"),
    };
    let why =
        format!("a sample of quads costs {ratio:.2} of a plain one, {than} {QUADS_PRICE_MAX}");
    Ok(Chosen { layout, why, prices: Some(prices) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prices(plain_ns: f64, quads_ns: f64) -> Result<Option<LayoutPrices>> {
        Ok(Some(LayoutPrices { plain_ns, quads_ns }))
    }

    #[test]
    fn prices_decide_where_nothing_else_does() {
        let auto = |kind, prices| {
            choose(LayoutChoice::Auto, None, kind, || prices).expect("chosen").layout
        };
        for kind in ["cpu", "discrete"] {
            assert_eq!(auto(kind, prices(10.0, 5.0)), Layout::Quads);
            assert_eq!(auto(kind, prices(10.0, 9.0)), Layout::Quads);
            assert_eq!(auto(kind, prices(10.0, 9.1)), Layout::Plain);
            assert_eq!(auto(kind, prices(10.0, 30.0)), Layout::Plain);
        }
        assert_eq!(auto("cpu", Ok(None)), Layout::Quads);
        assert_eq!(auto("discrete", Ok(None)), Layout::Plain);
    }

    #[test]
    fn nothing_is_measured_where_something_else_decides() {
        let never = || panic!("not to be asked");
        for layout in [Layout::Plain, Layout::Quads] {
            let chosen = choose(LayoutChoice::Only(layout), None, "cpu", never).expect("chosen");
            assert_eq!((chosen.layout, chosen.prices), (layout, None));
        }
        let unfit = Some("too large".to_owned());
        let chosen = choose(LayoutChoice::Auto, unfit, "cpu", never).expect("chosen");
        assert_eq!((chosen.layout, &chosen.why[..]), (Layout::Plain, "too large"));
    }
}
