//! The trace while it is filled.

use std::collections::{HashSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use crate::gpu::{Gpu, RoleKind, SubmitTimes};
use crate::trace::clock::signed_ns;
use crate::trace::event::{BrickStep, Counter, Details, Event, Span, Track};
#[cfg(feature = "tracy")]
use crate::trace::tracy;
use crate::trace::{ClockReport, QueueClock};
use crate::volume::BrickId;

/// Both roles, in the order of [`Filled::clocks`].
pub(super) const ROLES: [RoleKind; 2] = [RoleKind::Render, RoleKind::Transfer];
/// Spans of queues are told later than they end, by no more than so many others.
const LATEST_AMONG: usize = 256;
/// Submits of copies that are announced and not measured: one for each staging half, and room.
const ANNOUNCED_MAX: usize = 64;

/// What a trace may use, and whose it is.
#[derive(Clone, Debug)]
pub struct TraceOptions {
    /// Events kept at most.
    pub events_max: usize,
    /// Whether the device is asked for its time, where it tells; else it is estimated.
    pub calibrate: bool,
    /// What is drawn, for the file.
    pub scene: String,
    /// Of too many events the latest are kept, not the first: a flight recorder.
    pub keep_latest: bool,
}

impl Default for TraceOptions {
    fn default() -> TraceOptions {
        TraceOptions {
            events_max: 1_000_000,
            calibrate: true,
            scene: String::new(),
            keep_latest: false,
        }
    }
}

/// What happened when. Threads may share it.
pub struct Trace {
    pub(super) gpu: Arc<Gpu>,
    pub(super) options: TraceOptions,
    start: Instant,
    filled: Mutex<Filled>,
}

/// How much a trace recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceSize {
    /// Events, those that did not fit included.
    pub events: u64,
    /// How often it was told something, also where nothing had changed: a place in the code tells it at least once
    /// where there is a trace, but for those that find nothing to tell, which are fewer than what one report tells.
    pub told: u64,
    /// Memory of one event.
    pub event_bytes: u64,
}

#[derive(Default)]
pub(super) struct Filled {
    pub events: VecDeque<Event>,
    /// Events that did not fit.
    pub dropped: u64,
    /// How often somebody looked in, to tell something or to read.
    pub told: u64,
    pub rounds: u64,
    pub clocks: [QueueClock; ROLES.len()],
    /// Last value of each counter.
    pub counted: [Option<u64>; Counter::ALL.len()],
    /// Loader threads, whether or not they did anything.
    pub loaders: u32,
    /// Reads that had not come back when that was last told.
    pub reads_under_way: u64,
    /// Bricks that were asked for and are not there.
    wanted: HashSet<BrickId>,
    /// Copies by their submit: bricks and bytes of each step.
    announced: Vec<(u64, Vec<(u64, u64)>)>,
}

/// Records a span from its making until it is dropped.
#[must_use = "a span ends when its guard is dropped"]
pub struct Guard {
    trace: Arc<Trace>,
    name: &'static str,
    begin: Instant,
    details: Details,
    #[cfg(feature = "tracy")]
    _zone: Option<tracy::Zone>,
}

impl Drop for Guard {
    fn drop(&mut self) {
        #[cfg(feature = "tracy")]
        if let Details::Round(_) = self.details {
            tracy::frame_end();
        }
        self.trace.span(Track::Host, self.name, [self.begin, Instant::now()], self.details);
    }
}

impl Trace {
    /// An empty one that begins now.
    pub fn new(gpu: &Arc<Gpu>, options: TraceOptions) -> Arc<Trace> {
        let (gpu, start) = (gpu.clone(), Instant::now());
        Arc::new(Trace { gpu, options, start, filled: Mutex::default() })
    }

    /// Begins a span of the host, which ends when the guard is dropped.
    pub fn begin(self: &Arc<Trace>, name: &'static str, details: Details) -> Guard {
        Guard {
            trace: self.clone(),
            name,
            begin: Instant::now(),
            details,
            #[cfg(feature = "tracy")]
            _zone: tracy::zone(name),
        }
    }

    /// Begins a round, which ends when the guard is dropped.
    pub fn begin_round(self: &Arc<Trace>) -> Guard {
        let mut filled = self.filled();
        filled.rounds += 1;
        let details = Details::Round(filled.rounds);
        drop(filled);
        self.begin("round", details)
    }

    /// Records a span from one moment to another.
    pub fn span(&self, track: Track, name: &'static str, times: [Instant; 2], details: Details) {
        let [begin_ns, end_ns] = times.map(|time| signed_ns(self.start, time) as i64);
        let span = Span { track, name, begin_ns, end_ns, details };
        self.push(&mut self.filled(), Event::Span(span));
    }

    /// Records a counter's value of now; nothing where it has not changed.
    pub fn count(&self, counter: Counter, value: u64) {
        let mut filled = self.filled();
        if filled.counted[counter as usize].replace(value) != Some(value) {
            let at_ns = self.now_ns();
            self.push(&mut filled, Event::Count { counter, at_ns, value });
            #[cfg(feature = "tracy")]
            tracy::plot(counter, value);
        }
    }

