//! Flags of drawing in bricks through an atlas.

use std::time::Duration;

use clap::Args;

use crate::render::Addressing;
use crate::render::paging::{CopyPath, PagingSettings, Traversal};

/// How bricks are paged. Nothing here changes a finished picture, but for --show-states.
#[derive(Args)]
pub struct PagingFlags {
    /// How voxels are addressed: direct (all of level 0 at once), paged (in bricks through an atlas),
    /// auto (direct where level 0 fits the atlas and memory).
    #[arg(long, default_value = "auto", value_parser = addressing, help_heading = "Paging")]
    addressing: Addressing,
    /// How rays cross what shows nothing: page-table (brick by brick), residency-octree (box by box, down to
    /// --leaf), auto (whichever marches a view's frames faster here). To compare with: page-table-of-paper (a brick is left out where no channel shows anything),
    /// octree (a brick is sampled where all coarser ones are there too; all have to fit).
    #[arg(long, default_value = "page-table", value_parser = traversal, help_heading = "Paging")]
    traversal: Traversal,
    /// Least voxels along the edges of a leaf of the residency octree: halved bricks, no smaller than this.
    #[arg(long, value_name = "XxYxZ", default_value = "4x4x4", value_parser = leaf, help_heading = "Paging")]
    leaf: Leaf,
    /// Children of a node of the residency octree along each axis: 2 or 4.
    #[arg(long, value_name = "N", default_value = "2", value_parser = fan_out, help_heading = "Paging")]
    fan_out: u32,
    /// Bricks that each atlas holds at most; default: as many as atlas_mib allows.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Paging")]
    atlas_slots: Option<u32>,
    /// Bricks that each staging half holds at most; default: as many as staging_mib allows.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Paging")]
    staging_bricks: Option<u32>,
    /// Threads that read bricks; default: one per core, at most 4.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256), help_heading = "Paging")]
    loaders: Option<u32>,
    /// How voxels come into the atlas: straight (copied by the transfer role), placed (through an upload
    /// buffer and a compute pass), auto.
    #[arg(long, default_value = "auto", value_parser = copy_path, help_heading = "Paging")]
    copy_path: CopyChoice,
    /// Each round waits for what it asked, so that runs repeat (the default).
    #[arg(long, conflicts_with = "free_running", help_heading = "Paging")]
    lockstep: bool,
    /// Rounds go on with what is there, as in a viewer: loading, copying and marching overlap.
    #[arg(long, help_heading = "Paging")]
    free_running: bool,
    /// Tint rays by what they met: pending bricks blue, failed orange, absent grey.
    #[arg(long, help_heading = "Paging")]
    show_states: bool,
    /// Seconds without any brick after which the picture is given up unfinished.
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=86_400), help_heading = "Paging")]
    patience: u64,
}

/// auto, or one of the paths.
type CopyChoice = Choice<CopyPath>;

#[derive(Clone, Copy)]
struct Choice<T>(Option<T>);

impl PagingFlags {
    /// How voxels are addressed.
    pub fn addressing(&self) -> Addressing {
        self.addressing
    }

    /// Whether `--lockstep` was given.
    #[cfg(feature = "viewer")]
    pub fn asks_lockstep(&self) -> bool {
        self.lockstep
    }

    /// The settings they stand for.
    pub fn settings(&self) -> PagingSettings {
        PagingSettings {
            traversal: self.traversal,
            leaf: self.leaf.0,
            fan_out: self.fan_out,
            atlas_slots: self.atlas_slots,
            staging_bricks: self.staging_bricks,
            loaders: self.loaders,
            copy_path: self.copy_path.0,
            lockstep: self.lockstep || !self.free_running,
            show_states: self.show_states,
            patience: Duration::from_secs(self.patience),
            ..PagingSettings::default()
        }
    }
}

fn addressing(text: &str) -> Result<Addressing, String> {
    match text {
        "auto" => Ok(Addressing::Auto),
        "direct" => Ok(Addressing::Direct),
        "paged" => Ok(Addressing::Paged),
        _ => Err("expected auto, direct or paged".to_owned()),
    }
}

fn traversal(text: &str) -> Result<Traversal, String> {
    let all = [
        Traversal::Auto,
        Traversal::PageTable,
        Traversal::PageTableOfPaper,
        Traversal::Octree,
        Traversal::ResidencyOctree,
    ];
    all.into_iter().find(|traversal| traversal.name() == text).ok_or_else(|| {
        "expected auto, page-table, residency-octree, page-table-of-paper or octree".to_owned()
    })
}

#[derive(Clone, Copy)]
struct Leaf([u32; 3]);

/// Voxels of a leaf's edge at most: no brick is larger.
const LEAF_EDGE_MAX: u32 = 1024;

fn leaf(text: &str) -> Result<Leaf, String> {
    let edges: Vec<u32> = text.split('x').map_while(|edge| edge.parse().ok()).collect();
    let whole = edges.len() == text.split('x').count();
    match (whole, &edges[..]) {
        (true, &[edge]) if (1..=LEAF_EDGE_MAX).contains(&edge) => Ok(Leaf([edge; 3])),
        (true, &[x, y, z]) if [x, y, z].iter().all(|e| (1..=LEAF_EDGE_MAX).contains(e)) => {
            Ok(Leaf([x, y, z]))
        }
        _ => Err(format!("expected 4 or 8x8x4, edges from 1 to {LEAF_EDGE_MAX}")),
    }
}

fn fan_out(text: &str) -> Result<u32, String> {
    match text {
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("expected 2 or 4".to_owned()),
    }
}

fn copy_path(text: &str) -> Result<CopyChoice, String> {
    match text {
        "auto" => Ok(Choice(None)),
        "straight" => Ok(Choice(Some(CopyPath::Straight))),
        "placed" => Ok(Choice(Some(CopyPath::Placed))),
        _ => Err("expected auto, straight or placed".to_owned()),
    }
}
