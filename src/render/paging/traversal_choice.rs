//! Which of two traversals draws, where both give the same bytes: the one whose marching the device's clock
//! says is cheaper.
//!
//! Only frames of one round are compared: all that they need was there, so they do the same work. The paper's
//! gain shrinks on dense data, and where nothing is hidden there is none.
//!
//! # Source
//! docs/OCTREE.md; residency-octree-2023 section 8 for the cost on dense data.

use std::collections::HashMap;

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The page table.
    PageTable,
    /// The residency octree.
    Octree,
}

/// With less of the leaves hidden the page table is taken untimed.
const HIDDEN_SHARE_MIN: f64 = 0.05;
/// Frames of each way that are timed before one is preferred; the quickest counts.
const TIMED_FRAMES: usize = 2;
/// The other way has to be quicker by this part to take over.
const HYSTERESIS: f64 = 0.05;
/// So often the way that is not preferred is timed again.
const TIMED_AGAIN_AFTER: u32 = 64;

/// See the module.
#[derive(Clone, Debug, Default)]
pub struct TraversalChoice {
    hidden_share: f64,
    of_view: HashMap<u32, Timed>,
}

/// What is known of one view.
#[derive(Clone, Debug, Default)]
struct Timed {
    /// Of the page table, then of the octree.
    ms: [Vec<f64>; 2],
    prefers: Option<Way>,
    frames: u32,
}

impl TraversalChoice {
    /// What draws a view's next round.
    pub fn way(&self, view: u32) -> Way {
        if self.hidden_share < HIDDEN_SHARE_MIN {
            return Way::PageTable;
        }
        let Some(timed) = self.of_view.get(&view) else { return Way::Octree };
        let [page_table, octree] = timed.ms.each_ref().map(Vec::len);
        if octree < TIMED_FRAMES && octree <= page_table {
            return Way::Octree;
        }
        if page_table < TIMED_FRAMES {
            return Way::PageTable;
        }
        let prefers = timed.prefers.unwrap_or(Way::Octree);
        let again = timed.frames % TIMED_AGAIN_AFTER == TIMED_AGAIN_AFTER - 1;
        if again { prefers.other() } else { prefers }
    }

    /// So much of a view's frame was spent on marching, `ms` on the device, where one round drew all of it.
    pub fn timed(&mut self, view: u32, way: Way, ms: f64) {
        let timed = self.of_view.entry(view).or_default();
        timed.frames = timed.frames.wrapping_add(1);
        let of_way = &mut timed.ms[way as usize];
        of_way.push(ms);
        if of_way.len() > TIMED_FRAMES {
            of_way.remove(0);
        }
        if timed.ms.iter().any(|ms| ms.len() < TIMED_FRAMES) {
            return;
        }
        let [page_table, octree] =
            timed.ms.each_ref().map(|ms| ms.iter().copied().fold(f64::INFINITY, f64::min));
        timed.prefers = Some(match timed.prefers {
            None if page_table < octree => Way::PageTable,
            Some(Way::Octree) if page_table < octree * (1.0 - HYSTERESIS) => Way::PageTable,
            Some(Way::PageTable) if octree >= page_table * (1.0 - HYSTERESIS) => Way::PageTable,
            _ => Way::Octree,
        });
    }

    /// Leaves are hidden now of which nothing was known, or the other way round: what was timed holds no more.
    pub fn leaves_changed(&mut self, hidden_share: f64) {
        self.hidden_share = hidden_share;
        self.of_view.clear();
    }
}

impl Way {
    fn other(self) -> Way {
        match self {
            Way::PageTable => Way::Octree,
            Way::Octree => Way::PageTable,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws frames of one view whose ways take so long; how many were drawn with the octree.
    fn octree_frames(choice: &mut TraversalChoice, frames: u32, ms: [f64; 2]) -> u32 {
        let mut with_octree = 0;
        for _ in 0..frames {
            let way = choice.way(0);
            with_octree += u32::from(way == Way::Octree);
            choice.timed(0, way, ms[way as usize]);
        }
        with_octree
    }

    #[test]
    fn the_cheaper_way_stays_and_the_other_is_timed_now_and_then() {
        let mut choice = TraversalChoice::default();
        choice.leaves_changed(0.5);
        assert_eq!(octree_frames(&mut choice, 4, [10.0, 5.0]), 2);
        assert_eq!(octree_frames(&mut choice, 128, [10.0, 5.0]), 126);
        // Not worth a change.
        assert!(octree_frames(&mut choice, 256, [4.9, 5.0]) > 240);
        // Worth one, once it was timed again.
        assert!(octree_frames(&mut choice, 256, [3.0, 5.0]) < 140);
        assert_eq!(choice.way(1), Way::Octree);
    }

    #[test]
    fn where_nothing_is_hidden_nothing_is_timed() {
        let mut choice = TraversalChoice::default();
        assert_eq!(octree_frames(&mut choice, 100, [10.0, 5.0]), 0);
        choice.leaves_changed(0.04);
        assert_eq!(octree_frames(&mut choice, 100, [10.0, 5.0]), 0);
        choice.leaves_changed(0.06);
        assert_eq!(choice.way(0), Way::Octree);
    }
}
