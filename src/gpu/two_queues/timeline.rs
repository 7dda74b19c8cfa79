//! Which submits come before which: the graph of waits, in an order that respects it, with clocks.

use crate::gpu::record::{HostEvent, Record};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::two_queues::fault::{Fault, Where};

/// What is known to have ended.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clock {
    /// Per role: every submit up to this value.
    pub roles: [u64; RoleKind::COUNT],
    /// The host's events before this many records.
    pub host: usize,
}

impl Clock {
    pub fn join(&mut self, other: &Clock) {
        for (own, other) in self.roles.iter_mut().zip(other.roles) {
            *own = (*own).max(other);
        }
        self.host = self.host.max(other.host);
    }

    pub fn knows(&self, point: TimePoint) -> bool {
        self.roles[point.role.index()] >= point.value
    }
}

/// Something that happens, named by the index of its record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moment {
    /// The host does what the record says of it, and submits.
    Host(usize),
    /// The submit's steps run.
    Device(usize),
}

/// The moments of a list of records in an order that respects every wait.
pub(super) struct Timeline<'r> {
    records: &'r [Record],
    /// Per role: the records that submit, in order.
    submits: [Vec<usize>; RoleKind::COUNT],
    moments: Vec<Moment>,
    /// Per record: what is known when its steps begin.
    starts: Vec<Clock>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Visit {
    Not,
    Open,
    Done,
}

impl<'r> Timeline<'r> {
    /// The faults, when some wait never ends.
    pub fn of(records: &'r [Record]) -> Result<Timeline<'r>, Vec<Fault>> {
        let mut timeline = Timeline {
            records,
            submits: Default::default(),
            moments: Vec::with_capacity(2 * records.len()),
            starts: vec![Clock::default(); records.len()],
        };
        let mut faults = Vec::new();
        for (index, record) in records.iter().enumerate().filter(|(_, r)| r.point.value > 0) {
            let submits = &mut timeline.submits[record.role.index()];
            if let Some(first) = submits.last().map(|last| records[*last].point)
                && first.value >= record.point.value
            {
                faults.push(Fault::TimelineBackwards { first, second: record.point });
            }
            submits.push(index);
        }
        for record in records {
            let host = host_waits(record).map(|p| (Where::Host { point: record.point }, p));
            let device = record.waits.iter().map(|p| (Where::Submit { point: record.point }, *p));
            for (waiter, point) in host.chain(device) {
                if point.value > 0 && !timeline.is_signalled(point) {
                    faults.push(Fault::NeverSignalled { waiter, point });
                }
            }
        }
        if faults.is_empty() {
            let mut visits = vec![[Visit::Not; 2]; records.len()];
            for index in 0..records.len() {
                for moment in [Moment::Host(index), Moment::Device(index)] {
                    if let Some(fault) = timeline.order(moment, &mut visits) {
                        return Err(vec![fault]);
                    }
                }
            }
            timeline.set_clocks();
            return Ok(timeline);
        }
        Err(faults)
    }

    pub fn moments(&self) -> &[Moment] {
        &self.moments
    }

    /// What is known when a submit's steps begin.
    pub fn start(&self, index: usize) -> &Clock {
        &self.starts[index]
    }

    /// Roles that submit anything.
    pub fn roles(&self) -> [bool; RoleKind::COUNT] {
        std::array::from_fn(|role| !self.submits[role].is_empty())
    }

    /// What is known once a time point is reached.
    pub fn reached(&self, point: TimePoint) -> Clock {
        let mut clock = self.last_until(point).map_or(Clock::default(), |at| self.starts[at]);
        let own = &mut clock.roles[point.role.index()];
        *own = (*own).max(point.value);
        clock
    }

    fn is_signalled(&self, point: TimePoint) -> bool {
        let mut submits = self.submits[point.role.index()].iter();
        submits.any(|index| self.records[*index].point.value >= point.value)
    }

    /// The submit that reaches a time point, or the last one before it where that one is not listed.
    fn last_until(&self, point: TimePoint) -> Option<usize> {
        let submits = &self.submits[point.role.index()];
        let until = submits.partition_point(|at| self.records[*at].point.value <= point.value);
        until.checked_sub(1).map(|last| submits[last])
    }

    fn needs(&self, moment: Moment) -> Vec<Moment> {
        let signals = |point: TimePoint| self.last_until(point).map(Moment::Device);
        match moment {
            Moment::Host(index) => {
                let before = index.checked_sub(1).map(Moment::Host);
                before
                    .into_iter()
                    .chain(host_waits(&self.records[index]).filter_map(signals))
                    .collect()
            }
            Moment::Device(index) => {
                let record = &self.records[index];
                let submits = &self.submits[record.role.index()];
                let at = submits.partition_point(|other| *other < index);
                let before = at.checked_sub(1).map(|at| Moment::Device(submits[at]));
                let own = std::iter::once(Moment::Host(index)).chain(before);
                own.chain(record.waits.iter().copied().filter_map(signals)).collect()
            }
        }
    }

    /// Puts a moment behind all that it needs; a fault when it needs itself.
    fn order(&mut self, goal: Moment, visits: &mut [[Visit; 2]]) -> Option<Fault> {
        let cell = |moment| match moment {
            Moment::Host(index) => (index, 0),
            Moment::Device(index) => (index, 1),
        };
        // A stack of its own: chains are as long as the list.
        let mut open: Vec<(Moment, Vec<Moment>)> = Vec::new();
        let mut next = Some(goal);
        loop {
            if let Some(moment) = next.take() {
                let (index, kind) = cell(moment);
                match visits[index][kind] {
                    Visit::Done => {}
                    Visit::Open => {
                        let from = open.iter().position(|(other, _)| *other == moment);
                        let cycle = open[from.unwrap_or(0)..].iter().map(|(moment, _)| *moment);
                        let mut points: Vec<_> =
                            cycle.map(|moment| self.records[cell(moment).0].point).collect();
                        points.dedup();
                        return Some(Fault::WaitsInACycle { points });
                    }
                    Visit::Not => {
                        visits[index][kind] = Visit::Open;
                        let mut needs = self.needs(moment);
                        needs.reverse();
                        open.push((moment, needs));
                    }
                }
            }
            let (moment, needs) = open.last_mut()?;
            next = needs.pop();
            if next.is_none() {
                let (index, kind) = cell(*moment);
                visits[index][kind] = Visit::Done;
                self.moments.push(*moment);
                open.pop();
            }
        }
    }

    fn set_clocks(&mut self) {
        let mut host = Clock::default();
        let mut begun = [Clock::default(); RoleKind::COUNT];
        // What the host knew when it submitted each record.
        let mut submitted = vec![Clock::default(); self.records.len()];
        for moment in self.moments.clone() {
            match moment {
                Moment::Host(index) => {
                    for point in host_waits(&self.records[index]) {
                        host.join(&self.reached(point));
                    }
                    host.host = index + 1;
                    submitted[index] = host;
                }
                Moment::Device(index) => {
                    let record = &self.records[index];
                    let mut clock = submitted[index];
                    clock.join(&begun[record.role.index()]);
                    for point in &record.waits {
                        clock.join(&self.reached(*point));
                    }
                    begun[record.role.index()] = clock;
                    self.starts[index] = clock;
                }
            }
        }
    }
}

fn host_waits(record: &Record) -> impl Iterator<Item = TimePoint> {
    record.host.iter().filter_map(|event| match event {
        HostEvent::Waited(point) => Some(*point),
        _ => None,
    })
}
