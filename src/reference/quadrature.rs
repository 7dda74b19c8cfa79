//! Colour and optical depth of a stretch on which extinction and colours are polynomials.

use crate::reference::cubic::Cubic;

/// Part of the tolerance left to what lies behind a ray that is as good as opaque.
const TAIL_PART: f64 = 0.25;
/// Optical depth of a part beyond which the rules are not even tried.
const DEPTH_MAX: f64 = 3.0;
/// Halvings at most: extinction times length spans fewer powers of two than this.
const HALVINGS_MAX: usize = 256;
/// Parts of one stretch at most: a bound on time where rounding stands in the tolerance's way.
const PARTS_MAX: usize = 10_000;

/// Nodes and weights of the Gauss-Legendre rules on (-1, 1) with 4 and 6 nodes.
const FEW: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];
const MORE: [(f64, f64); 6] = [
    (-0.932_469_514_203_152, 0.171_324_492_379_170_36),
    (-0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (-0.238_619_186_083_196_9, 0.467_913_934_572_691_04),
    (0.238_619_186_083_196_9, 0.467_913_934_572_691_04),
    (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (0.932_469_514_203_152, 0.171_324_492_379_170_36),
];

/// What one channel adds to a stretch; polynomials in the part of the stretch done, 0 to 1.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// Windowed value less the anchor of its transfer function piece.
    pub unit: Cubic,
    /// Extinction per world unit: as a polynomial, so that it is the derivative of the optical depth
    /// to the last digit even where it is a small difference of steep terms.
    pub extinction: Cubic,
    /// Colour at the anchor.
    pub color: [f64; 3],
    /// Its change per unit.
    pub color_slope: [f64; 3],
    /// The voxels' own colour, by which the transfer function's is multiplied.
    pub rgb: Option<[Cubic; 3]>,
}

/// Neumaier's compensated sum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    #[inline]
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// What was added in all.
    pub fn value(self) -> f64 {
        self.sum + self.lost
    }
}

/// A ray's colour and optical depth so far, front to back.
pub struct Progress {
    color: [Sum; 3],
    depth: Sum,
    tolerance: f64,
    color_max: f64,
    depth_opaque: f64,
    /// Ends of the parts of a stretch that are still to be done, nearest last.
    ends: [f64; HALVINGS_MAX],
}

impl Progress {
    /// Nothing yet. No colour of any channel is brighter than `color_max`, nor the background or
    /// alpha than `background_max`; `tolerance` is the greatest absolute error of the whole ray.
    pub fn new(tolerance: f64, color_max: f64, background_max: f64) -> Progress {
        // Colours may be so bright that f64 cannot hold them to the tolerance.
        let tolerance = tolerance.max(1e-14 * color_max);
        Progress {
            color: [Sum::default(); 3],
            depth: Sum::default(),
            tolerance,
            color_max,
            depth_opaque: (color_max.max(background_max) / (TAIL_PART * tolerance)).ln(),
            ends: [1.0; HALVINGS_MAX],
        }
    }

    /// Premultiplied colour.
    pub fn color(&self) -> [f64; 3] {
        self.color.map(Sum::value)
    }

    /// Optical depth.
    pub fn depth(&self) -> f64 {
        self.depth.value()
    }

    /// Whether nothing behind `depth` can change the pixel by its part of the tolerance.
    pub fn is_opaque_behind(&self, depth: f64) -> bool {
        depth >= self.depth_opaque
    }

    /// Adds a stretch of `length` world units.
    pub fn add(&mut self, terms: &[Term], length: f64) {
        let depth_of = Depth::of(terms, length);
        let before = self.depth.value();
        // Parts are accepted from the front; each keeps an error in proportion to its own weight,
        // so that all errors of a ray together are at most its opacity times the tolerance.
        self.ends[0] = 1.0;
        let mut count = 1;
        let mut start = 0.0;
        let mut parts = 0;
        while count > 0 {
            parts += 1;
            let end = self.ends[count - 1];
            let middle = 0.5 * (start + end);
            let depth_start = depth_of.at(start);
            let depth = (depth_of.at(end) - depth_start).max(0.0);
            let may_halve =
                parts < PARTS_MAX && count < HALVINGS_MAX && middle > start && middle < end;
            let color = if depth > DEPTH_MAX && may_halve {
                None
            } else {
                let few = rule(&FEW, terms, &depth_of, start, end);
                let more = rule(&MORE, terms, &depth_of, start, end);
                let difference =
                    (0..3).map(|c| (few[c] - more[c]).abs() * length).fold(0.0, f64::max);
                // Not more than 1 - exp(-depth), and cheaper.
                let weight = depth / (1.0 + depth);
                let allowed = self.tolerance * (0.5 * weight + 1e-6) + 1e-16 * self.color_max;
                (difference <= allowed || !may_halve).then_some(more)
            };
            match color {
                None => {
                    self.ends[count] = middle;
                    count += 1;
                }
                Some(color) => {
                    let transmitted = (-(before + depth_start.max(0.0))).exp() * length;
                    for (sum, value) in self.color.iter_mut().zip(color) {
                        sum.add(transmitted * value);
                    }
                    start = end;
                    count -= 1;
                    if self.is_opaque_behind(before + depth_of.at(start)) {
                        break;
                    }
                }
            }
        }
        self.depth.add(depth_of.at(1.0).max(0.0));
    }
}

