//! `--record FILE` and `--replay FILE` of render.

use std::path::PathBuf;

use clap::Args;

use crate::cli::output::print;
use crate::cli::whole_file::WholeFile;
use crate::error::{Error, Result};
use crate::render::paging::{Recording, Replayed};
use crate::render::{Renderer, SceneData};

/// A run of the paging loop, written down or done again.
#[derive(Args)]
pub struct ReplayFlags {
    /// Write down what came when and what rounds reported (JSON), so that the run can be done again. The scene
    /// has to be paged.
    #[arg(long, value_name = "FILE", conflicts_with = "replay", help_heading = "Replay")]
    record: Option<PathBuf>,
    /// Do a recorded run again, of the same scene and settings: on the device and driver that it was recorded
    /// on every round's bytes are the same, or it ends with exit code 6; elsewhere arrivals and evictions are
    /// forced, so that the cache is the same round by round.
    #[arg(long, value_name = "FILE", help_heading = "Replay")]
    replay: Option<PathBuf>,
    /// Force arrivals and evictions also where it was recorded.
    #[arg(long, requires = "replay", help_heading = "Replay")]
    replay_forced: bool,
}

/// What is to be done, its files met.
pub enum Asked {
    /// Neither.
    Nothing,
    /// A run is to be written down.
    Record(WholeFile),
    /// One is to be done again.
    Replay(Box<Recording>, bool),
}

impl ReplayFlags {
    /// Reads or makes the file.
    ///
    /// # Errors
    /// Exit code 3 when it is no recording, 4 when it cannot be written.
    pub fn ask(&self) -> Result<Asked> {
        if let Some(path) = &self.record {
            return Ok(Asked::Record(WholeFile::create(path)?));
        }
        let Some(path) = &self.replay else { return Ok(Asked::Nothing) };
        let bytes = std::fs::read(path)
            .map_err(|why| Error::input(format!("{}: cannot be read: {why}", path.display())))?;
        let recording = Recording::from_json(&bytes).map_err(|why| why.at(path.display()))?;
        Ok(Asked::Replay(Box::new(recording), self.replay_forced))
    }
}

impl Asked {
    /// Says so to a renderer that has drawn nothing. `data`: what it draws, all views included.
    ///
    /// # Errors
    /// As [`Renderer::record`] and [`Renderer::replay`].
    pub fn begin(&self, renderer: &mut Renderer, data: &SceneData) -> Result<()> {
        match self {
            Asked::Nothing => Ok(()),
            Asked::Record(_) => renderer.record(data),
            Asked::Replay(recording, forced) => {
                renderer.replay(Recording::clone(recording), data, *forced)
            }
        }
    }

    /// All views were drawn: writes what is to be written, and gives what became of the replay.
    ///
    /// # Errors
    /// Exit code 4 when the file cannot be written.
    pub fn end(self, renderer: &mut Renderer, says: bool) -> Result<Option<Replayed>> {
        match self {
            Asked::Nothing => Ok(None),
            Asked::Record(file) => {
                let recording = renderer.recording()?;
                file.write(|out| out.write_all(recording.to_json().as_bytes()))?;
                if says {
                    print(format_args!(
                        "recorded: {} rounds, {} bricks\n",
                        recording.rounds(),
                        recording.bricks()
                    ))?;
                }
                Ok(None)
            }
            Asked::Replay(..) => {
                let replayed = renderer.replayed();
                if let Some(told) = replayed.filter(|_| says) {
                    print(text(&told))?;
                }
                Ok(replayed)
            }
        }
    }
}

/// Whether a replay gave what was recorded.
///
/// # Errors
/// Exit code 6 when it did not.
pub fn heed(replayed: Option<&Replayed>) -> Result<()> {
    let Some(told) = replayed else { return Ok(()) };
    if told.left > 0 {
        return Err(Error::difference(format!(
            "--replay: {} things are recorded beyond the last view drawn: draw the views that were recorded",
            told.left
        )));
    }
    let differ = told.pictures - told.pictures_same;
    if differ > 0 && !told.forced {
        return Err(Error::difference(format!(
            "--replay: {differ} of {} pictures have other bytes than recorded",
            told.pictures
        )));
    }
    Ok(())
}

fn text(told: &Replayed) -> String {
    let how = if told.forced { ", arrivals and evictions forced" } else { "" };
    format!(
        "replayed: {} rounds{how}; {} of {} pictures have the recorded bytes\n",
        told.rounds, told.pictures_same, told.pictures
    )
}
