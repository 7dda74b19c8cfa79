//! What follows from measured points: the Pareto front, the cheapest for a quality, the order of
//! convergence.

use serde::Serialize;

/// Part of its error by which a point of the front is nearer to the truth than every cheaper one: less is
/// not worth a setting.
pub const GAIN_MIN: f64 = 0.01;

/// Which points (cost, error) are the Pareto front: each is nearer to the truth, by [`GAIN_MIN`], than
/// all that cost no more. A point without both is never on it; of equals, the first is.
pub fn pareto(points: &[Option<(f64, f64)>]) -> Vec<bool> {
    let there = points.iter().enumerate().filter_map(|(i, point)| Some((i, (*point)?)));
    let mut sorted: Vec<(usize, (f64, f64))> = there.collect();
    sorted.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut on_front = vec![false; points.len()];
    let mut least = f64::INFINITY;
    for (index, (_, error)) in sorted {
        if error < least * (1.0 - GAIN_MIN) {
            on_front[index] = true;
            least = error;
        }
    }
    on_front
}

/// The index of the least cost among those that reach; of equals the first.
pub fn cheapest(points: impl Iterator<Item = (f64, bool)>) -> Option<usize> {
    let reaching = points.enumerate().filter(|(_, (_, reaches))| *reaches);
    reaching.min_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b)).map(|(index, _)| index)
}

/// RMSE below which f32 arithmetic, not the step, makes the error (110 dB): the filter `exact` is within
/// 1e-6 of the value range, and the transfer function and sums add to that.
pub const RMSE_FLOOR: f64 = 3e-6;
/// Coarsest step that counts, in voxel edges: beyond, whole cells are jumped over and no law holds.
pub const STEP_MAX: f64 = 1.0;
/// A halved step that leaves more of the error than this is at the floor, whatever its height.
const STALLED: f64 = 0.8;

/// How fast the error falls with the step: as step^order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Order {
    /// The slope of log error over log step, by least squares.
    pub order: f64,
    /// Coarsest and finest parameter that counted.
    pub over: [f64; 2],
    /// Points that counted.
    pub points: usize,
}

/// The order of (parameter, rmse) points, on the part that [`RMSE_FLOOR`] and `most` leave; nothing of
/// fewer than two points.
pub fn order(points: &[(f64, f64)], most: f64) -> Option<Order> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for (step, rmse) in sorted {
        if step > most {
            continue;
        }
        let stalled = kept
            .last()
            .is_some_and(|(before, error)| rmse > error * STALLED.powf((before / step).log2()));
        if rmse.is_nan() || rmse < RMSE_FLOOR || stalled {
            break;
        }
        kept.push((step, rmse));
    }
    let [.., last] = kept[..] else { return None };
    if kept.len() < 2 {
        return None;
    }
    let logs: Vec<(f64, f64)> = kept.iter().map(|(step, rmse)| (step.ln(), rmse.ln())).collect();
    let count = logs.len() as f64;
    let mean = |part: fn(&(f64, f64)) -> f64| logs.iter().map(part).sum::<f64>() / count;
    let (x, y) = (mean(|log| log.0), mean(|log| log.1));
    let over: f64 = logs.iter().map(|log| (log.0 - x) * (log.1 - y)).sum();
    let under: f64 = logs.iter().map(|log| (log.0 - x).powi(2)).sum();
    let order = over / under;
    order.is_finite().then(|| Order { order, over: [kept[0].0, last.0], points: kept.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_unbeaten_points_are_on_the_front() {
        let points = [
            Some((1.0, 0.1)),
            Some((2.0, 0.2)),
            Some((2.0, 0.01)),
            None,
            Some((3.0, 0.01)),
            Some((5.0, 0.000_995)),
            Some((4.0, 0.001)),
            Some((4.0, 0.001)),
            Some((6.0, 0.000_985)),
        ];
        let expected = [true, false, true, false, false, false, true, false, true];
        assert_eq!(pareto(&points), expected, "half a percent is no gain, one and a half is");
        assert_eq!(pareto(&[Some((1.0, 0.0)), Some((2.0, 0.0)), None]), [true, false, false]);
    }

    #[test]
    fn the_cheapest_is_the_first_of_least_cost_that_reaches() {
        let points = [(1.0, false), (5.0, true), (3.0, true), (3.0, true), (0.5, false)];
        assert_eq!(cheapest(points.into_iter()), Some(2));
        assert_eq!(cheapest([(1.0, false)].into_iter()), None);
    }

    #[test]
    fn the_slope_leaves_out_coarse_steps_and_the_floor() {
        let law = |step: f64| (step, 0.01 * step * step);
        let mut points: Vec<_> = [1.0, 0.5, 0.25, 0.125].map(law).to_vec();
        // Coarser than a voxel, at a floor of its own, and below what f32 can.
        points.extend([(4.0, 0.3), (2.0, 0.2), (0.0625, 1.5e-4), (0.03125, 1e-7)]);
        let found = order(&points, STEP_MAX).expect("a slope");
        assert!((found.order - 2.0).abs() < 1e-12, "{found:?}");
        assert_eq!((found.points, found.over), (4, [1.0, 0.125]));
        assert_eq!(order(&points[..1], STEP_MAX), None);
        assert_eq!(order(&[], STEP_MAX), None);
        assert_eq!(order(&[(1.0, f64::NAN), (0.5, 0.1)], STEP_MAX), None);
    }
}
