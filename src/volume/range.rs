//! Least and greatest value of some voxels.

/// A closed range of stored values. f32 holds every u8, u16, i16 and f32 exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// The least value.
    pub least: f32,
    /// The greatest value.
    pub greatest: f32,
}

impl ValueRange {
    /// The range of no value at all; `least` is above `greatest`.
    pub const EMPTY: ValueRange = ValueRange { least: f32::INFINITY, greatest: f32::NEG_INFINITY };

    /// The range of one value.
    pub const fn of(value: f32) -> ValueRange {
        ValueRange { least: value, greatest: value }
    }

    /// The range of some values, NaN left out.
    pub fn over(values: impl IntoIterator<Item = f32>) -> ValueRange {
        values.into_iter().fold(ValueRange::EMPTY, |range, value| range.with(value))
    }

    /// This range widened to hold `value`; NaN changes nothing.
    #[must_use]
    pub fn with(self, value: f32) -> ValueRange {
        ValueRange {
            least: if value < self.least { value } else { self.least },
            greatest: if value > self.greatest { value } else { self.greatest },
        }
    }

    /// The smallest range that holds both.
    #[must_use]
    pub fn union(self, other: ValueRange) -> ValueRange {
        ValueRange {
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
        }
    }

    /// Whether no value was seen.
    pub fn is_empty(self) -> bool {
        self.least > self.greatest
    }
}
