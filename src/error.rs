//! What can go wrong through user or machine, as one sentence and an exit code.
//!
//! Our own bugs are panics; everything else that stops a command is an [`Error`].

use std::fmt;

/// The contract's exit codes, apart from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// A bug of ours.
    Bug = 1,
    /// Wrong arguments on the command line.
    Arguments = 2,
    /// A scene, data or file that cannot be used.
    Input = 3,
    /// The machine lacks something: device, feature, memory, disk.
    Machine = 4,
    /// Finished but incomplete: not converged, or bricks failed.
    Incomplete = 5,
    /// A comparison or verification found a difference.
    Difference = 6,
}

/// One sentence that names place, thing and remedy, and the exit code it leads to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// What the process ends with.
    pub exit: Exit,
    /// The sentence, without a full stop.
    pub message: String,
}

/// The result of everything that user or machine can make fail.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Wrong arguments (exit code 2).
    pub fn arguments(message: impl Into<String>) -> Error {
        Error { exit: Exit::Arguments, message: message.into() }
    }

    /// Unusable input (exit code 3).
    pub fn input(message: impl Into<String>) -> Error {
        Error { exit: Exit::Input, message: message.into() }
    }

    /// Something this machine lacks (exit code 4).
    pub fn machine(message: impl Into<String>) -> Error {
        Error { exit: Exit::Machine, message: message.into() }
    }

    /// A difference found by a comparison or verification (exit code 6).
    pub fn difference(message: impl Into<String>) -> Error {
        Error { exit: Exit::Difference, message: message.into() }
    }

    /// Puts the place before the sentence: `place: sentence`.
    #[must_use]
    pub fn at(self, place: impl fmt::Display) -> Error {
        Error { exit: self.exit, message: format!("{place}: {}", self.message) }
    }
}

impl fmt::Display for Error {
    /// One line, whatever names and paths it holds.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in self.message.chars() {
            if c.is_control() {
                write!(f, "{}", c.escape_default())?
            } else {
                fmt::Write::write_char(f, c)?
            }
        }
        Ok(())
    }
}

impl std::error::Error for Error {}
