//! Conflicting uses of one resource without an order: on one role by barriers, else by time points.

use std::collections::HashMap;
use std::ops::Range;

use ash::vk;

use crate::gpu::access::{Access, Barrier, WRITES};
use crate::gpu::record::{HostEvent, Record, SlotEvent, StepRecord};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::two_queues::fault::{Fault, Where};
use crate::gpu::two_queues::timeline::{Clock, Timeline};

/// Uses that a later one may still conflict with, by resource.
pub(super) struct Hazards<'t> {
    timeline: &'t Timeline<'t>,
    uses: HashMap<&'static str, Vec<Use>>,
    host: Clock,
    /// Per role: what its last submit knew.
    begun: [Clock; RoleKind::COUNT],
    pub faults: Vec<Fault>,
}

/// Which part of a resource.
#[derive(Clone, Debug, PartialEq)]
enum Part {
    All,
    Bytes(Vec<Range<u64>>),
    Slots(Vec<u32>),
}

#[derive(Clone, Copy, PartialEq)]
enum Agent {
    Device {
        point: TimePoint,
        access: Access,
    },
    /// Index of the record before which it acts.
    Host(usize),
}

struct Use {
    agent: Agent,
    at: Where,
    part: Part,
    writes: bool,
    /// Stages of its role that barriers order after it.
    reached: vk::PipelineStageFlags2,
    /// Accesses that see what it wrote, once any barrier has made that available.
    visible: Option<vk::AccessFlags2>,
}

impl<'t> Hazards<'t> {
    pub fn new(timeline: &'t Timeline<'t>) -> Hazards<'t> {
        Hazards {
            timeline,
            uses: HashMap::new(),
            host: Clock::default(),
            begun: Default::default(),
            faults: Vec::new(),
        }
    }

    /// What the host does before a submit.
    pub fn host(&mut self, index: usize, record: &Record) {
        self.host.host = index + 1;
        for event in &record.host {
            let (buffer, range, writes) = match event {
                HostEvent::Waited(point) => {
                    self.host.join(&self.timeline.reached(*point));
                    continue;
                }
                HostEvent::Wrote { buffer, range } => (*buffer, range, true),
                HostEvent::Read { buffer, range } => (*buffer, range, false),
            };
            let at = Where::Host { point: record.point };
            let part = Part::Bytes(vec![range.clone()]);
            self.add(buffer, Use::new(Agent::Host(index), at, part, writes), self.host);
        }
    }

    /// A step's barriers, then its uses.
    pub fn step(&mut self, clock: &Clock, record: &Record, step: &StepRecord) {
        for (name, barrier) in &step.barriers {
            for earlier in self.uses.get_mut(name).into_iter().flatten() {
                earlier.pass(record.role, barrier);
            }
        }
        let at = Where::step(record, step);
        let mut added = Vec::new();
        for (name, access) in &step.accesses {
            let part = part_of(step, name, *access);
            let agent = Agent::Device { point: record.point, access: *access };
            let this = Use::new(agent, at, part, access.writes());
            self.find_conflict(name, &this, clock);
            // What the host reads, it says itself; the step is but a barrier.
            if *access != Access::HostRead {
                added.push((*name, this));
            }
        }
        // Only now: a step does not conflict with itself.
        for (name, this) in added {
            self.keep(name, this, clock);
        }
    }

    /// Forgets what every role and the host know to have ended.
    pub fn forget_settled(&mut self, role: RoleKind, clock: &Clock) {
        self.begun[role.index()] = *clock;
        let mut known = self.host;
        for (begun, _) in self.begun.iter().zip(self.timeline.roles()).filter(|(_, used)| *used) {
            for (least, value) in known.roles.iter_mut().zip(begun.roles) {
                *least = (*least).min(value);
            }
            known.host = known.host.min(begun.host);
        }
        for uses in self.uses.values_mut() {
            uses.retain(|earlier| !earlier.known(&known));
        }
    }

    fn add(&mut self, name: &'static str, this: Use, clock: Clock) {
        self.find_conflict(name, &this, &clock);
        self.keep(name, this, &clock);
    }

    fn find_conflict(&mut self, name: &'static str, this: &Use, clock: &Clock) {
        let uses = self.uses.entry(name).or_default();
        let conflict = uses.iter().find(|earlier| {
            (earlier.writes || this.writes)
                && earlier.part.meets(&this.part)
                && !earlier.before(this, clock)
        });
        if let Some(earlier) = conflict {
            self.faults.push(fault(name, earlier, this));
        }
    }

    fn keep(&mut self, name: &'static str, this: Use, clock: &Clock) {
        let uses = self.uses.entry(name).or_default();
        uses.retain(|earlier| {
            let settled = this.writes && this.part.holds(&earlier.part);
            let repeated = !earlier.writes && earlier.same_kind(&this);
            !(repeated || settled && earlier.before(&this, clock))
        });
        uses.push(this);
    }
}

impl Use {
    fn new(agent: Agent, at: Where, part: Part, writes: bool) -> Use {
        let reached = vk::PipelineStageFlags2::NONE;
        Use { agent, at, part, writes, reached, visible: None }
    }

