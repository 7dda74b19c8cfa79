//! Colour maps that people know, put over a transfer function's extinction.
//!
//! # Source
//! The maps of matplotlib (viridis, magma, inferno; CC0) and of Nunez, Anderton and Renslow 2018 (cividis), as ten
//! of their sRGB colours each; all four rise evenly in lightness and can be told apart by the colour-blind.

use crate::scene::{TransferFunction, TransferPoint};

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorMap {
    /// Black to white.
    Grey,
    /// Violet, green, yellow.
    Viridis,
    /// Black, purple, cream.
    Magma,
    /// Black, red, yellow.
    Inferno,
    /// Blue to yellow.
    Cividis,
}

/// sRGB, from the least value to the greatest.
type Codes = [u32; 10];

const VIRIDIS: Codes = [
    0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b,
    0xfde725,
];
const MAGMA: Codes = [
    0x000004, 0x180f3d, 0x440f76, 0x721f81, 0x9e2f7f, 0xcd4071, 0xf1605d, 0xfd9668, 0xfeca8d,
    0xfcfdbf,
];
const INFERNO: Codes = [
    0x000004, 0x1b0c41, 0x4a0c6b, 0x781c6d, 0xa52c60, 0xcf4446, 0xed6925, 0xfb9b06, 0xf7d13d,
    0xfcffa4,
];
const CIVIDIS: Codes = [
    0x00204d, 0x00336f, 0x39486b, 0x575d6d, 0x707173, 0x8a8779, 0xa69d75, 0xc4b56c, 0xe4cf5b,
    0xffea46,
];
const GREY: Codes = [
    0x000000, 0x1c1c1c, 0x393939, 0x555555, 0x717171, 0x8e8e8e, 0xaaaaaa, 0xc6c6c6, 0xe3e3e3,
    0xffffff,
];

impl ColorMap {
    /// All of them.
    pub const ALL: [ColorMap; 5] =
        [ColorMap::Grey, ColorMap::Viridis, ColorMap::Magma, ColorMap::Inferno, ColorMap::Cividis];

    /// As people call it.
    pub const fn name(self) -> &'static str {
        match self {
            ColorMap::Grey => "grey",
            ColorMap::Viridis => "viridis",
            ColorMap::Magma => "magma",
            ColorMap::Inferno => "inferno",
            ColorMap::Cividis => "cividis",
        }
    }

    /// The same extinction in this map's colours: the least where something begins to show, the greatest at 1.
    #[must_use]
    pub fn over(self, of: &TransferFunction) -> TransferFunction {
        let points = of.points();
        // The last point before anything shows.
        let shows = points.iter().position(|point| point.extinction > 0.0).unwrap_or(0);
        let begin = points[shows.saturating_sub(1)].at.min(0.999);
        let color = |at: f64| self.color(((at - begin) / (1.0 - begin)).clamp(0.0, 1.0));
        let mut colored: Vec<TransferPoint> =
            points.iter().map(|point| TransferPoint { color: color(point.at), ..*point }).collect();
        for index in 0..STEPS {
            let at = begin + (1.0 - begin) * f64::from(index) / f64::from(STEPS - 1);
            if points.iter().all(|point| point.at != at) {
                colored.push(TransferPoint {
                    at,
                    color: color(at),
                    extinction: of.at(at).extinction,
                });
            }
        }
        // Of two at one place the order stays.
        colored.sort_by(|a, b| a.at.total_cmp(&b.at));
        TransferFunction::new(colored).unwrap_or_else(|_| of.clone())
    }

    /// Linear red, green and blue at a part of the way, 0 to 1.
    pub fn color(self, part: f64) -> [f64; 3] {
        let codes = match self {
            ColorMap::Grey => &GREY,
            ColorMap::Viridis => &VIRIDIS,
            ColorMap::Magma => &MAGMA,
            ColorMap::Inferno => &INFERNO,
            ColorMap::Cividis => &CIVIDIS,
        };
        let along = part.clamp(0.0, 1.0) * f64::from(STEPS - 1);
        let before = (along as usize).min(codes.len() - 2);
        let rest = along - before as f64;
        let parts = |code: u32| [16, 8, 0].map(|shift| linear(code >> shift & 0xff));
        let (a, b) = (parts(codes[before]), parts(codes[before + 1]));
        std::array::from_fn(|channel| a[channel] + rest * (b[channel] - a[channel]))
    }
}

const STEPS: u32 = 10;

/// IEC 61966-2-1.
fn linear(code: u32) -> f64 {
    let encoded = f64::from(code) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at: f64, extinction: f64) -> TransferPoint {
        TransferPoint { at, color: [0.3, 0.2, 0.1], extinction }
    }

    #[test]
    fn extinction_stays_and_colours_are_the_maps() {
        let of = TransferFunction::new(vec![
            point(0.0, 0.0),
            point(0.25, 0.0),
            point(0.4, 2.0),
            point(0.6, 1.0),
            point(0.6, 5.0),
            point(0.9, 7.0),
        ]);
        let of = of.expect("in order");
        for map in ColorMap::ALL {
            let over = map.over(&of);
            for place in 0..=1000 {
                let at = f64::from(place) / 1000.0 + 1e-7;
                let [was, is] = [&of, &over].map(|of| of.at(at).extinction);
                assert!((was - is).abs() < 1e-9, "{map:?} at {at}: {was} {is}");
            }
            let jumps = |of: &TransferFunction| {
                let there = of.points().iter().filter(|point| point.at == 0.6);
                there.map(|point| point.extinction).collect::<Vec<_>>()
            };
            assert_eq!(jumps(&over), [1.0, 5.0]);
            let last = over.points().last().expect("points");
            assert_eq!((last.at, last.color), (1.0, map.color(1.0)));
            let begins = over.points().iter().find(|point| point.at == 0.25).expect("it");
            assert_eq!(begins.color, map.color(0.0));
        }
    }

    #[test]
    fn lightness_rises_from_end_to_end() {
        for map in ColorMap::ALL {
            let lightness = |part: f64| {
                let [r, g, b] = map.color(part);
                0.2126 * r + 0.7152 * g + 0.0722 * b
            };
            let rises =
                |at: i32| lightness(f64::from(at + 1) / 100.0) > lightness(f64::from(at) / 100.0);
            assert!((0..100).all(rises), "{map:?}");
        }
    }
}
