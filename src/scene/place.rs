//! Where in a scene something was said.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{Error, Exit};

/// Where a value came from, for messages about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A scene file; line and column count from 1, columns in characters.
    File {
        /// The file as it was named.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
    },
    /// A command-line flag.
    Flag(&'static str),
    /// A scene made by code.
    Code,
}

impl Place {
    /// The place of byte `span.start` of `text`.
    pub fn in_file(path: &Path, text: &str, span: &Range<usize>) -> Place {
        let mut start = span.start.min(text.len());
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        let before = &text[..start];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        Place::File {
            path: path.to_owned(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        }
    }

    /// An error at this place: exit code 2 for a flag, 3 for a file.
    pub fn error(&self, message: impl Into<String>) -> Error {
        let exit = match self {
            Place::Flag(_) => Exit::Arguments,
            Place::File { .. } | Place::Code => Exit::Input,
        };
        Error { exit, message: format!("{self}: {}", message.into()) }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::File { path, line, column } => write!(f, "{}:{line}:{column}", path.display()),
            Place::Flag(flag) => f.write_str(flag),
            Place::Code => f.write_str("scene"),
        }
    }
}
