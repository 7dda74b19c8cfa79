//! Resources that belong to one role at a time: who uses them must have them.

use std::collections::HashMap;

use crate::gpu::access::Access;
use crate::gpu::record::{Record, StepKind, StepRecord};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::two_queues::fault::{Fault, Where};
use crate::gpu::two_queues::timeline::Clock;

/// Whose each resource is, moment by moment.
#[derive(Default)]
pub(super) struct Ownership {
    states: HashMap<&'static str, State>,
    pub faults: Vec<Fault>,
}

#[derive(Clone, Copy)]
enum State {
    /// Since a step.
    Owned(RoleKind, Where),
    /// Given to a role by a step of a submit.
    Released(RoleKind, TimePoint, Where),
}

impl State {
    fn at(self) -> Where {
        match self {
            State::Owned(_, at) | State::Released(_, _, at) => at,
        }
    }
}

impl Ownership {
    /// A step of a submit that begins with `clock`.
    pub fn step(&mut self, clock: &Clock, record: &Record, step: &StepRecord) {
        let at = Where::step(record, step);
        match step.kind {
            StepKind::Release { buffer, to } => {
                self.must_own(buffer, record.role, at);
                self.states.insert(buffer, State::Released(to, record.point, at));
            }
            StepKind::Acquire { buffer, .. } => {
                let state = self.states.get(buffer).copied();
                let released = matches!(state, Some(State::Released(to, point, _))
                    if to == record.role && clock.knows(point));
                if !released {
                    let release = state.map(State::at);
                    self.faults.push(Fault::AcquiredUnreleased {
                        resource: buffer,
                        acquire: at,
                        release,
                    });
                }
                self.states.insert(buffer, State::Owned(record.role, at));
            }
            _ => {
                for name in &step.handed_over {
                    // Copies into it ask for nothing that it held.
                    let needs =
                        |(of, access): &(&str, Access)| of == name && *access != Access::CopyWrite;
                    if step.accesses.iter().any(needs) {
                        self.must_own(name, record.role, at);
                    }
                    self.states.insert(*name, State::Owned(record.role, at));
                }
            }
        }
    }

    fn must_own(&mut self, name: &'static str, role: RoleKind, at: Where) {
        let state = self.states.get(name).copied();
        if !matches!(state, Some(State::Owned(owner, _)) if owner == role) {
            let last = state.map(State::at);
            self.faults.push(Fault::UsedUnowned { resource: name, used: at, last });
        }
    }
}
