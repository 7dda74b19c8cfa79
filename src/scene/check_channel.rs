//! A channel as written to one that cannot be wrong.

use toml::Spanned;

use crate::error::Result;
use crate::scene::check::{Check, Located};
use crate::scene::file::ChannelFile;
use crate::scene::{Channel, Place, SAMPLE_EVERY_MAX, TransferFunction, TransferPoint};

impl Check<'_> {
    /// The channel that stands at this position of the volume.
    pub(super) fn channel(
        &self,
        volume: &str,
        position: usize,
        file: Located<ChannelFile>,
    ) -> Result<Channel> {
        let Located { value: file, place } = file;
        let refuse = |place: &Place, why: String| {
            place.error(format!("volume \"{volume}\", channel {position}: {why}"))
        };
        let index = match file.index.map(|index| self.located(index)) {
            None => position as u32,
            Some(index) => u32::try_from(index.value).map_err(|_| {
                let why = format!("index must be 0 to {}, got {}", u32::MAX, index.value);
                refuse(&index.place, why)
            })?,
        };
        let Some(window) = file.window.map(|window| self.located(window)) else {
            return Err(refuse(&place, "window = [lo, hi] is missing".to_owned()));
        };
        let [lo, hi] = window.value;
        let in_f32 = |edge: f64| edge.abs() <= f64::from(f32::MAX);
        if !(in_f32(lo) && in_f32(hi) && lo < hi) {
            return Err(refuse(
                &window.place,
                format!("window must be finite with lo < hi, got [{lo}, {hi}]"),
            ));
        }
        let Some(transfer) = file.transfer else {
            return Err(refuse(&place, "transfer = [points] is missing".to_owned()));
        };
        let list_place = self.place(&transfer.span());
        let mut points = Vec::new();
        let mut places = Vec::new();
        for point in transfer.into_inner() {
            places.push(self.place(&point.span()));
            let point = point.into_inner();
            points.push(TransferPoint {
                at: point.at.into_inner(),
                color: point.color.into_inner(),
                extinction: point.extinction.into_inner(),
            });
        }
        let transfer = TransferFunction::new(points)
            .map_err(|(at, why)| refuse(places.get(at).unwrap_or(&list_place), why))?;
        let level = |level: Option<Spanned<i64>>, name: &str| {
            level
                .map(|level| self.located(level))
                .map(|level| {
                    checked_level(&level)
                        .map_err(|why| refuse(&level.place, format!("{name} {why}")))
                })
                .transpose()
        };
        let level_max_place = file.level_max.as_ref().map(|level| self.place(&level.span()));
        let (level_min, level_max) =
            (level(file.level_min, "level_min")?.unwrap_or(0), level(file.level_max, "level_max")?);
        if let (Some(most), Some(place)) =
            (level_max.filter(|most| *most < level_min), level_max_place)
        {
            return Err(refuse(
                &place,
                format!("level_max must be at least level_min, got {most} and {level_min}"),
            ));
        }
        let sample_every = match file.sample_every.map(|every| self.located(every)) {
            None => 1,
            Some(every) => checked_rate(every.value).ok_or_else(|| {
                let why = format!(
                    "sample_every must be a power of two from 1 to {SAMPLE_EVERY_MAX}, got {}",
                    every.value
                );
                refuse(&every.place, why)
            })?,
        };
        Ok(Channel { index, window: window.value, transfer, level_min, level_max, sample_every })
    }
}

/// Of how many samples a channel takes one.
fn checked_rate(every: i64) -> Option<u32> {
    let every = u32::try_from(every).ok()?;
    (every.is_power_of_two() && every <= SAMPLE_EVERY_MAX).then_some(every)
}

/// A level's number, or what is wrong with it.
pub(super) fn checked_level(level: &Located<i64>) -> std::result::Result<u8, String> {
    let known = u8::try_from(level.value).ok().filter(|level| *level < 32);
    known.ok_or_else(|| format!("must be 0 to 31, got {}", level.value))
}
