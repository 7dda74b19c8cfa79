//! How much one submit may hold, so that no driver's watchdog ends a heavy frame: dispatches get shorter, and fewer
//! of them go together, as far as what rays were measured to take asks for it. No byte of a picture depends on it.

use std::sync::{Mutex, PoisonError};

use crate::render::plan::{DISPATCHES_PER_SUBMIT, Plan};

/// Where nothing is said, ms: an eighth of the two seconds after which the strictest watchdog ends a submit.
const SUBMIT_MS: u32 = 250;
/// Blocks of samples of a first dispatch, of which nothing is known.
const BLOCKS_FIRST: u32 = 16;
/// Samples of a tile in one dispatch, at most: a second of the slowest devices that compute at all.
const CAST_SAMPLES_MAX: u64 = 1 << 30;
/// Of what a block took at most, so much is kept from one dispatch to the next: others see less of the volume.
const KEPT: f64 = 0.98;

/// What marches a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Portion {
    /// Blocks of samples of each ray in a dispatch.
    pub blocks: u32,
    /// Dispatches until every ray's end.
    pub dispatches: u32,
    /// Of them in one submit.
    pub per_submit: u32,
}

/// See the module.
#[derive(Debug)]
pub(super) struct SubmitBound {
    /// Nothing: submits may take as long as they take.
    most_ms: Option<f64>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Milliseconds of a block of all rays of a tile, as far as it was measured.
    block_ms: Option<f64>,
    /// Blocks of the dispatches that were submitted last.
    blocks: u32,
}

impl SubmitBound {
    /// As settings say, of which 0 is no bound, else as the kind of device asks for: a processor has no watchdog.
    pub fn new(submit_ms: Option<u32>, kind: &str) -> SubmitBound {
        let most_ms = match submit_ms {
            Some(0) => None,
            Some(ms) => Some(ms.into()),
            None => (kind != "cpu").then(|| SUBMIT_MS.into()),
        };
        SubmitBound { most_ms, state: Mutex::default() }
    }

    /// What may go together now, of what the plan says.
    pub fn portion(&self, plan: &Plan) -> Portion {
        let planned = [plan.blocks_per_dispatch(), plan.march_dispatches()];
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let portion = portion(self.most_ms, state.block_ms, planned);
        state.blocks = portion.blocks;
        portion
    }

    /// The dispatches to come are of so many blocks.
    pub fn submits(&self, blocks: u32) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).blocks = blocks;
    }

    /// A dispatch of the last submit took so long.
    pub fn learn(&self, ms: f64) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if self.most_ms.is_some() && state.blocks > 0 {
            let one = ms / f64::from(state.blocks);
            let known = state.block_ms.unwrap_or(0.0);
            state.block_ms = Some(one.max(KEPT * known));
        }
    }
}

/// Whether all samples of a tile may be taken in one dispatch, which nobody can make shorter once it runs.
pub(super) fn may_cast(submit_ms: Option<u32>, kind: &str, samples: u64) -> bool {
    SubmitBound::new(submit_ms, kind).most_ms.is_none() || samples <= CAST_SAMPLES_MAX
}

fn portion(most_ms: Option<f64>, block_ms: Option<f64>, [blocks, dispatches]: [u32; 2]) -> Portion {
    let whole = Portion { blocks, dispatches, per_submit: DISPATCHES_PER_SUBMIT };
    let Some(most_ms) = most_ms else { return whole };
    let fit = match block_ms {
        None => BLOCKS_FIRST,
        Some(ms) => (most_ms / ms.max(1e-6)).min(1e9) as u32,
    };
    if fit >= blocks {
        return Portion { per_submit: (fit / blocks).clamp(1, DISPATCHES_PER_SUBMIT), ..whole };
    }
    let all = blocks.saturating_mul(dispatches);
    let blocks = fit.max(1);
    Portion { blocks, dispatches: all.div_ceil(blocks), per_submit: 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn portions_shrink_and_grow_with_what_blocks_take() {
        let planned = [100, 12];
        let whole = Portion { blocks: 100, dispatches: 12, per_submit: 8 };
        assert_eq!(portion(None, Some(1e9), planned), whole);
        assert_eq!(portion(Some(250.0), Some(0.01), planned), whole);
        let fewer = Portion { per_submit: 2, ..whole };
        assert_eq!(portion(Some(250.0), Some(1.0), planned), fewer);
        let shorter = Portion { blocks: 25, dispatches: 48, per_submit: 1 };
        assert_eq!(portion(Some(250.0), Some(10.0), planned), shorter);
        let first = Portion { blocks: 16, dispatches: 75, per_submit: 1 };
        assert_eq!(portion(Some(250.0), None, planned), first);
        let least = Portion { blocks: 1, dispatches: 1200, per_submit: 1 };
        assert_eq!(portion(Some(250.0), Some(1e6), planned), least);
    }

    #[test]
    fn the_slowest_counts_and_is_forgotten_slowly() {
        let bound = SubmitBound::new(Some(100), "cpu");
        bound.submits(10);
        bound.learn(100.0);
        bound.learn(1.0);
        let known = bound.state.lock().expect("no panic holds it").block_ms;
        assert_eq!(known, Some(9.8));
        let none = SubmitBound::new(None, "cpu");
        assert!(none.most_ms.is_none() && SubmitBound::new(Some(0), "discrete").most_ms.is_none());
        assert_eq!(SubmitBound::new(None, "discrete").most_ms, Some(250.0));
        assert!(may_cast(None, "cpu", u64::MAX) && may_cast(None, "integrated", 1 << 30));
        assert!(!may_cast(None, "integrated", 1 << 31) && !may_cast(Some(9), "cpu", 1 << 31));
    }
}
