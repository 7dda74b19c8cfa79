//! What a screen of a wall is given: the seen picture, faded where a neighbour shows the same, turned as the
//! screen hangs.

use crate::render::renderer::Picture;
use crate::scene::Screen;

impl Picture {
    /// The picture as `screen` is given it. Light of two screens that overlap adds up to the picture's: each
    /// fades linearly over the overlap, in linear colour.
    ///
    /// # Panics
    /// When it is not as large as the screen is seen: our own bug.
    #[must_use]
    pub fn on_screen(mut self, screen: &Screen) -> Picture {
        let [own_width, own_height] = screen.size.map(|edge| edge as usize);
        let [width, height] = self.size.map(|edge| edge as usize);
        assert_eq!(width * height, own_width * own_height, "a screen's picture");
        let [left, right, top, bottom] = screen.overlap.map(|edge| edge as usize);
        if screen.overlap != [0; 4] {
            for (at, pixel) in self.pixels.iter_mut().enumerate() {
                let (column, row) = (at % width, at / width);
                let part = ramp(column, width, [left, right]) * ramp(row, height, [top, bottom]);
                if part < 1.0 {
                    *pixel = pixel.map(|component| component * part);
                }
            }
        }
        let seen = |x: usize, y: usize| match screen.quarter_turns {
            0 => (x, y),
            // Its own right is seen as down, its own down as left.
            1 => (width - 1 - y, x),
            2 => (width - 1 - x, height - 1 - y),
            _ => (y, height - 1 - x),
        };
        let own = (0..own_height).flat_map(|y| (0..own_width).map(move |x| seen(x, y)));
        let pixels = own.map(|(column, row)| self.pixels[row * width + column]).collect();
        Picture { size: screen.size, pixels }
    }
}

/// What is left of a pixel's light at `at` of `length`, `begin` and `end` of which a neighbour shows too.
fn ramp(at: usize, length: usize, [begin, end]: [usize; 2]) -> f32 {
    let within = |from_edge: usize, over: usize| match from_edge < over {
        true => (from_edge as f32 + 0.5) / over as f32,
        false => 1.0,
    };
    within(at, begin) * within(length - 1 - at, end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_of_two_screens_adds_up() {
        for at in 0..7 {
            let both = ramp(3 + at, 10, [0, 7]) + ramp(at, 12, [7, 0]);
            assert!((both - 1.0).abs() < 1e-6);
        }
        assert_eq!(ramp(2, 10, [0, 7]), 1.0);
    }
}
