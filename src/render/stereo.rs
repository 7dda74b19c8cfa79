//! Pictures of two eyes as one, for a screen that shows both.

use crate::render::renderer::Picture;

/// How.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StereoLayout {
    /// The left eye's picture on the left.
    SideBySide,
    /// The left eye's picture on top.
    TopBottom,
    /// The left eye's red, the right eye's green and blue: for glasses of red and cyan.
    Anaglyph,
}

impl StereoLayout {
    /// One picture of both, which are of one size.
    ///
    /// # Panics
    /// When their sizes differ: our own bug.
    pub fn joined(self, left: &Picture, right: &Picture) -> Picture {
        assert_eq!(left.size, right.size, "eyes of one screen");
        let [width, height] = left.size;
        let row = |of: &Picture, y: usize| {
            of.pixels[y * width as usize..(y + 1) * width as usize].to_vec()
        };
        match self {
            StereoLayout::SideBySide => Picture {
                size: [2 * width, height],
                pixels: (0..height as usize)
                    .flat_map(|y| [row(left, y), row(right, y)])
                    .flatten()
                    .collect(),
            },
            StereoLayout::TopBottom => Picture {
                size: [width, 2 * height],
                pixels: [&left.pixels[..], &right.pixels].concat(),
            },
            StereoLayout::Anaglyph => {
                let pairs = left.pixels.iter().zip(&right.pixels);
                let pixel = |([red, .., left], [_, green, blue, right]): (&[f32; 4], &[f32; 4])| {
                    [*red, *green, *blue, left.max(*right)]
                };
                Picture { size: left.size, pixels: pairs.map(pixel).collect() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_eyes_are_where_they_should_be() {
        let picture = |first: f32| Picture {
            size: [2, 2],
            pixels: (0..4).map(|at| [first + at as f32; 4]).collect(),
        };
        let (left, right) = (picture(0.0), picture(10.0));
        let reds = |layout: StereoLayout| -> Vec<f32> {
            layout.joined(&left, &right).pixels.iter().map(|pixel| pixel[0]).collect()
        };
        assert_eq!(reds(StereoLayout::SideBySide), [0.0, 1.0, 10.0, 11.0, 2.0, 3.0, 12.0, 13.0]);
        assert_eq!(reds(StereoLayout::TopBottom), [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]);
        let anaglyph = StereoLayout::Anaglyph.joined(&left, &right);
        assert_eq!(anaglyph.pixels[1], [1.0, 11.0, 11.0, 11.0]);
        assert_eq!(anaglyph.size, [2, 2]);
    }
}
