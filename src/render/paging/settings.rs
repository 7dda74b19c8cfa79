//! How bricks are paged. No setting changes a finished picture.

use std::time::Duration;

/// How voxels come into a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CopyPath {
    /// The transfer role copies from the staging half into the slot.
    Straight,
    /// It copies into an upload buffer, from which a compute pass places them.
    Placed,
}

impl CopyPath {
    /// The word used in plans and flags.
    pub const fn name(self) -> &'static str {
        match self {
            CopyPath::Straight => "straight",
            CopyPath::Placed => "placed",
        }
    }
}

/// Which bricks are loaded first, and which are given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadOrder {
    /// By the number of bricks from the eye, guarded: each brick about once, and always an end.
    Guarded,
    /// As in the papers, by how many rays ask for a brick, least recently used given up: here to show
    /// that it does not always end.
    Papers,
}

/// How rays cross what shows nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traversal {
    /// By the residency octree or the page table, whichever marches a view's frames faster here.
    Auto,
    /// Brick by brick, as the page table's entries say; a channel needs no brick that shows nothing of it.
    PageTable,
    /// The same as residency-octree-2023 compares with: only a brick that shows nothing of any channel is
    /// left out. For `bench octree`.
    PageTableOfPaper,
    /// After Crassin, as residency-octree-2023 compares with: an octree for each channel whose nodes have a
    /// brick each; a brick is sampled only where all its ancestors are resident. For `bench octree`.
    Octree,
    /// Box by box, as the words of a residency octree say; bricks are needed only where a leaf shows
    /// something, and only by the channels that do.
    ResidencyOctree,
}

impl Traversal {
    /// The word used in plans and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Traversal::Auto => "auto",
            Traversal::PageTable => "page-table",
            Traversal::PageTableOfPaper => "page-table-of-paper",
            Traversal::Octree => "octree",
            Traversal::ResidencyOctree => "residency-octree",
        }
    }
}

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PagingSettings {
    /// How rays cross what shows nothing.
    pub traversal: Traversal,
    /// Least voxels along the edges of an octree's leaf; leaves are halved bricks.
    pub leaf: [u32; 3],
    /// Children of an octree's node along each axis, 2 or 4.
    pub fan_out: u32,
    /// Slots of each atlas at most; nothing: as many as atlas_mib holds.
    pub atlas_slots: Option<u32>,
    /// Bricks that a staging half holds at most; nothing: as many as staging_mib holds.
    pub staging_bricks: Option<u32>,
    /// Loader threads; nothing: one per core, four at most.
    pub loaders: Option<u32>,
    /// How voxels come into a slot; nothing: straight where copies into images are fast.
    pub copy_path: Option<CopyPath>,
    /// Whether the upload buffer of the placed path is handed from role to role also where both use one family: to
    /// test and to measure what topology `ownership` does. It has the placed path.
    pub hands_over: bool,
    /// Whether a round waits for what it asked.
    pub lockstep: bool,
    /// Whether pictures are tinted by what rays met.
    pub show_states: bool,
    /// Whether rays mark the slots that they use. Off for `bench overhead` alone, where all fits: without
    /// marks nobody knows which slot is least recently used.
    pub marks: bool,
    /// Slots that one round grants of each atlas at most; nothing: as many as there are. For substitution,
    /// which then shows more of its way; `exact` needs those of one place at once.
    pub grants_per_round: Option<u32>,
    /// Microseconds that the rounds of all views together may take, picture by picture; nothing: as long as they
    /// take. Without lockstep: then uploads follow it, and loaders stand back behind the rays.
    pub frame_us: Option<u32>,
    /// Which bricks are loaded first.
    pub order: LoadOrder,
    /// Whether the records of all submits are kept, with what they do to slots: for the simulation of
    /// two queues. They grow with every round.
    pub keep_records: bool,
    /// Without any delivery for so long, what is asked for is given up.
    pub patience: Duration,
}

impl Default for PagingSettings {
    fn default() -> PagingSettings {
        PagingSettings {
            traversal: Traversal::PageTable,
            leaf: [4; 3],
            fan_out: 2,
            atlas_slots: None,
            staging_bricks: None,
            loaders: None,
            copy_path: None,
            hands_over: false,
            lockstep: true,
            show_states: false,
            marks: true,
            grants_per_round: None,
            frame_us: None,
            order: LoadOrder::Guarded,
            keep_records: false,
            patience: Duration::from_secs(30),
        }
    }
}

impl PagingSettings {
    /// What one view's round is to take, of so many that make a picture together.
    pub fn round_target_ms(&self, views: usize) -> Option<f64> {
        self.frame_us.map(|us| f64::from(us) / 1e3 / views.max(1) as f64)
    }

    /// Loader threads.
    pub fn loader_count(&self) -> usize {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        self.loaders.map_or(cores.min(4), |count| count as usize)
    }
}
