//! Small helpers for headers made of text.

use std::io::Read;

use crate::error::{Error, Result};
use crate::import::stream::Section;

/// Headers of text are refused beyond this many bytes: nothing that long is a header.
const HEADER_BYTES_MAX: u64 = 1 << 20;

/// Reads lines of a header and knows where it stands in the file.
pub struct Lines {
    bytes: Vec<u8>,
    at: usize,
}

impl Lines {
    /// The lines at the start of a file.
    pub fn of(section: &Section) -> Result<Lines> {
        let mut bytes = Vec::new();
        section
            .part(0, HEADER_BYTES_MAX)
            .read_to_end(&mut bytes)
            .map_err(|why| Error::input(format!("cannot be read: {why}")))?;
        Ok(Lines { bytes, at: 0 })
    }

    /// Bytes of the file before the next line.
    pub fn offset(&self) -> u64 {
        self.at as u64
    }

    /// The next line without its end, and `None` at the end of the file.
    ///
    /// # Errors
    /// When the line runs beyond what a header may be.
    pub fn next(&mut self) -> Result<Option<String>> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return Ok(None);
        }
        let line = match rest.iter().position(|byte| *byte == b'\n') {
            Some(end) => &rest[..end],
            None if (self.bytes.len() as u64) < HEADER_BYTES_MAX => rest,
            None => {
                return Err(Error::input(format!(
                    "the header does not end within {HEADER_BYTES_MAX} bytes"
                )));
            }
        };
        self.at = (self.at + line.len() + 1).min(self.bytes.len());
        Ok(Some(String::from_utf8_lossy(line).trim_end_matches('\r').to_owned()))
    }
}

/// Numbers separated by blanks or commas, possibly in parentheses.
pub fn numbers<T: std::str::FromStr>(field: &str, text: &str) -> Result<Vec<T>> {
    text.split(|c: char| c.is_whitespace() || ",()".contains(c))
        .filter(|word| !word.is_empty())
        .map(|word| number(field, word))
        .collect()
}

/// One number.
pub fn number<T: std::str::FromStr>(field: &str, word: &str) -> Result<T> {
    word.trim().parse().map_err(|_| {
        Error::input(format!(
            "header field \"{field}\": \"{}\" is not a number it can hold",
            shown(word)
        ))
    })
}

/// A piece of a header, short enough for a message.
pub fn shown(text: &str) -> String {
    let mut short: String = text.chars().filter(|c| !c.is_control()).take(40).collect();
    if text.chars().count() > 40 {
        short += "...";
    }
    short
}
