//! Who looks at a picture while it is refined, round by round, and what is told.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::render::paging::paced_rounds::{Pace, RoundPace};
use crate::render::paging::rounds::Rounds;
use crate::render::paging::slot_map::SlotBrick;
use crate::render::renderer::Picture;
use crate::residency::{OfAtlas, Report};

/// A whole picture while it is refined by substitution.
pub struct RoundPicture {
    /// Number of the round, from 1.
    pub round: u64,
    /// Milliseconds on the wall from the view's beginning to the round's end.
    pub ms: f64,
    /// Bricks copied to the device before this round.
    pub bricks_uploaded: u64,
    /// How the cache stands.
    pub cache: RoundCache,
    /// How rounds keep to their target, where they have one, before this.
    pub pace: Option<RoundPace>,
    /// What the round gave.
    pub picture: Picture,
}

/// The cache after a round. Counts are of the view so far, unless they say another thing.
#[derive(Clone, Debug, Default)]
pub struct RoundCache {
    /// Bricks in slots that rays of this round went through for the first time in the view.
    pub touched: u64,
    /// Bricks that rays of this round asked for in vain.
    pub missed: u64,
    /// Of them, without a slot yet.
    pub wanted: u64,
    /// Bricks that have a slot and have not come.
    pub pending: u64,
    /// Bricks that the source does not have, of all that were looked at.
    pub absent: u64,
    /// Bricks that show nothing.
    pub hidden: u64,
    /// Bricks of one value.
    pub constant: u64,
    /// Bricks that could not be read, in the epoch.
    pub failed: u64,
    /// Texel bytes copied.
    pub bytes_uploaded: u64,
    /// Bytes of reports read back, of this round.
    pub bytes_read_back: u64,
    /// Slots of each atlas, one after the other.
    pub slots_of_atlas: Vec<u32>,
    /// What they hold, as far as any was ever filled.
    pub slots: Vec<Option<SlotBrick>>,
    /// Number of this round in which slots count.
    pub round: u32,
}

/// Who looks at the pictures of rounds, and how long looking took.
pub struct Watch<'w> {
    begun: Instant,
    watching: Duration,
    tell: &'w mut dyn FnMut(RoundPicture) -> ControlFlow<()>,
    /// There is no picture then but that of the last round.
    pub broken_off: bool,
}

impl<'w> Watch<'w> {
    /// From now on.
    pub fn new(tell: &'w mut dyn FnMut(RoundPicture) -> ControlFlow<()>) -> Watch<'w> {
        Watch { begun: Instant::now(), watching: Duration::ZERO, tell, broken_off: false }
    }

    fn ms(&self) -> f64 {
        self.begun.elapsed().saturating_sub(self.watching).as_secs_f64() * 1e3
    }
}

impl Rounds<'_, '_> {
    /// How the cache stands after a round.
    fn cache(&self, report: &Report) -> RoundCache {
        let host = &self.paged.host;
        let sum =
            |of: &dyn Fn(&OfAtlas) -> u32| report.atlases.iter().map(|a| u64::from(of(a))).sum();
        let atlases = self.paged.plan.residency.atlases.iter();
        let (slots, round) = host.slots.now();
        RoundCache {
            touched: sum(&|atlas| atlas.answer.touched),
            missed: sum(&|atlas| atlas.answer.wished),
            wanted: host.wanted().len() as u64,
            pending: host.bound_count() as u64,
            absent: host.counts.absent,
            hidden: host.counts.hidden,
            constant: host.counts.constant,
            failed: host.failures().len() as u64,
            bytes_uploaded: host.counts.uploaded_bytes,
            bytes_read_back: report.bytes,
            slots_of_atlas: atlases.map(|atlas| atlas.layout.slot_count()).collect(),
            slots,
            round,
        }
    }

    /// The picture as the last round left it, where one tile holds it: size and pixels.
    pub(super) fn resolved(&mut self) -> Result<([u32; 2], Vec<[f32; 4]>)> {
        let submitted = self.renderer.submit_resolve(self.paged, self.tile)?;
        self.ended(submitted)?;
        let size = self.renderer.plan.pixels[self.tile.view as usize].size;
        let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
        self.renderer.collect(self.tile, &mut pixels)?;
        Ok((size, pixels))
    }

    /// Hands a round's picture to who watches. What that takes is no part of the loop's time.
    pub(super) fn show_picture(&mut self, report: &Report) -> Result<ControlFlow<()>> {
        let ms = match &self.watch {
            Some(watch) => watch.ms(),
            None => return Ok(ControlFlow::Continue(())),
        };
        let begun = Instant::now();
        let (size, pixels) = self.resolved()?;
        let mut flow = ControlFlow::Continue(());
        let cache = self.cache(report);
        let pace = self.paged.pace.as_ref().map(Pace::told);
        if let Some(watch) = &mut self.watch {
            let (round, uploaded) = (self.statistics.rounds, self.paged.host.counts.uploaded);
            let picture = Picture { size, pixels };
            flow = (watch.tell)(RoundPicture {
                round,
                ms,
                bricks_uploaded: uploaded,
                cache,
                pace,
                picture,
            });
            watch.watching += begun.elapsed();
            watch.broken_off = flow.is_break();
        }
        Ok(flow)
    }
}