    /// Records bricks that rays ask for; of each, the first time.
    pub fn wanted(&self, bricks: impl Iterator<Item = BrickId>) {
        let mut filled = self.filled();
        let at_ns = self.now_ns();
        // Those that turn out to show nothing are never published.
        if filled.wanted.len() >= self.options.events_max {
            filled.wanted.clear();
        }
        for id in bricks {
            if filled.wanted.insert(id) {
                self.push(&mut filled, Event::Brick { id, step: BrickStep::Wanted, at_ns });
            }
        }
    }

    /// Records what happens to bricks now.
    pub fn bricks(&self, bricks: impl Iterator<Item = (BrickId, BrickStep)>) {
        let mut filled = self.filled();
        let at_ns = self.now_ns();
        for (id, step) in bricks {
            if matches!(step, BrickStep::Published(_)) {
                filled.wanted.remove(&id);
            }
            self.push(&mut filled, Event::Brick { id, step, at_ns });
        }
    }

    /// Says what the steps of a submit of copies will copy: bricks and bytes of each.
    pub fn announce_copies(&self, time_point: u64, steps: Vec<(u64, u64)>) {
        if self.gpu.has_timestamps(RoleKind::Transfer) {
            let announced = &mut self.filled().announced;
            if announced.len() == ANNOUNCED_MAX {
                announced.remove(0);
            }
            announced.push((time_point, steps));
        }
    }

    /// Records the steps of a submit that has ended, on its role's queue.
    pub fn steps(&self, times: &SubmitTimes) {
        let mut filled = self.filled();
        let clock = &mut filled.clocks[queue_index(times.point.role)];
        clock.observe(times, || self.options.calibrate.then(|| self.gpu.calibrate())?);
        let clock = clock.clone();
        let time_point = times.point.value;
        let is_announced = |(value, _): &(u64, _)| *value == time_point;
        let copies = match times.point.role {
            RoleKind::Transfer => filled.announced.iter().position(is_announced),
            RoleKind::Render => None,
        };
        let copies = copies.map(|index| filled.announced.remove(index).1);
        let round = filled.rounds;
        for (index, step) in times.steps.iter().enumerate() {
            let ns = |ticks| clock.ns_of(&times.clock, ticks, self.start).map(|ns| ns as i64);
            let (Some(begin_ns), Some(end_ns)) = (ns(step.begin), ns(step.end)) else { continue };
            let details = match (times.point.role, &copies) {
                (RoleKind::Render, _) => Details::Step { time_point, round },
                (RoleKind::Transfer, copies) => {
                    let of_step = copies.as_ref().and_then(|copies| copies.get(index));
                    let (bricks, bytes) = of_step.copied().unwrap_or((0, 0));
                    Details::Copy { time_point, bricks, bytes }
                }
            };
            let track = Track::Queue(times.point.role);
            let span = Span { track, name: step.label, begin_ns, end_ns, details };
            self.push(&mut filled, Event::Span(span));
        }
    }

    /// Counts events that nobody could hand over.
    pub fn count_dropped(&self, events: u64) {
        self.filled().dropped += events;
    }

    /// Says how many loader threads there are.
    pub fn loaders(&self, loaders: usize) {
        let known = &mut self.filled().loaders;
        *known = (*known).max(u32::try_from(loaders).unwrap_or(u32::MAX));
    }

    /// Says how many reads have not come back.
    pub fn reads_under_way(&self, reads: u64) {
        self.filled().reads_under_way = reads;
    }

    /// How device times came on the host's clock; nothing where no step of the role was measured.
    pub fn clock(&self, role: RoleKind) -> Option<ClockReport> {
        self.filled().clocks[queue_index(role)].report()
    }

    /// What was recorded so far.
    pub fn size(&self) -> TraceSize {
        let filled = self.filled();
        let events = filled.events.len() as u64;
        TraceSize {
            events: events + filled.dropped,
            told: filled.told,
            event_bytes: size_of::<Event>() as u64,
        }
    }

    /// Spans that ended within `window_ns` before the latest end, if they are kept.
    pub fn latest_spans(&self, window_ns: i64) -> Vec<Span> {
        let filled = self.filled();
        let spans = || filled.events.iter().rev().filter_map(Event::span);
        let Some(latest) = spans().take(LATEST_AMONG).map(|span| span.end_ns).max() else {
            return Vec::new();
        };
        // Spans come about when they end: beyond the first few too early ones there is none left.
        let early = |span: &&Span| span.end_ns < latest - window_ns;
        let mut too_early = 0;
        let recent = spans().take_while(|span| {
            too_early += usize::from(early(span));
            too_early < LATEST_AMONG
        });
        recent.filter(|span| !early(span)).copied().collect()
    }

    fn now_ns(&self) -> i64 {
        signed_ns(self.start, Instant::now()) as i64
    }

    pub(super) fn filled(&self) -> MutexGuard<'_, Filled> {
        let mut filled = self.filled.lock().unwrap_or_else(PoisonError::into_inner);
        filled.told += 1;
        filled
    }

    fn push(&self, filled: &mut Filled, event: Event) {
        if filled.events.len() == self.options.events_max {
            filled.dropped += 1;
            if !self.options.keep_latest || filled.events.pop_front().is_none() {
                return;
            }
        }
        filled.events.push_back(event);
    }
}

pub(super) fn queue_index(role: RoleKind) -> usize {
    match role {
        RoleKind::Render => 0,
        RoleKind::Transfer => 1,
    }
}