    /// A barrier of a role on this resource, after this use.
    fn pass(&mut self, role: RoleKind, barrier: &Barrier) {
        let Agent::Device { point, access } = self.agent else { return };
        let (stages, accesses) = barrier.before;
        let own = stages.intersects(access.stage());
        if point.role != role || barrier.discard || !(own || stages.intersects(self.reached)) {
            return;
        }
        self.reached |= barrier.after.0;
        // Made available by its own accesses; once that, a chain of barriers shows it to more.
        if self.visible.is_some() || own && accesses.intersects(access.mask() & WRITES) {
            self.visible = Some(self.visible.unwrap_or_default() | barrier.after.1);
        }
    }

    fn known(&self, clock: &Clock) -> bool {
        match self.agent {
            Agent::Device { point, .. } => clock.knows(point),
            Agent::Host(index) => clock.host > index,
        }
    }

    fn before(&self, later: &Use, clock: &Clock) -> bool {
        if self.known(clock) {
            return true;
        }
        match (self.agent, later.agent) {
            (Agent::Device { point, .. }, Agent::Device { point: later, access })
                if point.role == later.role =>
            {
                let seen = self.visible.is_some_and(|seen| seen.contains(access.mask()));
                self.reached.contains(access.stage()) && (!self.writes || seen)
            }
            _ => false,
        }
    }

    /// A read that stands for this one in all that follows.
    fn same_kind(&self, later: &Use) -> bool {
        let same_agent = match (self.agent, later.agent) {
            (Agent::Host(_), Agent::Host(_)) => true,
            (
                Agent::Device { point, access },
                Agent::Device { point: later, access: later_access },
            ) => point.role == later.role && access == later_access,
            _ => false,
        };
        same_agent && !later.writes && later.part.holds(&self.part)
    }
}

impl Part {
    fn meets(&self, other: &Part) -> bool {
        match (self, other) {
            (Part::Bytes(a), Part::Bytes(b)) => {
                a.iter().any(|a| b.iter().any(|b| a.start < b.end && b.start < a.end))
            }
            (Part::Slots(_), Part::Slots(_)) => self.shared_slot(other).is_some(),
            _ => true,
        }
    }

    fn holds(&self, other: &Part) -> bool {
        match (self, other) {
            (Part::All, _) => true,
            (Part::Bytes(a), Part::Bytes(b)) => {
                b.iter().all(|b| a.iter().any(|a| a.start <= b.start && b.end <= a.end))
            }
            (Part::Slots(a), Part::Slots(b)) => b.iter().all(|slot| a.binary_search(slot).is_ok()),
            _ => false,
        }
    }

    fn shared_slot(&self, other: &Part) -> Option<u32> {
        match (self, other) {
            (Part::Slots(a), Part::Slots(b)) => {
                a.iter().copied().find(|slot| b.binary_search(slot).is_ok())
            }
            _ => None,
        }
    }
}

fn part_of(step: &StepRecord, name: &str, access: Access) -> Part {
    // Setting a layout touches all of an image.
    let fresh = step.barriers.iter().any(|(of, barrier)| *of == name && barrier.discard);
    if step.by_slot.contains(&name) && !fresh {
        let wanted = |event: SlotEvent| match event {
            SlotEvent::CopiedInto | SlotEvent::Placed => access.writes(),
            SlotEvent::MayRead => !access.writes(),
            SlotEvent::Granted | SlotEvent::Published => false,
        };
        let of_access = step.slots.iter().filter(|(event, _)| wanted(*event));
        let mut slots: Vec<u32> = of_access.map(|(_, slot)| *slot).collect();
        slots.sort_unstable();
        return Part::Slots(slots);
    }
    let of_access = step.regions.iter().filter(|(of, _, how)| *of == name && *how == access);
    let ranges: Vec<_> = of_access.map(|(_, range, _)| range.clone()).collect();
    if ranges.is_empty() { Part::All } else { Part::Bytes(ranges) }
}

fn fault(resource: &'static str, earlier: &Use, this: &Use) -> Fault {
    let device_access = |used: &Use| match used.agent {
        Agent::Device { access, .. } => Some(access),
        Agent::Host(_) => None,
    };
    if let Some(slot) = earlier.part.shared_slot(&this.part) {
        let (first, second) = (earlier.at, this.at);
        return match (earlier.writes, this.writes) {
            (true, true) => Fault::WrittenTwice { slot, first, second },
            (true, false) => Fault::WrittenWhileRead { slot, write: first, read: second },
            (false, _) => Fault::WrittenWhileRead { slot, write: second, read: first },
        };
    }
    match (device_access(earlier), device_access(this)) {
        (Some(first), Some(second)) => {
            let (first, second) = ((earlier.at, first), (this.at, second));
            Fault::Unordered { resource, first, second }
        }
        (device, _) => {
            let (host, device) = if device.is_some() { (this, earlier) } else { (earlier, this) };
            let range = match &host.part {
                Part::Bytes(ranges) => ranges[0].clone(),
                _ => 0..u64::MAX,
            };
            let (buffer, host_at, device) = (resource, host.at, device.at);
            match host.writes {
                true => Fault::OverwrittenByHost { buffer, range, host: host_at, device },
                false => Fault::ReadByHostEarly { buffer, range, host: host_at, device },
            }
        }
    }
}