/// Optical depth from the start of a stretch: a polynomial of degree four without constant.
struct Depth([f64; 4]);

impl Depth {
    fn of(terms: &[Term], length: f64) -> Depth {
        let mut sums = [0.0; 4];
        for term in terms {
            for (sum, coefficient) in sums.iter_mut().zip(term.extinction.0) {
                *sum += coefficient;
            }
        }
        Depth(std::array::from_fn(|k| sums[k] * length / (k + 1) as f64))
    }

    #[inline]
    fn at(&self, y: f64) -> f64 {
        let [a, b, c, d] = self.0;
        (((d * y + c) * y + b) * y + a) * y
    }
}

/// Integral from `start` to `end` of extinction times colour times what is transmitted from `start`,
/// per length of the whole stretch.
#[inline]
fn rule(nodes: &[(f64, f64)], terms: &[Term], depth: &Depth, start: f64, end: f64) -> [f64; 3] {
    let half = 0.5 * (end - start);
    let depth_start = depth.at(start);
    let mut total = [0.0; 3];
    for &(node, weight) in nodes {
        let y = start + half * (1.0 + node);
        let transmitted = (depth_start - depth.at(y)).min(0.0).exp() * weight;
        for term in terms {
            let unit = term.unit.at(y);
            let emitted = transmitted * term.extinction.at(y);
            for c in 0..3 {
                let mut color = term.color[c] + term.color_slope[c] * unit;
                if let Some(rgb) = &term.rgb {
                    color *= rgb[c].at(y);
                }
                total[c] += emitted * color;
            }
        }
    }
    total.map(|sum| sum * half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rules_are_exact_for_their_degree_and_no_more() {
        let moment = |nodes: &[(f64, f64)], power: i32| -> f64 {
            nodes.iter().map(|(x, w)| w * x.powi(power)).sum()
        };
        for (nodes, degree) in [(&FEW[..], 7), (&MORE[..], 11)] {
            for power in 0..=degree {
                let exact = if power % 2 == 0 { 2.0 / f64::from(power + 1) } else { 0.0 };
                assert!((moment(nodes, power) - exact).abs() < 1e-15, "power {power}");
            }
            let beyond = 2.0 / f64::from(degree + 2);
            assert!((moment(nodes, degree + 1) - beyond).abs() > 1e-4);
        }
    }

    #[test]
    fn a_constant_stretch_is_an_exponential_at_any_depth() {
        for extinction in [1e-12, 1e-3, 0.5, 7.0, 1e4, 1e12, 1e30] {
            let term = Term {
                unit: Cubic([0.0; 4]),
                extinction: Cubic([extinction, 0.0, 0.0, 0.0]),
                color: [1.0, 0.5, 0.0],
                color_slope: [0.0; 3],
                rgb: None,
            };
            let mut progress = Progress::new(1e-13, 1.0, 1.0);
            progress.add(&[term], 2.0);
            let opacity = -(-2.0 * extinction).exp_m1();
            let [r, g, b] = progress.color();
            assert!((r - opacity).abs() < 2e-13 * opacity.max(0.1), "{extinction}: {r}");
            assert!((g - 0.5 * opacity).abs() < 1e-13, "{extinction}: {g}");
            assert_eq!(b, 0.0);
            assert!((progress.depth() / (2.0 * extinction) - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn a_compensated_sum_keeps_what_a_plain_one_loses() {
        let mut sum = Sum::default();
        for value in [1e16, 1.0, -1e16] {
            sum.add(value);
        }
        assert_eq!(sum.value(), 1.0);
    }
}
