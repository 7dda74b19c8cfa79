//! From values to colour and extinction: a transfer function as pieces that are linear each.

use crate::scene;
use crate::volume::sanitized;

/// Windowed values beyond this are beyond every transfer function, and their products stay finite.
const UNIT_VALUE_MAX: f64 = 1e60;

/// One stretch of windowed values on which colour and extinction are linear.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Windowed value at which the stretch begins.
    pub start: f64,
    /// Windowed value at which it ends.
    pub end: f64,
    /// Where `extinction` and `color` hold: the start, but finite.
    pub anchor: f64,
    /// Per world unit, at `anchor`.
    pub extinction: f64,
    /// Change of it per unit of windowed value.
    pub extinction_slope: f64,
    /// Linear rgb at `anchor`.
    pub color: [f64; 3],
    /// Change of it per unit of windowed value.
    pub color_slope: [f64; 3],
}

impl Piece {
    /// Whether nothing can be seen of it.
    pub fn is_clear(&self) -> bool {
        self.extinction == 0.0 && self.extinction_slope == 0.0
    }
}

/// Slope, intercept, window and transfer function of one channel.
pub struct Classifier {
    slope: f64,
    intercept: f64,
    window: [f64; 2],
    pieces: Vec<Piece>,
    cuts: Vec<f64>,
    visible: Vec<[f64; 2]>,
    color_max: f64,
}

impl Classifier {
    /// The pieces of a channel's transfer function; neighbours that are clear become one.
    pub fn new(channel: &scene::Channel, slope: f64, intercept: f64) -> Classifier {
        let points = channel.transfer.points();
        let (first, last) = (points[0], points[points.len() - 1]);
        // What holds at the first place also holds below the window and before the first point.
        let at_first = points.iter().rfind(|point| point.at <= first.at).unwrap_or(&first);
        let constant = |start, end, point: &scene::TransferPoint| Piece {
            start,
            end,
            anchor: point.at,
            extinction: point.extinction,
            extinction_slope: 0.0,
            color: point.color,
            color_slope: [0.0; 3],
        };
        let below = if first.at > 0.0 { &first } else { at_first };
        let mut pieces = vec![constant(f64::NEG_INFINITY, first.at, below)];
        for pair in points.windows(2) {
            let width = pair[1].at - pair[0].at;
            // Narrower than any value can resolve: a jump.
            if width > 1e-40 {
                pieces.push(Piece {
                    start: pair[0].at,
                    end: pair[1].at,
                    anchor: pair[0].at,
                    extinction: pair[0].extinction,
                    extinction_slope: (pair[1].extinction - pair[0].extinction) / width,
                    color: pair[0].color,
                    color_slope: std::array::from_fn(|c| {
                        (pair[1].color[c] - pair[0].color[c]) / width
                    }),
                });
            }
        }
        pieces.push(constant(last.at, f64::INFINITY, &last));
        pieces.dedup_by(|next, piece| {
            let both_clear = next.is_clear() && piece.is_clear();
            if both_clear {
                piece.end = next.end;
            }
            both_clear
        });
        Classifier {
            slope,
            intercept,
            window: channel.window,
            cuts: pieces[1..].iter().map(|piece| piece.start).collect(),
            visible: pieces.iter().filter(|p| !p.is_clear()).map(|p| [p.start, p.end]).collect(),
            pieces,
            color_max: points.iter().flat_map(|p| p.color).fold(0.0, f64::max),
        }
    }

    /// Windowed value, not clamped, of a stored one that is not NaN.
    #[inline]
    pub fn unit(&self, stored: f32) -> f64 {
        let scaled = self.slope * f64::from(sanitized(stored)) + self.intercept;
        let [low, high] = self.window;
        ((scaled - low) / (high - low)).clamp(-UNIT_VALUE_MAX, UNIT_VALUE_MAX)
    }

    /// Whether something can be seen between two windowed values, in either order.
    #[inline]
    pub fn shows(&self, [a, b]: [f64; 2]) -> bool {
        let (least, most) = (a.min(b), a.max(b));
        self.visible.iter().any(|[start, end]| least <= *end && most >= *start)
    }

    /// Whether one piece ends and another begins between two windowed values, in either order.
    #[inline]
    pub fn crosses(&self, [a, b]: [f64; 2]) -> bool {
        let (least, most) = (a.min(b), a.max(b));
        self.cuts.iter().any(|cut| least <= *cut && *cut <= most)
    }

    /// The windowed values at which one piece ends and the next begins.
    pub fn cuts(&self) -> &[f64] {
        &self.cuts
    }

    /// The piece of a windowed value; at a jump the later one holds.
    #[inline]
    pub fn piece(&self, unit: f64) -> &Piece {
        &self.pieces[self.cuts.partition_point(|cut| *cut <= unit)]
    }

    /// The brightest component of any colour.
    pub fn color_max(&self) -> f64 {
        self.color_max
    }
}
