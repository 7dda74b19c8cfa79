//! How to render, beside what the scene says: nothing here changes a finished picture.

use crate::error::{Error, Result};
use crate::render::image_layout::LayoutChoice;
use crate::render::paging::PagingSettings;
use crate::twins::limits::BLOCK_SAMPLES;

/// Tile, work per dispatch, layout, paging. A picture's bytes do not depend on the first two; on the layout
/// only with filter `hardware`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Greatest size of a tile in pixels; a view is drawn tile by tile.
    pub tile: [u32; 2],
    /// Samples of one ray in one dispatch, at most.
    pub steps_per_dispatch: u32,
    /// Milliseconds that marching may take in one submit, 0: as long as it takes; nothing: an eighth of what the
    /// strictest driver's watchdog lets pass, and as long as it takes on a processor, which has none.
    pub submit_ms: Option<u32>,
    /// How voxels lie in their image.
    pub layout: LayoutChoice,
    /// How voxels are addressed.
    pub addressing: Addressing,
    /// Finest level drawn where bricks are paged, whatever a pixel's footprint: for the study, which
    /// takes levels one by one. Above 0 it changes the picture.
    pub level_min: u8,
    /// Where bricks are paged, levels above 0 are drawn by so many coarser, or finer where it is negative:
    /// for estimates of what levels cost. Other than 0 it changes the picture.
    pub level_shift: i8,
    /// By so many powers of two the integrator "adaptive" takes longer steps than its tolerance allows: for
    /// estimates of what they cost. Above 0 it changes the picture.
    pub steps_longer: u8,
    /// Whether what shows nothing is left out: macrocells of a volume drawn directly, else bricks.
    pub skipping: bool,
    /// How bricks are paged, where they are.
    pub paging: PagingSettings,
}

/// How voxels are addressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addressing {
    /// Directly where level 0 fits the atlas and memory, else in pages.
    Auto,
    /// All of level 0 in one image per channel.
    Direct,
    /// In bricks, through a page table.
    Paged,
}

/// lavapipe of Mesa 22.3 silently ends an invocation after 65,535 turns of all its loops together;
/// blocks and samples both count.
const STEPS_PER_DISPATCH_MAX: u32 = 32_768;
/// Turns of all loops of one invocation that plans allow: lavapipe's, less a margin.
pub(super) const LOOP_TURNS_MAX: u32 = 60_000;
/// Pixels of a tile along one side: bounds the memory of ray states.
const TILE_EDGE_MAX: u32 = 4096;

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            tile: [1024, 1024],
            steps_per_dispatch: 4096,
            submit_ms: None,
            layout: LayoutChoice::Auto,
            addressing: Addressing::Auto,
            level_min: 0,
            level_shift: 0,
            steps_longer: 0,
            skipping: true,
            paging: PagingSettings::default(),
        }
    }
}

impl Settings {
    /// Checks the numbers; steps are rounded up to whole blocks.
    ///
    /// # Errors
    /// Exit code 2 when one is out of range.
    pub fn checked(mut self) -> Result<Settings> {
        if !self.tile.iter().all(|edge| (1..=TILE_EDGE_MAX).contains(edge)) {
            return Err(Error::arguments(format!(
                "--tile: must be 1 to {TILE_EDGE_MAX} pixels a side, got {} x {}",
                self.tile[0], self.tile[1]
            )));
        }
        if !(1..=STEPS_PER_DISPATCH_MAX).contains(&self.steps_per_dispatch) {
            return Err(Error::arguments(format!(
                "--steps-per-dispatch: must be 1 to {STEPS_PER_DISPATCH_MAX}, got {}",
                self.steps_per_dispatch
            )));
        }
        self.steps_per_dispatch = self.steps_per_dispatch.next_multiple_of(BLOCK_SAMPLES);
        Ok(self)
    }

    /// Blocks of samples in one dispatch.
    pub fn blocks_per_dispatch(&self) -> u32 {
        self.steps_per_dispatch / BLOCK_SAMPLES
    }
}
