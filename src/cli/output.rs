//! Printing results on stdout.

use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::error::{Error, Result};

/// Prints text: the one door to stdout. A reader that has gone away is no error, where `println!`
/// would panic.
pub fn print(text: impl std::fmt::Display) {
    let _ = write!(std::io::stdout().lock(), "{text}");
}

/// Prints a line of text, as [`print`].
pub fn print_line(text: impl std::fmt::Display) {
    print(format_args!("{text}\n"));
}

/// Prints one object with `"format": 1` first.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print(json_text(value)?);
    Ok(())
}

/// Writes such an object into a file.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    std::fs::write(path, json_text(value)?).map_err(|why| {
        Error::machine(format!(
            "{}: cannot be written: {why}; check folder and disk",
            path.display()
        ))
    })
}

#[derive(Serialize)]
struct WithFormat<'a, T> {
    format: u32,
    #[serde(flatten)]
    value: &'a T,
}

fn json_text(value: &impl Serialize) -> Result<String> {
    let mut text = serde_json::to_string_pretty(&WithFormat { format: 1, value })
        .map_err(|why| Error { exit: crate::error::Exit::Bug, message: why.to_string() })?;
    text.push('\n');
    Ok(text)
}
