//! Cubic polynomials on the unit interval.

/// `c[0] + c[1] x + c[2] x^2 + c[3] x^3`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic(pub [f64; 4]);

impl Cubic {
    /// The value at x.
    #[inline]
    pub fn at(&self, x: f64) -> f64 {
        let [a, b, c, d] = self.0;
        ((d * x + c) * x + b) * x + a
    }

    #[inline]
    fn slope_at(&self, x: f64) -> f64 {
        let [_, b, c, d] = self.0;
        (3.0 * d * x + 2.0 * c) * x + b
    }

    /// The cubic in y for x = start + width * y.
    #[inline]
    pub fn restricted(&self, start: f64, width: f64) -> Cubic {
        let [_, _, c, d] = self.0;
        let curvature = 3.0 * d * start + c;
        Cubic([
            self.at(start),
            self.slope_at(start) * width,
            curvature * width * width,
            d * width * width * width,
        ])
    }

    /// Cuts (0, 1) into stretches on which the cubic is monotone: their ends, 0 and 1 included.
    fn monotone(&self) -> ([f64; 4], usize) {
        let [_, b, c, d] = self.0;
        let mut ends = [0.0; 4];
        let mut count = 1;
        // Half of the derivative: (3d) x^2 / 2 + c x + b / 2; its roots without cancellation.
        let discriminant = c * c - 3.0 * d * b;
        if discriminant > 0.0 {
            let q = -(c + discriminant.sqrt().copysign(c));
            let (first, second) = (b / q, q / (3.0 * d));
            for x in [first.min(second), first.max(second)] {
                if x > ends[count - 1] && x < 1.0 {
                    ends[count] = x;
                    count += 1;
                }
            }
        }
        ends[count] = 1.0;
        (ends, count)
    }

    /// Appends every x in (0, 1) at which the cubic crosses one of the `levels`, which are sorted.
    pub fn crossings(&self, levels: &[f64], found: &mut Vec<f64>) {
        let (ends, stretches) = self.monotone();
        for stretch in 0..stretches {
            let (start, end) = (ends[stretch], ends[stretch + 1]);
            let (at_start, at_end) = (self.at(start), self.at(end));
            let (least, most) = (at_start.min(at_end), at_start.max(at_end));
            let first = levels.partition_point(|level| *level <= least);
            for &level in levels[first..].iter().take_while(|level| **level < most) {
                let x = self.root_between(level, start, end, at_start < at_end);
                if x > 0.0 && x < 1.0 {
                    found.push(x);
                }
            }
        }
    }

    /// Newton's method, kept inside a bracket that halves whenever Newton would leave it.
    fn root_between(&self, level: f64, mut low: f64, mut high: f64, rising: bool) -> f64 {
        let (at_low, at_high) = (self.at(low), self.at(high));
        let mut x = low + (high - low) * ((level - at_low) / (at_high - at_low));
        for _ in 0..100 {
            if !(x > low && x < high) {
                x = 0.5 * (low + high);
                if x <= low || x >= high {
                    return x;
                }
            }
            let above = self.at(x) - level;
            if above == 0.0 {
                return x;
            }
            if (above > 0.0) == rising {
                high = x;
            } else {
                low = x;
            }
            let next = x - above / self.slope_at(x);
            // Relative to x: crossings very near the front matter when extinction is extreme.
            if (next - x).abs() <= 2e-16 * x {
                return next.clamp(low, high);
            }
            x = next;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crossings(cubic: Cubic, levels: &[f64]) -> Vec<f64> {
        let mut found = Vec::new();
        cubic.crossings(levels, &mut found);
        found.sort_by(f64::total_cmp);
        found
    }

    #[test]
    fn three_roots_of_one_level_are_found() {
        // (x - 0.25) (x - 0.5) (x - 0.75), scaled and lifted to 7.
        let cubic = Cubic([7.0 - 9.375, 68.75, -150.0, 100.0]);
        let found = crossings(cubic, &[7.0]);
        assert_eq!(found.len(), 3);
        for (x, expected) in found.iter().zip([0.25, 0.5, 0.75]) {
            assert!((x - expected).abs() < 1e-14, "{x} is not {expected}");
        }
    }

    #[test]
    fn lower_degrees_and_constants_need_no_cubic_term() {
        assert_eq!(crossings(Cubic([0.0, 1.0, 0.0, 0.0]), &[0.25, 0.5, 2.0]), [0.25, 0.5]);
        assert_eq!(crossings(Cubic([0.5, 0.0, 0.0, 0.0]), &[0.5]), [0.0; 0]);
        let parabola = crossings(Cubic([0.0, 4.0, -4.0, 0.0]), &[0.75]);
        assert_eq!(parabola.len(), 2);
        assert!((parabola[0] - 0.25).abs() < 1e-15 && (parabola[1] - 0.75).abs() < 1e-15);
    }

    #[test]
    fn a_root_next_to_zero_keeps_its_digits() {
        let found = crossings(Cubic([0.0, 1e38, 0.0, 0.0]), &[0.5]);
        assert!((found[0] / 5e-39 - 1.0).abs() < 1e-14, "{found:?}");
    }

    #[test]
    fn a_restriction_is_the_same_function() {
        let cubic = Cubic([0.3, -1.0, 2.5, -0.7]);
        let part = cubic.restricted(0.2, 0.5);
        for y in [0.0, 0.3, 1.0] {
            assert!((part.at(y) - cubic.at(0.2 + 0.5 * y)).abs() < 1e-15);
        }
    }
}
