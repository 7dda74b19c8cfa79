//! What a study has measured so far, so that it can go on after it was stopped.
//!
//! One line per finished measurement, added when it is finished: 16 hexadecimal digits (XXH3 of the
//! rest), a space, and one JSON object. The first line says of what the study is.
//!
//! # Invariants
//! A line without an end was being written when the study was stopped: it is taken away, and what it
//! held is measured again. Any other line that is not as it was written is an error.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::error::{Error, Result};
use crate::study::error_time::{Outcome, Streaming};

/// What all measurements of a study have in common.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Subject {
    /// Of all that a reference and a picture depend on beside the setting, 16 hexadecimal digits.
    pub scene_hash: String,
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Of the program that measures.
    pub version: String,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Entry {
    /// The first.
    Study(Subject),
    /// A reference picture lies beside the journal.
    Reference {
        /// Of the volume.
        level: u8,
        /// XXH3 of the file's bytes, 16 hexadecimal digits.
        hash: String,
        /// What integrating it took, seconds on the wall.
        seconds: f64,
    },
    /// A setting was measured.
    Setting {
        /// As `Setting::key` tells it.
        key: String,
        /// Runs that count.
        repeats: u32,
        /// What came of it.
        outcome: Outcome,
    },
    /// Refinement by substitution was measured.
    Streaming {
        /// The setting, as `Setting::key` tells it.
        key: String,
        /// What came of it.
        streaming: Streaming,
    },
}

/// The open file, and what it holds.
pub struct Journal {
    path: PathBuf,
    file: File,
    entries: Vec<Entry>,
}

impl Journal {
    /// Opens the file, or makes it.
    ///
    /// # Errors
    /// Exit code 3 when it is damaged or of another study, 4 when it cannot be written.
    pub fn open(path: &Path, subject: &Subject) -> Result<Journal> {
        let machine = |why: std::io::Error| {
            Error::machine(format!(
                "{}: cannot be opened: {why}; choose another -o",
                path.display()
            ))
        };
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(machine)?;
        let bytes = std::fs::read(path).map_err(machine)?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let entries = bytes[..whole]
            .split_inclusive(|byte| *byte == b'\n')
            .enumerate()
            .map(|(index, line)| entry(&line[..line.len() - 1]).ok_or_else(|| damaged(path, index)))
            .collect::<Result<Vec<Entry>>>()?;
        file.set_len(whole as u64).map_err(machine)?;
        file.seek(SeekFrom::End(0)).map_err(machine)?;
        let mut journal = Journal { path: path.to_owned(), file, entries };
        match journal.entries.first() {
            None => journal.add(Entry::Study(subject.clone()))?,
            Some(Entry::Study(known)) if known == subject => {}
            Some(Entry::Study(known)) => return Err(of_another(path, known, subject)),
            Some(_) => return Err(damaged(path, 0)),
        }
        Ok(journal)
    }

    /// Everything known, oldest first.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Adds a line; it is on disk when this returns.
    ///
    /// # Errors
    /// Exit code 4 when it cannot be written.
    pub fn add(&mut self, entry: Entry) -> Result<()> {
        let text = serde_json::to_string(&entry)
            .map_err(|why| Error { exit: crate::error::Exit::Bug, message: why.to_string() })?;
        let line = format!("{:016x} {text}\n", xxh3_64(text.as_bytes()));
        let written = self.file.write_all(line.as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(|why| {
            Error::machine(format!(
                "{}: cannot be written: {why}; see to the disk",
                self.path.display()
            ))
        })?;
        self.entries.push(entry);
        Ok(())
    }
}

fn entry(line: &[u8]) -> Option<Entry> {
    let (hash, text) = std::str::from_utf8(line).ok()?.split_once(' ')?;
    let written =
        hash.len() == 16 && u64::from_str_radix(hash, 16).ok()? == xxh3_64(text.as_bytes());
    if written { serde_json::from_str(text).ok() } else { None }
}

fn damaged(path: &Path, index: usize) -> Error {
    Error::input(format!(
        "{}:{}: is not as a study wrote it: remove the file to measure all anew",
        path.display(),
        index + 1
    ))
}

fn of_another(path: &Path, known: &Subject, subject: &Subject) -> Error {
    let what = if known.device != subject.device || known.driver != subject.driver {
        format!("device, {} ({})", known.device, known.driver)
    } else if known.version != subject.version {
        format!("version of ashfall, {}", known.version)
    } else {
        "scene, view, size, reference or work flag".to_owned()
    };
    Error::input(format!(
        "{}:1: holds a study of another {what}: choose another -o, or remove the file",
        path.display()
    ))
}
