//! Flags of drawing in bricks through an atlas.

use std::time::Duration;

use clap::Args;

use crate::render::Addressing;
use crate::render::paging::{CopyPath, PagingSettings};

/// How bricks are paged. Nothing here changes a finished picture, but for --show-states.
#[derive(Args)]
pub struct PagingFlags {
    /// How voxels are addressed: direct (all of level 0 at once), paged (in bricks through an atlas),
    /// auto (direct where level 0 fits the atlas and memory).
    #[arg(long, default_value = "auto", value_parser = addressing, help_heading = "Paging")]
    addressing: Addressing,
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

    /// The settings they stand for.
    pub fn settings(&self) -> PagingSettings {
        PagingSettings {
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

fn copy_path(text: &str) -> Result<CopyChoice, String> {
    match text {
        "auto" => Ok(Choice(None)),
        "straight" => Ok(Choice(Some(CopyPath::Straight))),
        "placed" => Ok(Choice(Some(CopyPath::Placed))),
        _ => Err("expected auto, straight or placed".to_owned()),
    }
}
