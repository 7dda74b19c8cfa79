//! Positions as cell + fraction / 2^32; twin of `shaders/common/fixed_point.glsl`.

/// A position or step in three dimensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fixed3 {
    /// Integer part.
    pub cell: [i32; 3],
    /// In units of 2^-32.
    pub fraction: [u32; 3],
}

/// start + count * delta, exactly, modulo 2^32 cells.
pub fn fixed_advance(start: Fixed3, delta: Fixed3, count: u32) -> Fixed3 {
    let axis = |axis: usize| {
        let whole = |f: Fixed3| (i64::from(f.cell[axis]) << 32) | i64::from(f.fraction[axis]);
        let moved = whole(start).wrapping_add(whole(delta).wrapping_mul(i64::from(count)));
        ((moved >> 32) as i32, moved as u32)
    };
    let moved = [axis(0), axis(1), axis(2)];
    Fixed3 { cell: moved.map(|(cell, _)| cell), fraction: moved.map(|(_, fraction)| fraction) }
}

/// A fraction in 0 to 1; 1 itself can be reached by rounding.
pub fn fixed_fraction(fraction: [u32; 3]) -> [f32; 3] {
    fraction.map(|part| part as f32 * (1.0 / 4_294_967_296.0))
}

/// A signed number, with the magnitude rounded.
pub fn fixed_float(value: Fixed3) -> [f32; 3] {
    std::array::from_fn(|axis| {
        let (cell, fraction) = (value.cell[axis], value.fraction[axis]);
        let negative = cell < 0;
        let (cell, fraction) = if negative {
            ((-cell).wrapping_sub(i32::from(fraction != 0)), fraction.wrapping_neg())
        } else {
            (cell, fraction)
        };
        let magnitude = cell as f32 + fixed_fraction([fraction; 3])[0];
        if negative { -magnitude } else { magnitude }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_negative_steps_keep_their_digits() {
        let value = Fixed3 { cell: [-1, 0, -2], fraction: [u32::MAX, 1 << 31, 1 << 30] };
        assert_eq!(fixed_float(value), [-1.0 / 4_294_967_296.0, 0.5, -1.75]);
    }

    #[test]
    fn advancing_is_exact_over_a_hundred_thousand_steps() {
        let start = Fixed3 { cell: [5; 3], fraction: [7; 3] };
        let delta = Fixed3 { cell: [-1, 0, 3], fraction: [u32::MAX - 2, 1, 0x8000_0000] };
        let far = fixed_advance(start, delta, 100_000);
        let mut walked = start;
        for _ in 0..100_000 {
            walked = fixed_advance(walked, delta, 1);
        }
        assert_eq!(far, walked);
        assert_eq!(far.cell[2], 5 + 350_000);
    }
}
