//! Transfer functions: colour and extinction of a windowed value.

/// Colours and extinctions whose products, summed over all channels, f32 holds.
const COLOR_MAX: f64 = 1e8;
const EXTINCTION_MAX: f64 = 1e24;

/// One point of a transfer function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferPoint {
    /// Windowed value, 0 to 1.
    pub at: f64,
    /// Linear red, green and blue.
    pub color: [f64; 3],
    /// Extinction per world unit.
    pub extinction: f64,
}

/// Piecewise linear in the windowed value, for colour and extinction each.
///
/// Two points at one place are a jump; the later one holds at the place itself. Before the first
/// point and from the last one on, the function is constant.
///
/// # Invariants
/// At least one point; finite; in order; no more than two at one place; extinction not negative.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    points: Vec<TransferPoint>,
}

impl TransferFunction {
    /// From points that hold the invariants; else the index of the first that does not, and why.
    pub fn new(points: Vec<TransferPoint>) -> Result<TransferFunction, (usize, String)> {
        if points.is_empty() {
            return Err((0, "transfer needs at least one point".to_owned()));
        }
        for (index, point) in points.iter().enumerate() {
            let refuse = |why: String| Err((index, why));
            if !(0.0..=1.0).contains(&point.at) {
                return refuse(format!("`at` must be within 0 and 1, got {}", point.at));
            }
            if !point.color.iter().all(|c| (0.0..=COLOR_MAX).contains(c)) {
                return refuse(format!(
                    "`color` must be within 0 and {COLOR_MAX:e}, got {:?}",
                    point.color
                ));
            }
            if !(0.0..=EXTINCTION_MAX).contains(&point.extinction) {
                return refuse(format!(
                    "`extinction` must be within 0 and {EXTINCTION_MAX:e} per world unit, got {}",
                    point.extinction
                ));
            }
            if index > 0 && point.at < points[index - 1].at {
                return refuse(format!(
                    "points must be in order of `at`: {} comes after {}",
                    point.at,
                    points[index - 1].at
                ));
            }
            if index > 1 && point.at == points[index - 2].at {
                return refuse(format!(
                    "no more than two points may stand at one place, {} has three",
                    point.at
                ));
            }
        }
        Ok(TransferFunction { points })
    }

    /// The points, in order.
    pub fn points(&self) -> &[TransferPoint] {
        &self.points
    }

    /// What the function is at a windowed value, as the point that would say so.
    pub fn at(&self, at: f64) -> TransferPoint {
        let points = &self.points;
        let after = points.partition_point(|point| point.at <= at);
        let (before, after) =
            (after.checked_sub(1).map(|before| points[before]), points.get(after));
        match (before, after) {
            (Some(before), Some(after)) => {
                let along = (at - before.at) / (after.at - before.at);
                let between = |a: f64, b: f64| a + along * (b - a);
                TransferPoint {
                    at,
                    color: std::array::from_fn(|c| between(before.color[c], after.color[c])),
                    extinction: between(before.extinction, after.extinction),
                }
            }
            (Some(only), None) => TransferPoint { at, ..only },
            (None, Some(only)) => TransferPoint { at, ..*only },
            (None, None) => unreachable!("at least one point"),
        }
    }
}
